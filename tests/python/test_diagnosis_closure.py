"""Closing an explanation on a twin whose answers are known: moments against every frame tried by dense algebra, values against scipy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from linear_bench import LinearBench, ridge, system_of
from scipy.optimize import least_squares

from wineglass.diagnosis.channels import Grid
from wineglass.diagnosis.closure import NEIGHBOURS, Closed, Closer, NoNumbersError
from wineglass.diagnosis.explain import Explained
from wineglass.diagnosis.responses import REACH, Column, Responses, Variant
from wineglass.diagnosis.unknowns import Unknown, settings_of, within_bounds
from wineglass.effects import Setting

SEED = 20
GRID = Grid(0.5, 4, 240)
NAMES = ("a", "b")
STEP, AGE, GAIN = ("damping_step", "damping"), ("ageing", "linear_rad_s_per_h"), ("pickoff_gain", "gain")
TYPICAL = {STEP: 0.02, AGE: 1e-4, GAIN: 0.005}
MOMENTS = 2.0 + 120.0 * (np.arange(10) + 0.5) / 10


def waves(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, channels, n) in floors."""
    return rng.standard_normal((count, len(NAMES), GRID.count)).cumsum(axis=2) / 5.0


class Made:
    """Two nuisances, a step at ten moments, at once or creeping, and two effects of all times; columns in floors per typical size."""

    def __init__(self, rng: np.random.Generator, known: float = 1.0):
        *self.known, self.step, self.age, self.gain = waves(rng, 5)
        self.known = [known * column for column in self.known]
        columns, values, variants = [Column("", None, f"known {i}", 1.0) for i in range(2)], list(self.known), {STEP[0]: [], AGE[0]: [], GAIN[0]: []}
        for moment in MOMENTS:
            for creep in (0.0, 30.0):
                shapes = {"time_s": float(moment), "creep_s": creep}
                columns.append(Column(STEP[0], Setting(STEP[0], {STEP[1]: TYPICAL[STEP], **shapes}), STEP[1], REACH))
                values.append(self.step * (self.begins() >= moment) * (1.0 if creep == 0.0 else 1.0 - np.exp(-np.maximum(self.begins() - moment, 0.0) / creep)))
                variants[STEP[0]].append(Variant(STEP[0], (len(columns) - 1,), shapes))
        for (effect, name), response in ((AGE, self.age), (GAIN, self.gain)):
            columns.append(Column(effect, Setting(effect, {name: TYPICAL[effect, name]}), name, REACH))
            values.append(response)
            variants[effect].append(Variant(effect, (len(columns) - 1,)))
        twin = {key: column / TYPICAL[key] for key, column in ((STEP, self.step), (AGE, self.age), (GAIN, self.gain))}
        self.bench = LinearBench(GRID, NAMES, twin)
        self.responses = Responses(NAMES, self.bench.nominal, tuple(columns), np.array(values), (0, 1), np.zeros(2), variants)

    @staticmethod
    def begins() -> np.ndarray:
        return GRID.time_s - 0.5 * GRID.frame_s

    def closer(self, data: np.ndarray) -> Closer:
        return Closer(self.bench, system_of(GRID, NAMES, data), self.responses, [0, 1])

    def start(self, *variants: Variant, strengths: tuple[float, ...]) -> Explained:
        """strengths: in typical sizes"""
        support = tuple(sorted({v.effect for v in variants}))
        return Explained(support, variants, 0.0, 0.0, np.zeros(2), np.array([0.0, 0.0, *(s / REACH for s in strengths)]))

    def at(self, moment: float, creep_s: float = 0.0) -> Variant:
        return next(v for v in self.responses.variants[STEP[0]] if v.shapes == {"time_s": moment, "creep_s": creep_s})


@pytest.fixture
def made() -> Made:
    return Made(np.random.default_rng(SEED))


# ---- when it happened -------------------------------------------------------------------------------------------------------------


def best_by_dense_algebra(made: Made, data: np.ndarray, low_s: float, high_s: float) -> tuple[float, float]:
    """Moment and strength (in typical sizes) that gain most under noise and nuisances written as one covariance, over all frames in between."""
    flat = np.array(made.known).reshape(2, -1)
    inverse = np.linalg.inv(np.eye(data.size) + flat.T @ flat)
    best = (0.0, 0.0, 0.0)
    for moment in made.begins()[(made.begins() >= low_s) & (made.begins() < high_s)]:
        column = (made.step * (made.begins() >= moment)).ravel()
        size, match = column @ inverse @ column, column @ inverse @ data.ravel()
        best = max(best, (0.5 * match**2 / size, float(moment), match / size))
    return best[1:]


@pytest.mark.parametrize("true_s", [33.0, 40.5, 45.5, 31.5])
def test_a_moment_between_those_tried_is_found(made: Made, true_s: float) -> None:
    """It lies within the stretches about the moment that the linear pass took; noise free the frame is found, and the strength."""
    data = 2.5 * made.step * (made.begins() >= true_s)
    taken = float(MOMENTS[np.argmin(np.abs(MOMENTS - true_s))])
    found = made.closer(data)._timed(made.start(made.at(taken), strengths=(1.0,)))
    assert found.variants[0].shapes == {"time_s": true_s, "creep_s": 0.0}
    assert found.coefficients[2] * REACH == pytest.approx(2.5, rel=1e-9)
    assert found.variants[0].effect == STEP[0] and len(found.coefficients) == 3


def test_in_noise_it_is_the_moment_that_gains_most_beside_what_is_uncertain(made: Made) -> None:
    rng = np.random.default_rng(SEED + 1)
    taken, found = 3, []
    for true_s in (30.0, 38.5, 44.0, 55.0):
        data = 1.5 * made.step * (made.begins() >= true_s) + 0.8 * made.known[0] - 1.1 * made.known[1] + rng.standard_normal((2, GRID.count))
        timed = made.closer(data)._timed(made.start(made.at(float(MOMENTS[taken])), strengths=(1.0,)))
        moment, strength = best_by_dense_algebra(made, data, float(MOMENTS[taken - NEIGHBOURS]), float(MOMENTS[taken + NEIGHBOURS]))
        assert timed.variants[0].shapes["time_s"] == moment
        assert timed.coefficients[2] * REACH == pytest.approx(strength, rel=1e-6)
        found.append(moment)
    assert len(set(found)) == 4, "the data decide"


def test_the_moment_counts_the_unit_from_where_the_bench_has_it(made: Made) -> None:
    """The bench stands two deviations off: its priors' middles lie that far back, which is as good as data moved by them."""
    rng = np.random.default_rng(SEED + 5)
    centre = np.array([2.0, -2.0])
    made.responses = replace(made.responses, centre=centre)
    made.known[:] = [0.02 * column for column in made.known]  # so weak that the priors say more than the data do
    made.responses.values[:2] = made.known
    data = 0.4 * made.step * (made.begins() >= 38.5) + rng.standard_normal((2, GRID.count))
    timed = made.closer(data)._timed(made.start(made.at(float(MOMENTS[3])), strengths=(1.0,)))
    moved = data + np.tensordot(centre, np.array(made.known), 1)
    moment, strength = best_by_dense_algebra(made, moved, float(MOMENTS[3 - NEIGHBOURS]), float(MOMENTS[3 + NEIGHBOURS]))
    assert timed.variants[0].shapes["time_s"] == moment
    assert timed.coefficients[2] * REACH == pytest.approx(strength, rel=1e-6)
    assert strength != pytest.approx(best_by_dense_algebra(made, data, float(MOMENTS[3 - NEIGHBOURS]), float(MOMENTS[3 + NEIGHBOURS]))[1], rel=1e-3)


@pytest.mark.parametrize(("place", "low_s", "high_s"), [(0, MOMENTS[0], MOMENTS[1]), (9, MOMENTS[8], 1e9)])
def test_the_first_and_the_last_moment_have_one_neighbour(made: Made, place: int, low_s: float, high_s: float) -> None:
    true_s = 0.5 * (max(low_s, 4.0) + min(high_s, 118.0))
    true_s = float(made.begins()[np.argmin(np.abs(made.begins() - true_s))])
    timed = made.closer(2.0 * made.step * (made.begins() >= true_s))._timed(made.start(made.at(float(MOMENTS[place])), strengths=(1.0,)))
    assert timed.variants[0].shapes["time_s"] == true_s


def test_what_creeps_what_always_acts_and_what_is_not_alone_stays(made: Made) -> None:
    closer = made.closer(2.0 * made.step * (made.begins() >= 33.0))
    age = made.responses.variants[AGE[0]][0]
    for start in (made.start(made.at(float(MOMENTS[2]), 30.0), strengths=(1.0,)), made.start(age, strengths=(1.0,)),
                  made.start(made.at(float(MOMENTS[2])), age, strengths=(1.0, 1.0))):
        assert closer._timed(start) is start


def test_where_no_moment_gains_anything_the_start_stays(made: Made) -> None:
    start = made.start(made.at(float(MOMENTS[2])), strengths=(1.0,))
    assert made.closer(np.zeros((2, GRID.count)))._timed(start) is start


# ---- values ---------------------------------------------------------------------------------------------------------------------


def test_strengths_are_the_ridge_solution(made: Made) -> None:
    rng = np.random.default_rng(SEED + 2)
    data = 1.2 * made.age - 0.7 * made.gain + 0.5 * made.known[0] + rng.standard_normal((2, GRID.count))
    age, gain = made.responses.variants[AGE[0]][0], made.responses.variants[GAIN[0]][0]
    closed = made.closer(data).close(made.start(age, gain, strengths=(0.3, 0.3)))
    expected = ridge(np.array([*made.known, REACH * made.age, REACH * made.gain]), data)[2:] * REACH
    assert [u.effect for u in closed.unknowns] == [AGE[0], GAIN[0]]
    assert closed.values / [TYPICAL[AGE], TYPICAL[GAIN]] == pytest.approx(expected, rel=2e-3)
    assert closed.possible and closed.support == (AGE[0], GAIN[0])
    assert closed.response == pytest.approx(np.tensordot(closed.values / [TYPICAL[AGE], TYPICAL[GAIN]], np.array([made.age, made.gain]), 1), rel=1e-9)


def test_without_one_effect_the_other_moves_to_its_own_best(made: Made) -> None:
    data = 1.2 * made.age - 0.7 * made.gain
    age, gain = made.responses.variants[AGE[0]][0], made.responses.variants[GAIN[0]][0]
    closer = made.closer(data)
    both = closer.close(made.start(age, gain, strengths=(1.0, 1.0)))
    alone = closer.without(both, GAIN[0])
    expected = ridge(np.array([*made.known, REACH * made.age]), data)[2] * REACH
    assert alone.support == (AGE[0],) and [v.effect for v in alone.variants] == [AGE[0]]
    assert alone.values[0] / TYPICAL[AGE] == pytest.approx(expected, rel=2e-3)
    assert closer.cost_of(alone) > closer.cost_of(both)


def test_beside_begins_with_both_and_ends_at_the_best_of_both(made: Made) -> None:
    data = 1.2 * made.age - 0.7 * made.gain
    age, gain = made.responses.variants[AGE[0]][0], made.responses.variants[GAIN[0]][0]
    closer = made.closer(data)
    closed = closer.beside(closer.close(made.start(age, strengths=(1.0,))), made.start(gain, strengths=(0.2,)))
    expected = ridge(np.array([*made.known, REACH * made.age, REACH * made.gain]), data)[2:] * REACH
    assert closed.support == (AGE[0], GAIN[0])
    assert closed.values / [TYPICAL[AGE], TYPICAL[GAIN]] == pytest.approx(expected, rel=2e-3)


def test_the_cost_is_that_of_all_numbers_fitted_together(made: Made) -> None:
    """Half of what bounded least squares over nuisances and strength leaves, the priors' rows included."""
    rng = np.random.default_rng(SEED + 3)
    data = 0.9 * made.age + 0.4 * made.known[1] + rng.standard_normal((2, GRID.count))
    closer = made.closer(data)
    closed = closer.close(made.start(made.responses.variants[AGE[0]][0], strengths=(1.0,)))
    columns = np.array([*made.known, REACH * made.age]).reshape(3, -1)
    reference = least_squares(lambda c: np.concatenate([data.ravel() - c @ columns, c]), np.zeros(3))
    assert closer.cost_of(closed) == pytest.approx(reference.cost, rel=1e-6)


def test_a_strength_beyond_what_is_possible_stands_at_its_bound(made: Made) -> None:
    bound = -0.5  # of pickoff_gain: a hundred typical sizes
    data = 200.0 * bound / TYPICAL[GAIN] * made.gain
    closed = made.closer(data).close(made.start(made.responses.variants[GAIN[0]][0], strengths=(-50.0,)))
    assert closed.values[0] == bound and not closed.possible


def test_values_within_bounds_and_settings() -> None:
    unknowns = [Unknown("ageing", "linear_rad_s_per_h", "strength", 0.0, 0.0, 1e-3, -0.1, 0.1),
                Unknown("ageing", "time_constant_s", "shape", 60.0, 60.0, 60.0, 0.1, 1e6)]
    assert within_bounds(unknowns, np.array([0.3, 0.01])) == pytest.approx([0.1, 0.1])
    assert settings_of(unknowns, np.array([0.3, 70.0])) == [Setting("ageing", {"linear_rad_s_per_h": 0.1, "time_constant_s": 70.0})]
    split = [Unknown("frequency_split", "split_hz", role, 0.0, 0.0, 0.1, 0.0, 100.0) for role in ("cosine", "sine")]
    (setting,) = settings_of(split, np.array([0.0, 0.03]))
    assert setting.values == pytest.approx({"split_hz": 0.03, "axis_deg": 45.0})
    assert within_bounds(split, np.array([-5.0, 5.0])) == pytest.approx([-5.0, 5.0]), "a component of a direction may be negative"


def test_impossible_needs_a_strength_at_its_end(made: Made) -> None:
    closed = made.closer(made.age).close(made.start(made.responses.variants[AGE[0]][0], strengths=(1.0,)))
    strength = closed.unknowns[0]
    assert closed.possible
    assert not replace_values(closed, np.array([strength.high])).possible
    assert replace_values(closed, np.array([0.0])).possible


def replace_values(closed: Closed, values: np.ndarray) -> Closed:
    return Closed(closed.support, closed.variants, closed.unknowns, values, closed.jacobian, closed.response, replace(closed.products), closed.runs)


def test_what_creeps_in_the_linear_pass_is_tried_as_a_step(made: Made) -> None:
    """A step between two moments looks like creeping to both; closed, it is the step."""
    data = 2.5 * made.step * (made.begins() >= 40.5)
    creeping = next(v for v in made.responses.variants[STEP[0]] if v.shapes["creep_s"] > 0.0)
    sudden = made.closer(data)._sudden(made.start(creeping, strengths=(1.0,)))
    assert [start.variants[0].shapes["creep_s"] for start in sudden] == [0.0]
    assert made.closer(data)._sudden(made.start(made.at(float(MOMENTS[3])), strengths=(1.0,))) == []


def test_responses_beyond_numbers_are_refused_and_not_weighed(made: Made) -> None:
    data = 2.5 * made.step * (made.begins() >= 40.5)
    made.responses.values[2:] *= 1e200
    with np.errstate(all="ignore"), pytest.raises(NoNumbersError):
        made.closer(data).close(made.start(made.at(float(MOMENTS[3])), strengths=(1.0,)))
