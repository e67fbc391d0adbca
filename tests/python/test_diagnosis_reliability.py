"""Probabilities of an answer, taken back to how often such answers were right."""

from __future__ import annotations

import pytest

from wineglass.diagnosis.hypotheses import Hypotheses
from wineglass.diagnosis.reliability import ALONE, NO_GAP, UNKNOWN, tempered
from wineglass.diagnosis.vocabulary import NONE, OTHER

SURE = Hypotheses({("ageing",): 0.98, ("ageing", "vibration"): 0.02, (NONE,): 0.0, (OTHER,): 0.0})


def whole(found: Hypotheses) -> float:
    return sum(found.probability.values())


def test_an_explanation_that_stands_alone_may_be_a_part_of_the_truth_or_none() -> None:
    found = tempered(SURE, "attributed", [("ageing",)], [])
    assert found.probability[("ageing",)] == ALONE and whole(found) == pytest.approx(1.0)
    assert 0.0 < found.probability[(OTHER,)] < found.probability[("ageing", OTHER)] < 1.0 - ALONE
    unsure = Hypotheses({("ageing",): 0.6, ("vibration",): 0.4, (NONE,): 0.0})
    assert tempered(unsure, "attributed", [("ageing",)], []) is unsure


def test_something_unknown_may_be_what_was_followed() -> None:
    lost = Hypotheses({(OTHER,): 0.9, ("ageing", OTHER): 0.1, (NONE,): 0.0})
    found = tempered(lost, "unknown", [], [("vibration",), ("pickoff_gain", "ageing")])
    assert found.other == pytest.approx(UNKNOWN) and whole(found) == pytest.approx(1.0)
    assert found.probability[("vibration",)] == pytest.approx(found.probability[("ageing", "pickoff_gain")])
    assert found.marginal("ageing") > 0.1  # it stays what it was beside something unknown, and may be one of a set
    assert tempered(lost, "unknown", [], []).probability[("flicker_noise",)] == pytest.approx(0.9 * (1.0 - UNKNOWN))  # where no law was followed it may be noise


def test_tolerances_may_cover_what_is_no_gap() -> None:
    nothing = Hypotheses({(NONE,): 0.99, ("ageing",): 0.004, (OTHER,): 0.006})
    found = tempered(nothing, "no_gap", [], [])
    assert found.none == NO_GAP and whole(found) == pytest.approx(1.0)
    assert found.probability[(OTHER,)] > found.probability[("ageing",)] == 0.004
    unsure = Hypotheses({(NONE,): 0.8, (OTHER,): 0.2})
    assert tempered(unsure, "no_gap", [], []) is unsure


@pytest.mark.parametrize("verdict", ["ambiguous", "insufficient"])
def test_other_answers_stay(verdict: str) -> None:
    assert tempered(SURE, verdict, [("ageing",)], []) is SURE
