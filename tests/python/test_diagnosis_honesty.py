"""Synthetic gyros with known truth, made by other formulas than the diagnosis fits: nulls, single effects, pairs, and what no catalogue knows.

The seeds are fixed here; `WINEGLASS_SEED` adds to them.
"""

import os
from dataclasses import replace

import diagnosis_synthetic as synthetic
import numpy as np
import pytest

from wineglass.diagnosis.rate_level import analyse
from wineglass.diagnosis.verdict import decide, diagnose

SEED = int(os.environ.get("WINEGLASS_SEED", "0"))
SIZE = 8e-3


def outcome(signals, seed, profile, markov=0.5):
    evidence = synthetic.make(signals, SEED + seed, profile, markov)
    print(evidence.source)
    found = analyse(evidence)
    return decide(found), found, evidence


@pytest.mark.parametrize("seed, profile, markov", [
    (1, synthetic.one_cycle, 0.0), (2, synthetic.one_cycle, 1.0), (3, synthetic.two_cycles, 0.3), (4, synthetic.two_cycles, 1.0)])
def test_nulls_have_no_gap(seed, profile, markov):
    found, analysis, evidence = outcome([], seed, profile, markov)
    assert found.verdict == "no_gap"
    diagnosis = diagnose(evidence, analysis)
    assert diagnosis.shrink.channels[0].fraction is None and not diagnosis.effects and not diagnosis.where


@pytest.mark.parametrize("signal, truth", [
    (synthetic.lag, "thermometer_lag"), (synthetic.drift, "ageing"), (synthetic.gradient, "thermal_gradient"),
    (synthetic.hysteresis, "thermal_hysteresis")])
def test_two_cycles_at_different_speeds_name_the_effect(signal, truth):
    found, analysis, evidence = outcome([signal(SIZE)], 21, synthetic.two_cycles)
    assert (truth,) in found.named, found
    diagnosis = diagnose(evidence, analysis)
    assert diagnosis.shrink.all.fraction > 0.5
    effect = next(e for e in diagnosis.effects if e.id == truth)
    assert effect.stage in [w.stage for w in diagnosis.where]


@pytest.mark.parametrize("signals, truth", [
    ([synthetic.hysteresis(SIZE)], {"thermal_hysteresis"}), ([synthetic.lag(SIZE), synthetic.drift(SIZE)], {"thermometer_lag", "ageing"})])
def test_one_cycle_names_the_family_and_asks_for_a_second(signals, truth):
    found, analysis, evidence = outcome(signals, 31, synthetic.one_cycle)
    assert found.verdict == "ambiguous" and truth in [set(ids) for ids in found.named], found
    assert "second thermal cycle" in diagnose(evidence, analysis).next_experiment.run


@pytest.mark.parametrize("signal, seed", [(synthetic.humps, 41), (synthetic.humps, 42), (synthetic.steps, 43)])
def test_what_no_catalogue_knows_is_not_blamed_on_an_effect(signal, seed):
    found, _, _ = outcome([signal(SIZE / 3)], seed, synthetic.two_cycles)
    assert found.verdict in ("unknown", "ambiguous"), found


def test_confidence_goes_with_what_is_left():
    """A drift of another shape keeps its name; waves in time, of which every effect leaves most, are something else."""
    _, drifting, _ = outcome([synthetic.drift(SIZE)], 21, synthetic.two_cycles)
    assert drifting.posterior.marginal("ageing") > 0.7 and drifting.posterior.other < 0.2
    _, waving, _ = outcome([synthetic.humps(SIZE / 3)], 42, synthetic.two_cycles)
    assert waving.posterior.other > 0.6
    assert all(waving.posterior.marginal(name) < 0.4 for name in waving.design.effects)


def test_belief_falls_with_effects_and_with_what_they_leave():
    from wineglass.diagnosis.probabilities import HeldOut, Leftover

    sets = [("ageing",), ("ageing", "thermometer_lag"), ("ageing", "thermal_gradient", "thermometer_lag")]
    left = {(): 1.0, **{ids: 0.01 for ids in sets}, ("thermal_gradient",): 0.5}
    held = {ids: HeldOut(value, 0.0) for ids, value in left.items()}
    leftover = Leftover(left, held, floor=0.01, threshold=0.02)
    beliefs = [leftover.belief(ids, 1.0) for ids in sets]
    assert beliefs[0] > 0.9 > beliefs[1] > 0.8 > 0.5 > beliefs[2]
    assert leftover.belief(("thermal_gradient",), 1.0) < beliefs[0] - 0.1
    assert Leftover(left, held, 0.01, 0.02, one_branch=True).belief(sets[0], 1.0) < beliefs[0]


def test_an_effect_out_of_the_catalogue_is_not_replaced_with_confidence():
    evidence = synthetic.make([synthetic.drift(SIZE)], SEED + 51, synthetic.two_cycles)
    found = decide(analyse(evidence, without=frozenset({"ageing"})))
    assert found.verdict in ("unknown", "ambiguous"), found


@pytest.mark.parametrize("error, verdict, named", [
    (lambda rate, degc: 3e-3 * rate, "ambiguous", {"coriolis_gain", "rate_reference"}),
    (lambda rate, degc: 3e-5 * rate * (degc - 25.0), "attributed", {"coriolis_gain"})])
def test_a_constant_gain_may_be_the_tables_a_slope_over_temperature_is_the_gyros(error, verdict, named):
    still = synthetic.make([], SEED + 71, synthetic.two_cycles)
    turning = np.array([0.3, -0.3, 0.0])[(still.time_s // 200).astype(int) % 3]
    evidence = replace(still, true_rate_rad_s=turning, rate_rad_s=still.rate_rad_s + turning + error(turning, still.temperature_degc))
    found = decide(analyse(evidence))
    assert found.verdict == verdict and {e for ids in found.named for e in ids} == named, found


def test_one_branch_is_insufficient_without_a_calibration():
    whole = synthetic.make([], SEED + 61)
    half = slice(1300, 2600)
    rising = replace(whole, time_s=whole.time_s[half], temperature_degc=whole.temperature_degc[half], rate_rad_s=whole.rate_rad_s[half])
    found = analyse(rising)
    diagnosis = diagnose(rising, found)
    assert diagnosis.verdict == "insufficient" and diagnosis.next_experiment is not None
