"""Scores of answers written by hand, counted by hand."""

import math
import re

import blind_sets as sets
import pytest

from wineglass import cli
from wineglass.blind import gating, scores, scoring
from wineglass.blind.marks import mark

SURE = ((0.96, "ageing"), (0.02, "none"), (0.02, "other"))


def marked(sheet, diagnosis, snr=100.0):
    return mark(sets.label(sheet, snr), {"diagnosis": diagnosis})


def single(effect="ageing", variant="linear", **more):
    return sets.sheet("case_0001", "single", (effect, variant), **more)


@pytest.mark.parametrize("diagnosis, in_set, unique_wrong, right", [
    (sets.diagnosis("attributed", *SURE, named=("ageing",), place="coupling"), True, False, True),
    (sets.diagnosis("attributed", (0.96, "cross_damping"), (0.02, "none"), (0.02, "other"), named=("cross_damping",)), False, True, False),
    (sets.diagnosis("attributed", (0.96, "ageing+cross_damping"), (0.02, "none"), (0.02, "other"), named=("ageing", "cross_damping")), False, True, False),
    (sets.diagnosis("ambiguous", (0.5, "ageing"), (0.4, "flicker_noise"), (0.0, "none"), (0.1, "other"), alternatives=("ageing", "flicker_noise")),
     True, False, True),
    (sets.diagnosis("unknown", (0.9, "other"), (0.1, "none")), False, False, False),
    (sets.diagnosis("unknown", (0.9, "ageing+other"), (0.1, "none"), (0.0, "other"), named=("ageing",)), False, False, False),
    (sets.diagnosis("unknown", (0.9, "clock_error+other"), (0.1, "none"), (0.0, "other"), named=("clock_error",)), False, True, False),
    (sets.diagnosis("no_gap", (0.9, "none"), (0.1, "other")), False, False, False),
])
def test_marks_of_a_single(diagnosis, in_set, unique_wrong, right):
    found = marked(single(), diagnosis)
    assert (found.in_set, found.unique_wrong, found.right) == (in_set, unique_wrong, right)


def test_what_is_outside_the_catalogue_is_other():
    sheet = sets.sheet("case_0001", "known_and_unknown", ("ageing", "linear"), ("channel_memory", "same_sample"))
    found = marked(sheet, sets.diagnosis("unknown", (0.7, "ageing+other"), (0.2, "other"), (0.1, "none"), named=("ageing",), place="pickoff"))
    assert found.truth == {"ageing", "other"} and found.flagged and found.right and found.place_right and not found.in_catalogue
    assert found.brier == pytest.approx(0.5 * (0.3**2 + 0.2**2 + 0.1**2))


def test_twins_that_nobody_tells_apart_are_no_blame():
    sheet = sets.sheet("case_0001", "unidentifiable", ("frequency_split", "constant"), twins=(("frequency_split",), ("pickoff_phase",)))
    named = marked(sheet, sets.diagnosis("attributed", (1.0, "pickoff_phase"), (0.0, "none"), (0.0, "other"), named=("pickoff_phase",), place="pickoff"))
    assert not named.unique_wrong and named.right and named.place_right and not named.in_set


def test_intervals_are_held_against_the_strength_in_the_diagnosis_unit():
    truth = math.radians(60.0) / 3600.0
    sheet = single("cross_damping", "constant", factor=60.0)
    for low, high, inside in ((0.9 * truth, 1.1 * truth, True), (1.05 * truth, 1.1 * truth, False)):
        found = marked(sheet, sets.diagnosis("attributed", *SURE, named=(f"cross_damping:c0_rad_s:{low}:{high}",)))
        assert found.covered == (("cross_damping.c0_rad_s", inside),)


def test_a_set_counted_by_hand(tmp_path):
    healthy, gone = sets.diagnosis("no_gap", (0.9, "none"), (0.1, "other")), sets.diagnosis("unknown", (0.2, "none"), (0.8, "other"), place="primary")
    good = sets.diagnosis("attributed", *SURE, named=("ageing",), place="coupling", fraction=0.99)
    wrong = sets.diagnosis("attributed", *SURE, named=("ageing",), place="coupling", fraction=0.4)
    cases = [
        (sets.sheet("case_0001", "null"), healthy, 0.0), (sets.sheet("case_0002", "null_noisy"), gone, 0.0),
        (sets.sheet("case_0003", "single", ("ageing", "linear")), good, 50.0), (sets.sheet("case_0004", "single", ("clock_error", "constant")), wrong, 20.0),
        (sets.sheet("case_0005", "single", ("ageing", "linear"), factor=0.1), healthy, 6.0),
        (sets.sheet("case_0006", "pair", ("ageing", "linear"), ("clock_error", "constant")), good, 90.0),
        (sets.sheet("case_0007", "outside", ("channel_memory", "both_ways")), gone, 30.0), (sets.sheet("case_0008", "single", ("ageing", "linear")), None, 40.0),
    ]
    folders = sets.sealed_set(tmp_path / "set", [sets.label(sheet, snr) for sheet, _, snr in cases])
    for sheet, diagnosis, _ in cases:
        sets.answer(folders, sheet.name, diagnosis)
    found = scores.score(scoring.marked(folders)["diagnose"])
    clear, every = found["clear"], found["all"]
    counts = {name: (value["k"], value["n"]) for name, value in clear.items() if isinstance(value, dict)}
    assert counts == {"false_gap": (1, 2), "truth_in_set": (1, 4), "unique_and_wrong": (2, 5), "unique_and_right": (1, 4), "missed": (1, 5),
                      "pairs_exact": (0, 1), "unknown_flagged": (1, 1), "unknown_flagged_falsely": (0, 4), "place": (2, 5), "interval_coverage": (0, 0),
                      "failed": (1, 7)}
    assert (every["missed"]["k"], every["missed"]["n"]) == (2, 6) and found["undetectable"]["cases"] == 0
    assert clear["removed_median"] == 0.99 and clear["residual_median"] == pytest.approx(1.05)
    sure, not_listed = 0.5 * (0.04**2 + 2 * 0.02**2), 0.5 * (1 + 0.96**2 + 2 * 0.02**2)
    null_wrong, unknown_right = 0.8**2, 0.2**2
    assert clear["brier"] == pytest.approx((0.1**2 + null_wrong + sure + not_listed + not_listed + unknown_right + 1.0) / 7)
    # right by confidence: 0.0 wrong (failed); 0.8 of which one right; 0.9 right; 0.96 of which one in three right; bins of a tenth
    assert clear["ece"] == pytest.approx((2 * abs(0.8 - 0.5) + 4 * abs((0.9 + 3 * 0.96) / 4 - 0.5)) / 7)
    assert found["confusion"] == {"ageing": {"ageing": 1, "error": 1}, "clock_error": {"ageing": 1}}
    assert found["by_snr"]["5 to 10"]["cases"] == 1 and found["by_snr"]["10 to 50"]["cases"] == 3
    assert [one["case"] for one in found["worst"]][:2] == ["case_0006", "case_0004"]


def test_the_scoreboard_needs_nothing_else(tmp_path):
    folders = sets.sealed_set(tmp_path / "set", [sets.label(single(), 50.0)])
    for engine in ("diagnose", "twin"):
        sets.answer(folders, "case_0001", sets.diagnosis("attributed", *SURE, named=("ageing",), place="coupling", fraction=0.99), engine)
    assert cli.main(["--quiet", "blind", "score", str(folders.root)]) == 0
    page = (folders.root / "scores.html").read_text()
    assert page.count("<svg") == 5 and "Beside the baselines" in page and "case_0001" not in page  # nothing was wrong
    assert not re.search(r'(src|href)="(?!#|data:)', page) and "<script" not in page and "@import" not in page


def test_snr_bins_stand_in_order():
    found = scores.score([marked(single(), sets.diagnosis("no_gap", (1.0, "none"), (0.0, "other")), snr) for snr in (2000.0, 20.0, 1.0, 5.0, 60.0, 300.0)])
    assert list(found["by_snr"]) == ["5 to 10", "10 to 50", "50 to 200", "200 to 1000", "from 1000"] and found["undetectable"]["cases"] == 1


def test_baselines_get_the_same_share_of_false_gaps():
    answers = {f"null_{i}": {"gap_statistic": float(i), "diagnosis": sets.diagnosis("attributed", (1.0, "ageing"), (0.0, "none"), (0.0, "other"))}
               for i in range(10)}
    answers |= {f"gap_{i}": {"gap_statistic": 100.0, "diagnosis": sets.diagnosis("attributed", (1.0, "ageing"), (0.0, "none"), (0.0, "other"))} for i in range(3)}
    gated = gating.gate(answers, {name for name in answers if name.startswith("null")}, 0.2)
    claimed = sorted(name for name, one in gated.items() if one["diagnosis"]["verdict"] != "no_gap")
    assert claimed == ["gap_0", "gap_1", "gap_2", "null_8", "null_9"]
    for one in gated.values():
        assert sum(h["probability"] for h in one["diagnosis"]["hypotheses"]) == pytest.approx(1.0)
