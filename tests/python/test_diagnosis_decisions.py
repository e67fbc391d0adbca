"""What becomes of probabilities: held to what is left on held-out data, to what would imitate it, and to what is beside it; on small made-up analyses."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from wineglass.diagnosis import decisions, twin_verdict
from wineglass.diagnosis.decisions import ENOUGH_OF_SEVERAL, ENOUGH_REMOVED, FORETOLD, IMITATED, MUCH_LEFT, NEARLY_OF_SEVERAL, NEARLY_REMOVED, NOISE_LEFT, NONE_BELOW, SHAKEN, Outcome
from wineglass.diagnosis.hypotheses import Hypotheses
from wineglass.diagnosis.vocabulary import FLICKER, NONE, OTHER


def closed(*support: str) -> SimpleNamespace:
    return SimpleNamespace(support=support, possible=True)


def confirmed(removed: float | None, before: float = 50.0, after: float = 2.0, most: float = 0.0, gained: tuple[float, float] = (50.0, 1.0),
              foretold: tuple[float, float] = (0.0, 0.0)) -> SimpleNamespace:
    """most: upper end of the interval of what is removed; gained: what the unit leaves without any effect, and what of that goes; foretold: energy of
    both."""
    return SimpleNamespace(total=SimpleNamespace(fraction=removed, before=before, after=after, interval=(0.0, most), foretold=foretold[0]),
                           gained=SimpleNamespace(before=gained[0], fraction=gained[1], foretold=foretold[1]), changes=[SimpleNamespace(in_floors=before, fraction=removed)])


def outcome(verdict: str, *ids: str, chosen: bool = True) -> Outcome:
    return Outcome(verdict, [ids], closed(*ids) if chosen else None)  # type: ignore[arg-type]


def noise(*named: str) -> SimpleNamespace:
    return SimpleNamespace(named=list(named), within_reach=frozenset(named))


def certain(*ids: str) -> Hypotheses:
    return Hypotheses({tuple(sorted(ids)): 0.98, (NONE,): 0.0, (OTHER,): 0.02})


def held(said: Outcome, weighed: Hypotheses, removed: float | None, before: float = 50.0, traces: SimpleNamespace | None = None) -> tuple[Outcome, Hypotheses]:
    return decisions.held_to_the_gap(SimpleNamespace(closed_for=lambda ids: None), said, weighed, confirmed(removed, before), traces)  # type: ignore[arg-type]


@pytest.mark.parametrize(("ids", "removed", "verdict"), [
    (("ageing",), ENOUGH_REMOVED + 0.01, "attributed"), (("ageing",), NEARLY_REMOVED - 0.01, "unknown"),
    (("ageing", "pickoff_gain"), ENOUGH_OF_SEVERAL + 0.01, "attributed"), (("ageing", "pickoff_gain"), ENOUGH_OF_SEVERAL - 0.01, "ambiguous"),
    (("ageing", "pickoff_gain"), NEARLY_OF_SEVERAL - 0.01, "unknown")])
def test_several_effects_must_leave_less_than_one_to_stand_alone(ids: tuple[str, ...], removed: float, verdict: str) -> None:
    said, weighed = held(outcome("attributed", *ids), certain(*ids), removed)
    assert said.verdict == verdict
    assert (weighed.other > 0.9) == (verdict == "unknown")


@pytest.mark.parametrize(("found", "verdict"), [
    (confirmed(NEARLY_REMOVED + 0.01), "ambiguous"), (confirmed(0.8, 3.0, NOISE_LEFT - 0.1, 0.99), "ambiguous"),
    (confirmed(0.8, 3.0, NOISE_LEFT + 0.1, 0.99), "unknown"), (confirmed(0.8, 3.0, NOISE_LEFT - 0.1, ENOUGH_REMOVED - 0.01), "unknown")])
def test_what_nearly_explains_all_may_have_something_beside_it(found: SimpleNamespace, verdict: str) -> None:
    analysis = SimpleNamespace(closed_for=lambda ids: closed("ageing"))
    said, weighed = decisions.held_to_the_gap(analysis, outcome("attributed", "ageing"), certain("ageing"), found, None)  # type: ignore[arg-type]
    assert said.verdict == verdict
    if verdict == "ambiguous":
        assert said.named == [("ageing",), ("ageing", OTHER)] and sum(weighed.probability.values()) == pytest.approx(1.0)
        assert weighed.probability["ageing",] == pytest.approx((1.0 - IMITATED) * 0.98) and weighed.probability["ageing", OTHER] == pytest.approx(IMITATED * 0.98)
        assert twin_verdict._next(analysis, said).run.startswith("the same protocol again")  # type: ignore[arg-type, union-attr]


def test_beside_an_effect_with_a_trace_of_its_own_another_one_is_single() -> None:
    both = certain("ageing", "firmware_mismatch")
    said, _ = held(outcome("attributed", "ageing", "firmware_mismatch"), both, ENOUGH_REMOVED + 0.01, traces=noise("firmware_mismatch"))
    assert said.verdict == "attributed"
    said, _ = held(outcome("attributed", "ageing", "firmware_mismatch"), both, NEARLY_REMOVED + 0.01, traces=noise("firmware_mismatch"))
    assert said.verdict == "ambiguous" and said.named == [("ageing", "firmware_mismatch"), ("ageing", "firmware_mismatch", OTHER)]


@pytest.mark.parametrize(("after", "verdict"), [(MUCH_LEFT - 0.1, "attributed"), (MUCH_LEFT + 0.1, "ambiguous")])
def test_what_is_left_of_a_large_gap_may_be_something_else(after: float, verdict: str) -> None:
    analysis = SimpleNamespace(closed_for=lambda ids: closed("ageing"))
    said, weighed = decisions.held_to_the_gap(analysis, outcome("attributed", "ageing"), certain("ageing"), confirmed(0.999, 3000.0, after), None)  # type: ignore[arg-type]
    assert said.verdict == verdict
    assert weighed.other == pytest.approx(0.02 if verdict == "attributed" else 0.02 + IMITATED * 0.98)


@pytest.mark.parametrize(("traces", "verdict"), [((), "ambiguous"), (("pickoff_gain",), "attributed")])
def test_three_effects_that_only_means_show_may_be_something_else(traces: tuple[str, ...], verdict: str) -> None:
    ids = ("ageing", "drive_phase", "pickoff_gain")
    said, _ = held(outcome("attributed", *ids), certain(*ids), 0.999, traces=noise(*traces))
    assert said.verdict == verdict


@pytest.mark.parametrize(("gained", "verdict"), [((1.3, 0.1), "no_gap"), ((1.3, None), "no_gap"), ((1.3, 0.9), "attributed"), ((5.0, 0.1), "attributed")])
def test_an_effect_that_only_stands_for_another_unit_is_none(gained: tuple[float, float], verdict: str) -> None:
    """Of a unit further off it removes nearly all; the unit that the recording asks for needs no effect."""
    analysis = SimpleNamespace(closed_for=lambda ids: closed("frequency_split"))
    said, weighed = decisions.held_to_the_gap(analysis, outcome("attributed", "frequency_split"), certain("frequency_split"),  # type: ignore[arg-type]
                                                  confirmed(0.99, 12.0, gained=gained), None)
    assert said.verdict == verdict
    assert (weighed.none > 0.9) == (verdict == "no_gap")


@pytest.mark.parametrize(("foretold", "verdict"), [((FORETOLD + 1.0, FORETOLD + 1.0), "attributed"), ((FORETOLD - 1.0, 1e4), "no_gap"), ((1e4, FORETOLD - 1.0), "no_gap")])
@pytest.mark.parametrize("removed", [None, 0.99])
def test_what_a_law_foretells_within_the_floors_is_there(foretold: tuple[float, float], verdict: str, removed: float | None) -> None:
    """Whether no channel is beyond its floor, or only that of another unit."""
    analysis = SimpleNamespace(closed_for=lambda ids: closed("ageing"))
    said, weighed = decisions.held_to_the_gap(analysis, outcome("attributed", "ageing"), certain("ageing"), confirmed(removed, gained=(0.0, None), foretold=foretold), None)  # type: ignore[arg-type]
    assert said.verdict == verdict and (said.chosen is not None) == (verdict == "attributed")
    assert (weighed.none > 0.9) == (verdict == "no_gap")


def test_what_has_a_trace_is_no_more_than_that_within_the_floors() -> None:
    """A clipping that codes show foretells means; whatever seems to be beside it there is not."""
    both, found = certain("adc_saturation", "frequency_split"), confirmed(None, foretold=(1e4, 1e4))
    analysis = SimpleNamespace(closed_for=lambda ids: closed("adc_saturation"))
    for said in (outcome("attributed", "adc_saturation", "frequency_split"), outcome("unknown", "adc_saturation")):
        held_to, weighed = decisions.held_to_the_gap(analysis, said, both, found, noise("adc_saturation"))  # type: ignore[arg-type]
        assert held_to.verdict == "attributed" and held_to.named == [("adc_saturation",)] and weighed.marginal("frequency_split") == 0.0


def test_noise_alone_explains_no_gap_of_means() -> None:
    said, weighed = held(outcome("attributed", "interference", chosen=False), certain("interference"), 0.0, 2.0 * SHAKEN, noise("interference"))
    assert said.verdict == "unknown" and said.named == [("interference",)]
    assert weighed.other > 0.9 and weighed.marginal("interference") > 0.9


def test_small_remains_of_a_named_line_are_its_own() -> None:
    both = certain("ageing", "interference")
    said, weighed = held(outcome("attributed", "ageing", "interference"), both, 0.06, 0.9 * SHAKEN, noise("interference"))
    assert said.verdict == "attributed" and said.named == [("interference",)] and said.chosen is None
    assert weighed.marginal("ageing") == 0.0
    removed, _ = held(outcome("attributed", "ageing", "interference"), both, ENOUGH_OF_SEVERAL + 0.01, 0.9 * SHAKEN, noise("interference"))
    assert removed.named == [("ageing", "interference")]


def test_what_removes_next_to_nothing_is_no_explanation_in_the_probabilities_either() -> None:
    said, weighed = held(outcome("attributed", "ageing"), certain("ageing"), 0.1)
    said, weighed = decisions.beside_unknown(said, weighed, 0.1, None)
    assert said.verdict == "unknown" and said.named == [] and weighed.other > 0.97 and weighed.marginal("ageing") < 0.02


@pytest.mark.parametrize(("removed", "named"), [(0.85, True), (0.5, False), (-0.3, False)])
def test_beside_something_unknown_only_what_removes_most_is_named(removed: float, named: bool) -> None:
    weighed = Hypotheses({("ageing", OTHER): 1.0, (NONE,): 0.0, (OTHER,): 0.0})
    said, weighed = decisions.beside_unknown(outcome("unknown", "ageing"), weighed, removed, None)
    assert said.named == ([("ageing",)] if named else []) and (said.chosen is not None) == named
    assert weighed.marginal("ageing") == pytest.approx(max(0.0, removed) ** 2)
    assert weighed.other == pytest.approx(1.0)


@pytest.mark.parametrize(("removed", "named"), [(0.96, True), (0.95, False)])
def test_several_effects_beside_something_unknown_answer_for_each_other(removed: float, named: bool) -> None:
    weighed = Hypotheses({("ageing", "drive_phase", OTHER): 1.0, (NONE,): 0.0, (OTHER,): 0.0})
    said, weighed = decisions.beside_unknown(outcome("unknown", "ageing", "drive_phase"), weighed, removed, None)
    assert said.named == ([("ageing", "drive_phase")] if named else [])
    assert weighed.marginal("ageing") == pytest.approx({0.96: 0.721, 0.95: 0.663}[removed], abs=1e-3)  # the square of what is removed, four times for two effects


@pytest.mark.parametrize("imitable", [True, False])
def test_what_plain_laws_would_imitate_is_not_named_alone(imitable: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decisions.plain, "imitated", lambda found, closed: frozenset(closed.support if imitable else ()))
    said, weighed = decisions.held_to_imitation(None, outcome("attributed", "ageing"), certain("ageing"), None)  # type: ignore[arg-type]
    assert said.verdict == ("ambiguous" if imitable else "attributed") and said.named[0] == ("ageing",)
    assert ((OTHER,) in said.named) == imitable
    assert weighed.marginal("ageing") == pytest.approx(1.0 - IMITATED if imitable else 1.0, abs=0.03)
    both, _ = decisions.held_to_imitation(None, outcome("attributed", "ageing", "pickoff_gain"), certain("ageing", "pickoff_gain"), None)  # type: ignore[arg-type]
    assert both.verdict == said.verdict
    by_line, _ = decisions.held_to_imitation(None, outcome("attributed", "interference"), certain("interference"), noise("interference"))  # type: ignore[arg-type]
    assert by_line.verdict == "attributed"


def test_of_a_set_only_what_plain_laws_would_imitate_may_be_something_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decisions.plain, "imitated", lambda found, closed: frozenset({"drive_misalignment"}))
    said, weighed = decisions.held_to_imitation(None, outcome("attributed", "ageing", "drive_misalignment"), certain("ageing", "drive_misalignment"),  # type: ignore[arg-type]
                                                    None)
    assert said.verdict == "ambiguous" and said.named == [("ageing", "drive_misalignment"), ("ageing", OTHER)]
    assert weighed.probability["ageing", OTHER] == pytest.approx(IMITATED * 0.98) and weighed.marginal("ageing") == pytest.approx(0.98)


def test_what_has_a_trace_of_its_own_stays_named_beside_something_unknown() -> None:
    weighed = Hypotheses({("ageing", "clock_jitter", "flicker_noise", OTHER): 1.0, (NONE,): 0.0, (OTHER,): 0.0})
    before = Outcome("unknown", [("ageing", "clock_jitter", "flicker_noise")], closed("ageing"))  # type: ignore[arg-type]
    said, weighed = decisions.beside_unknown(before, weighed, 0.3, noise("clock_jitter", "flicker_noise"))  # type: ignore[arg-type]
    assert said.named == [("clock_jitter",)] and said.chosen is None
    assert weighed.marginal("clock_jitter") == pytest.approx(1.0) and weighed.marginal("flicker_noise") < 0.5


def test_what_hardly_leaves_anything_has_at_most_something_unknown_beside_it() -> None:
    """A sharper look at all data sees something unknown; on held-out data nothing is left of the gap. Where much is left it stays unknown."""
    weighed = Hypotheses({("clock_error", OTHER): 1.0, (NONE,): 0.0, (OTHER,): 0.0})
    said, weighed = decisions.held_to_the_gap(None, outcome("unknown", "clock_error"), weighed, confirmed(0.99, after=1.7), None)  # type: ignore[arg-type]
    assert said.verdict == "ambiguous" and said.named == [("clock_error",), ("clock_error", OTHER)]
    assert weighed.probability[("clock_error",)] > weighed.probability[("clock_error", OTHER)] > 0.0
    for left in (confirmed(0.9, after=1.7), confirmed(0.99, after=8.0)):
        said, _ = decisions.held_to_the_gap(None, outcome("unknown", "clock_error"), weighed, left, None)  # type: ignore[arg-type]
        assert said.verdict == "unknown"


@pytest.mark.parametrize(("none", "verdict"), [(NONE_BELOW + 0.01, "no_gap"), (NONE_BELOW - 0.01, "attributed")])
def test_a_gap_is_one_only_where_no_gap_is_unlikely(none: float, verdict: str) -> None:
    analysis = SimpleNamespace(closed_for=lambda ids: None)
    weighed = Hypotheses({(NONE,): none, ("flicker_noise",): 1.0 - none, (OTHER,): 0.0})
    assert decisions.decide(analysis, weighed).verdict == verdict  # type: ignore[arg-type]


@pytest.mark.parametrize(("channel", "followed", "named", "catalogue", "verdict"), [
    ("rate", (), (), {FLICKER}, "ambiguous"), ("secondary_in_phase", (), (), {FLICKER, "ageing"}, "ambiguous"), ("drive_level", (), (), {FLICKER}, "unknown"),
    ("rate", ("ageing",), (), {FLICKER}, "unknown"), ("rate", (), ("clock_jitter",), {FLICKER}, "unknown"), ("rate", (), (), {"clock_jitter"}, "unknown")])
def test_where_no_law_was_worth_following_a_bias_may_wander(channel: str, followed: tuple[str, ...], named: tuple[str, ...], catalogue: set[str], verdict: str) -> None:
    """catalogue: what noise was asked for."""
    found = SimpleNamespace(closed=[closed(*followed)] if followed else [], closed_for=lambda ids: None)
    changes = [SimpleNamespace(channel=channel, fraction=0.0), SimpleNamespace(channel="drive_frequency", fraction=None)]
    traces = SimpleNamespace(named=list(named), log_evidence={frozenset({effect}): 0.0 for effect in catalogue})
    lost = Hypotheses({(NONE,): 0.0, (OTHER,): 0.9, ("ageing",): 0.1})
    said, weighed = decisions.wanders_or_unknown(found, Outcome("unknown", [], None), lost, SimpleNamespace(changes=changes), traces)  # type: ignore[arg-type]
    assert said.verdict == verdict and sum(weighed.probability.values()) == pytest.approx(1.0)
    if verdict == "ambiguous":
        assert said.named == [(FLICKER,), (OTHER,)] and weighed.marginal(FLICKER) == pytest.approx(0.45)
        assert "does not repeat" in twin_verdict._next(found, said).why  # type: ignore[arg-type, union-attr]
    else:
        assert weighed is lost
