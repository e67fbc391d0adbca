"""Probabilities of sets of effects against the same sums written out over every channel with or without a discrepancy."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from wineglass.diagnosis import hypotheses
from wineglass.diagnosis.explain import GENERIC_PRIOR, INCLUSION
from wineglass.diagnosis.hypotheses import Hypotheses, alternatives, weigh
from wineglass.diagnosis.vocabulary import NONE, OTHER

NOTHING = frozenset[str]()
ODDS = np.log(INCLUSION / (1.0 - INCLUSION))


def entry(log_evidence: float, factors: tuple[float, ...]) -> SimpleNamespace:
    """factors: per channel, how much better a generic discrepancy does."""
    return SimpleNamespace(log_evidence=log_evidence, log_generic=float(sum(np.log(1.0 - GENERIC_PRIOR + GENERIC_PRIOR * f) for f in factors)))


def closed(support: tuple[str, ...], log_evidence: float, factors: tuple[float, ...], earned: bool = True) -> SimpleNamespace:
    return SimpleNamespace(support=support, entry=entry(log_evidence, factors), earned=earned)


def found(none: SimpleNamespace, *closures: SimpleNamespace, channels: int = 3) -> SimpleNamespace:
    return SimpleNamespace(names=tuple("abcdef"[:channels]), none=none, closed=list(closures))


def noise(traces: dict[frozenset[str], float], seen: tuple[str, ...] = ()) -> SimpleNamespace:
    return SimpleNamespace(log_evidence=traces, looks={effect: ["somewhere"] for effect in seen})


def written_out(factors: tuple[float, ...]) -> tuple[float, float]:
    """Weight of: no channel holds a discrepancy; some do."""
    parts = {chosen: float(np.prod([GENERIC_PRIOR * f if held else 1.0 - GENERIC_PRIOR for held, f in zip(chosen, factors)]))
             for chosen in product((False, True), repeat=len(factors))}
    nothing = parts.pop((False,) * len(factors))
    return nothing, sum(parts.values())


def test_every_set_with_and_without_a_discrepancy_in_each_channel() -> None:
    cases = {(): (-12.0, (30.0, 2.0, 0.5)), ("ageing",): (-9.0, (1.0, 900.0, 0.2)), ("ageing", "pickoff_gain"): (-8.5, (0.5, 0.5, 4.0))}
    first, *others = ((ids, entry(*given)) for ids, given in cases.items())
    known = weigh(found(first[1], *(closed(ids, *cases[ids]) for ids, _ in others)), None)
    expected = {}
    for ids, (log_evidence, factors) in cases.items():
        without, with_some = written_out(factors)
        expected[ids or (NONE,)] = np.exp(log_evidence) * without
        expected[tuple(sorted({*ids, OTHER}))] = np.exp(log_evidence) * with_some
    total = sum(expected.values())
    assert set(known.probability) == set(expected)
    for ids, weight in expected.items():
        assert known.probability[ids] == pytest.approx(weight / total, rel=1e-9), ids


def test_what_the_noise_says_multiplies_in_with_the_prior_of_what_it_adds() -> None:
    """A trace of what the slow channels know costs no second prior; one of what they do not know does."""
    slow = found(entry(0.0, (1.0,) * 3), closed(("thermometer_lag",), 3.0, (1.0,) * 3))
    traces = {NOTHING: 0.0, frozenset({"clock_jitter"}): 5.0, frozenset({"thermometer_lag"}): 1.0}
    known = weigh(slow, noise(traces)).probability
    base = known[(NONE,)]
    assert known[("clock_jitter",)] / base == pytest.approx(np.exp(5.0 + ODDS), rel=1e-9)
    assert known[("clock_jitter", "thermometer_lag")] / base == pytest.approx(np.exp(3.0 + 5.0 + ODDS), rel=1e-9)
    # three ways to it: slow channels alone, slow channels with their trace, the trace alone
    assert known[("thermometer_lag",)] / base == pytest.approx(np.exp(3.0) + np.exp(3.0 + 1.0) + np.exp(1.0 + ODDS), rel=1e-9)


@pytest.mark.parametrize("effect", sorted(hypotheses.TRACED))
def test_an_effect_that_would_leave_a_trace_is_out_where_there_is_none(effect: str) -> None:
    slow = found(entry(0.0, (1.0,)), closed((effect,), 12.0, (1.0,)), channels=1)
    assert weigh(slow, None).marginal(effect) > 0.99
    assert weigh(slow, noise({NOTHING: 0.0})).marginal(effect) > 0.99, "nobody looked"
    assert weigh(slow, noise({NOTHING: 0.0}, seen=(effect,))).marginal(effect) < 0.01
    assert weigh(slow, noise({NOTHING: 0.0, frozenset({effect}): 9.0}, seen=(effect,))).marginal(effect) > 0.99


def test_what_did_not_earn_its_place_is_no_hypothesis() -> None:
    known = weigh(found(entry(0.0, (1.0,)), closed(("ageing",), 50.0, (1.0,), earned=False), channels=1), None)
    assert known.marginal("ageing") == 0.0 and known.none > 0.99


def test_other_in_the_noise_counts_without_a_price() -> None:
    known = weigh(found(entry(0.0, (1.0,)), channels=1), noise({NOTHING: 0.0, frozenset({OTHER}): 2.0}))
    discrepancy = GENERIC_PRIOR  # its factor is one
    assert known.probability[(OTHER,)] / known.none == pytest.approx((np.exp(2.0) + discrepancy) / (1.0 - discrepancy), rel=0.02)


def test_the_list_is_short_whole_and_has_none_and_other() -> None:
    effects = [f"effect_{i:02d}" for i in range(40)]
    closures = [closed((name,), 20.0 - i, (1.0,)) for i, name in enumerate(effects)]
    known = weigh(found(entry(-40.0, (1.0,)), *closures, channels=1), None)
    assert sum(known.probability.values()) == pytest.approx(1.0, abs=1e-12)
    assert hypotheses.LISTED <= len(known.probability) <= hypotheses.LISTED + 2
    assert (NONE,) in known.probability and (OTHER,) in known.probability
    assert known.named[0] == ("effect_00",)


def test_readings_of_a_distribution() -> None:
    known = Hypotheses({(NONE,): 0.05, (OTHER,): 0.05, ("ageing",): 0.2, ("ageing", OTHER): 0.4, ("ageing", "pickoff_gain"): 0.3})
    assert known.none == 0.05
    assert known.other == pytest.approx(0.45)
    assert known.marginal("ageing") == pytest.approx(0.9)
    assert known.named == [("ageing", "pickoff_gain"), ("ageing",)]
    assert known.best_known == ("ageing",)
    assert Hypotheses({(NONE,): 1.0}).best_known == ()


@pytest.mark.parametrize(("probability", "expected"), [
    ({("a",): 0.97, ("b",): 0.03}, [("a",)]),  # the first is credible by itself
    ({("a",): 0.6, ("b",): 0.35, ("c",): 0.05}, [("a",), ("b",)]),  # two make 95 %
    ({("a", "b"): 0.5, ("a",): 0.3, ("c",): 0.2}, [("a",), ("c",)]),  # a simpler one, about as probable, stands for the larger
    ({("a", "b"): 0.8, ("a",): 0.2}, [("a", "b"), ("a",)]),  # not as probable: both stay
    ({("a",): 0.5, (OTHER,): 0.4, (NONE,): 0.1}, [("a",)]),  # neither none nor other is an alternative
    ({(NONE,): 1.0, (OTHER,): 0.0}, []),
])
def test_alternatives_are_the_credible_sets(probability: dict[tuple[str, ...], float], expected: list[tuple[str, ...]]) -> None:
    assert alternatives(Hypotheses(probability)) == expected


def test_below_the_floor_nothing_is_left_but_a_doubt() -> None:
    found = hypotheses.below_the_floor(Hypotheses({("damping_step",): 0.9, ("ageing", OTHER): 0.06, (NONE,): 0.04}))
    assert sum(found.probability.values()) == pytest.approx(1.0) and found.none == pytest.approx(hypotheses.CREDIBLE)
    assert found.marginal("damping_step") == pytest.approx((1.0 - hypotheses.CREDIBLE) * 0.9 / 0.96)
    sure = Hypotheses({(NONE,): 0.99, (OTHER,): 0.01})
    assert hypotheses.below_the_floor(sure) is sure


def test_only_what_left_a_trace_is_kept_of_every_set() -> None:
    found = hypotheses.only(Hypotheses({("clock_jitter", "damping_step"): 0.5, ("clock_jitter", OTHER): 0.2, ("ageing",): 0.1, ("excess_noise",): 0.15, (NONE,): 0.05}),
                            frozenset({"clock_jitter", "excess_noise"}))
    assert found.probability == pytest.approx({("clock_jitter",): 0.7, ("excess_noise",): 0.15, (NONE,): 0.15, (OTHER,): 0.0})


def test_a_plain_gap_is_something() -> None:
    found = hypotheses.not_none(Hypotheses({(NONE,): 0.8, (OTHER,): 0.05, ("ageing",): 0.15}))
    assert found.probability == pytest.approx({(NONE,): 0.0, (OTHER,): 0.85, ("ageing",): 0.15})


def test_what_does_not_stand_alone_has_something_unknown_beside_it() -> None:
    found = hypotheses.with_other(Hypotheses({("ageing",): 0.6, ("ageing", OTHER): 0.1, ("clock_error",): 0.2, (NONE,): 0.1}))
    assert found.probability == pytest.approx({("ageing", OTHER): 0.7, ("clock_error", OTHER): 0.2, (NONE,): 0.1, (OTHER,): 0.0})


def test_beside_something_unknown_effects_are_believed_as_far_as_is_said() -> None:
    found = hypotheses.doubted(Hypotheses({("ageing", "clock_jitter", OTHER): 0.8, ("ageing", "clock_jitter"): 0.1, (OTHER,): 0.1}), frozenset({"clock_jitter"}), 0.25)
    assert found.probability[("ageing", "clock_jitter", OTHER)] == pytest.approx(0.2)
    assert found.probability[("clock_jitter", OTHER)] == pytest.approx(0.6)
    assert found.marginal("ageing") == pytest.approx(0.3)
    assert found.marginal("clock_jitter") == pytest.approx(0.9)
    assert found.other == pytest.approx(0.9)
    assert sum(found.probability.values()) == pytest.approx(1.0)


def test_what_something_unknown_may_be_instead_is_shared_with_it() -> None:
    before = Hypotheses({("ageing",): 0.5, ("ageing", "interference"): 0.3, ("interference",): 0.1, (NONE,): 0.06, (OTHER,): 0.04})
    after = hypotheses.shared_with_other(before, frozenset({"ageing"}), 0.4)
    assert after.probability == pytest.approx({("ageing",): 0.3, ("ageing", "interference"): 0.18, ("interference",): 0.1, (NONE,): 0.06,
                                               (OTHER,): 0.04 + 0.2, ("interference", OTHER): 0.12})
    both = hypotheses.shared_with_other(before, frozenset({"ageing", "interference"}), 0.4)
    assert both.probability == pytest.approx({**before.probability, ("ageing", "interference"): 0.18, (OTHER,): 0.04 + 0.12})
