"""What a diagnosis says of explanations, on small made-up analyses."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from wineglass.diagnosis import hypotheses, twin_verdict
from wineglass.diagnosis.hypotheses import Hypotheses
from wineglass.diagnosis.noise_level import NoiseEvidence
from wineglass.diagnosis.vocabulary import NONE, OTHER


def test_a_probability_that_rounding_takes_beyond_one_is_one() -> None:
    listed = twin_verdict._hypotheses(Hypotheses({(OTHER,): 1.0 + 2.3e-16, (NONE,): 0.0}))
    assert [h.probability for h in listed] == [1.0, 0.0]


def test_noise_forgets_what_is_taken_out_of_the_catalogue() -> None:
    values = {frozenset[str](): 0.0, frozenset({"clock_jitter"}): 30.0, frozenset({"clock_jitter", "excess_noise"}): 40.0, frozenset({"excess_noise"}): 20.0}
    seen = NoiseEvidence(values, [], [], None, None, None, None, None, None, None)
    assert seen.named == ["clock_jitter", "excess_noise"]
    assert seen.forget(frozenset({"clock_jitter"})).named == ["excess_noise"]
    assert seen.forget(frozenset()).log_evidence == values


def test_in_reach_of_noise_is_only_what_it_speaks_for() -> None:
    """A tone that is there, jitter that could be instead of excess noise, and a clipping that codes only do not exclude."""
    jitter, excess, tone, clipping = (frozenset({e}) for e in ("clock_jitter", "excess_noise", "interference", "adc_saturation"))
    values = {frozenset[str](): 0.0, tone: 50.0, clipping: -2.0, tone | clipping: 48.0, jitter: 30.0, excess: 28.0, tone | jitter: 80.0, tone | excess: 78.0}
    seen = NoiseEvidence(values, [], [], None, None, None, None, None, None, None)
    assert seen.within_reach == tone | jitter | excess


def test_an_effect_whose_numbers_are_nothing_is_idle() -> None:
    """Of two effects: one number four deviations from nothing, and two that are only so apart, not together with what they share."""
    unknowns = [SimpleNamespace(effect="ageing", role="strength"), SimpleNamespace(effect="ageing", role="shape"),
                SimpleNamespace(effect="pickoff_gain", role="strength"), SimpleNamespace(effect="pickoff_gain", role="strength")]
    explanation = SimpleNamespace(support=("ageing", "pickoff_gain"), unknowns=unknowns)
    covariance = np.diag([1.0, 1.0, 4.0, 4.0])
    run = SimpleNamespace(values=np.array([4.0, 100.0, 2.0, -3.0]), covariance=covariance)
    assert twin_verdict._idle(explanation, run) == {"pickoff_gain"}  # type: ignore[arg-type]
    shared = covariance.copy()
    shared[2, 3] = shared[3, 2] = 3.9  # the sum is uncertain, the difference is not
    assert twin_verdict._idle(explanation, SimpleNamespace(values=run.values, covariance=shared)) == frozenset()  # type: ignore[arg-type]
    ridge = covariance.copy()
    ridge[0, 0], ridge[0, 1], ridge[1, 0], ridge[1, 1] = 9.0, 8.9, 8.9, 9.0  # larger with a longer time: a size of nothing has no time
    assert twin_verdict._idle(explanation, SimpleNamespace(values=run.values, covariance=ridge)) == {"pickoff_gain"}  # type: ignore[arg-type]
    assert twin_verdict._idle(None, run) == frozenset()  # type: ignore[arg-type]


def test_idle_effects_leave_the_sets_that_hold_the_explanation_and_no_others() -> None:
    weighed = Hypotheses({("ageing", "pickoff_gain"): 0.6, ("ageing", "flicker_noise", "pickoff_gain"): 0.1, ("pickoff_gain",): 0.2, (NONE,): 0.0, (OTHER,): 0.1})
    found = hypotheses.less(weighed, frozenset({"ageing", "pickoff_gain"}), frozenset({"pickoff_gain"}))
    assert found.probability == pytest.approx({("ageing",): 0.6, ("ageing", "flicker_noise"): 0.1, ("pickoff_gain",): 0.2, (NONE,): 0.0, (OTHER,): 0.1})
    alone = hypotheses.less(weighed, frozenset({"pickoff_gain"}), frozenset({"pickoff_gain"}))
    assert alone.none == pytest.approx(0.2)
