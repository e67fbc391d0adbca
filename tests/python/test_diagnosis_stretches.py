"""What comes and goes, on a twin whose answers are known: stretches against those that the data were made with, and the search against trying everything."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from linear_bench import LinearBench, system_of

from wineglass.diagnosis import stretches
from wineglass.diagnosis.channels import Grid
from wineglass.diagnosis.closure import Closed, Closer
from wineglass.diagnosis.responses import Column, Responses, Variant
from wineglass.diagnosis.unknowns import Unknown
from wineglass.effects import Setting

SEED = 26
GRID = Grid(0.24, 10, 2400)
NAMES = ("a", "b")
BIAS, LOSS, GAIN = ("vibration", "rectified_rad_s"), ("damping_step", "damping"), ("pickoff_gain", "gain")
TYPICAL = {BIAS: 2e-5, LOSS: 0.02, GAIN: 0.005}


class Made:
    """Constants, time and its square are uncertain; a bias and a loss that vary slowly, in floors per typical size; a gain that is somewhere in between."""

    def __init__(self, seed: int):
        self.rng = np.random.default_rng(seed)
        time = np.linspace(-1.0, 1.0, GRID.count)
        known = [np.vstack([row if i == channel else 0.0 * row for i in range(2)]) for channel in range(2) for row in (np.ones(GRID.count), time, time**2)]
        slow = {key: np.outer(shares, 1.0 + 0.3 * np.sin(3.0 * time + phase)) for key, shares, phase in
                ((BIAS, (5.0, 1.0), 0.0), (LOSS, (0.5, 3.0), 1.0), (GAIN, (2.0, -2.0), 2.0))}
        self.bench = LinearBench(GRID, NAMES, {key: row / TYPICAL[key] for key, row in slow.items()}, [(f"known {i}", row) for i, row in enumerate(known)])
        self.known = np.array(known)

    def closer(self, settings: list[Setting]) -> Closer:
        nuisance = self.rng.standard_normal(len(self.known))
        data = self.bench.tried(settings) + np.tensordot(nuisance, self.known, 1) + self.rng.standard_normal((2, GRID.count))
        columns = tuple(Column("", None, name, 1.0) for name, _ in self.bench.known)
        variants = {effect: [Variant(effect, ())] for effect, _ in TYPICAL}
        responses = Responses(NAMES, self.bench.nominal, columns, self.known, tuple(range(len(columns))), np.zeros(len(columns)), variants)
        return Closer(self.bench, system_of(GRID, NAMES, data), responses, [0, 1])


def shaken(size: float, *found: tuple[float, float]) -> Setting:
    """size: in typical sizes; found: beginnings and durations"""
    times = {name: value for i, one in enumerate(found, 1) for name, value in zip((f"begin_{i}_s", f"lasts_{i}_s"), one, strict=True)}
    return Setting(BIAS[0], {BIAS[1]: size * TYPICAL[BIAS], **times})


def lossy(size: float, time_s: float, lasts_s: float) -> Setting:
    return Setting(LOSS[0], {LOSS[1]: size * TYPICAL[LOSS], "time_s": time_s, "lasts_s": lasts_s})


def found_beside(closer: Closer, closed: Closed, effect: str) -> Closed | None:
    return next((one for one in stretches.beside(closer, closed) if effect in one.support), None)


STRETCHES = [
    ((100.0, 40.0),),
    ((60.07, 48.0), (300.01, 48.0)),
    ((90.0, 48.0), (150.0, 48.0), (330.0, 48.0), (480.1, 48.0)),
    ((40.0, 30.0), (92.0, 30.0), (150.0, 30.0), (500.0, 12.0)),  # near each other: one long stretch explains most, and is taken apart
]


@pytest.mark.parametrize("truth", STRETCHES, ids=lambda truth: f"{len(truth)} from {truth[0][0]:g} s")
@pytest.mark.parametrize("seed", [SEED, SEED + 1, SEED + 2])
def test_stretches_are_found_to_a_part_of_a_frame(truth, seed):
    closer = Made(seed).closer([shaken(3.0, *truth)])
    found = found_beside(closer, closer.nothing(), BIAS[0])
    assert found is not None, f"seed {seed}"
    values = found.settings[0].values
    assert values[BIAS[1]] == pytest.approx(3.0 * TYPICAL[BIAS], rel=0.02), f"seed {seed}"
    for i, (begin, lasts) in enumerate(truth, 1):
        assert values[f"begin_{i}_s"] == pytest.approx(begin, abs=0.1), f"seed {seed}"
        assert values[f"begin_{i}_s"] + values[f"lasts_{i}_s"] == pytest.approx(begin + lasts, abs=0.1), f"seed {seed}"
    assert len(values) == 1 + 2 * len(truth), f"seed {seed}"


@pytest.mark.parametrize("seed", [SEED + 3, SEED + 4])
def test_a_loss_that_comes_and_goes_is_found_beside_another_effect(seed):
    gain = Setting(GAIN[0], {GAIN[1]: 4.0 * TYPICAL[GAIN]})
    closer = Made(seed).closer([gain, lossy(-2.0, 210.1, 77.0)])
    unknown = Unknown(*GAIN, "strength", 0.0, 0.0, 10.0 * TYPICAL[GAIN], -1.0, 1.0)
    alone = closer.grown(closer.nothing(), (Variant(GAIN[0], ()),), [unknown], closer.bench.columns[GAIN][None])
    found = found_beside(closer, alone, LOSS[0])
    assert found is not None and found.support == (LOSS[0], GAIN[0]), f"seed {seed}"
    values = {setting.id: setting.values for setting in found.settings}
    assert values[GAIN[0]][GAIN[1]] == pytest.approx(gain.values[GAIN[1]], rel=0.05), f"seed {seed}"  # mostly a constant, which is uncertain
    assert values[LOSS[0]] == pytest.approx({LOSS[1]: -2.0 * TYPICAL[LOSS], "time_s": 210.1, "lasts_s": 77.0}, rel=0.02), f"seed {seed}"


def test_a_loss_that_was_taken_for_one_that_stays_comes_and_goes_instead():
    for seed in (SEED + 5, SEED + 6):
        closer = Made(seed).closer([lossy(3.0, 210.1, 77.0)])
        unknown = Unknown(*LOSS, "strength", 0.0, 0.0, 10.0 * TYPICAL[LOSS], -1.0, 1.0)
        stays = closer.grown(closer.nothing(), (Variant(LOSS[0], ()),), [unknown], closer.bench.columns[LOSS][None])
        found = found_beside(closer, stays, LOSS[0])
        assert found is not None and found.support == (LOSS[0],), f"seed {seed}"
        assert found.settings[0].values == pytest.approx({LOSS[1]: 3.0 * TYPICAL[LOSS], "time_s": 210.1, "lasts_s": 77.0}, rel=0.02), f"seed {seed}"
        assert all(one.effect != LOSS[0] for one in stretches.able(found)), f"seed {seed}"


def test_nothing_comes_and_goes_in_noise_and_what_always_acts_does_not():
    for seed in range(SEED + 10, SEED + 40):
        closer = Made(seed).closer([])
        assert stretches.beside(closer, closer.nothing()) == [], f"seed {seed}"
    closer = Made(SEED + 50).closer([Setting(BIAS[0], {BIAS[1]: 5.0 * TYPICAL[BIAS]})])
    assert found_beside(closer, closer.nothing(), BIAS[0]) is None


def test_what_comes_and_goes_more_often_is_something_else():
    """A bias that jumps between two values every 20 s, as no effect of the catalogue does: a part of it is like four stretches."""
    for seed in range(SEED + 60, SEED + 65):
        made = Made(seed)
        on = np.cumsum(made.rng.random(GRID.count) < GRID.frame_s / 20.0) % 2
        closer = made.closer([])
        jumping = closer.system.data + 5.0 * TYPICAL[BIAS] * on * made.bench.columns[BIAS]
        closer = Closer(made.bench, system_of(GRID, NAMES, jumping), closer.responses, [0, 1])
        assert stretches.beside(closer, closer.nothing()) == [], f"seed {seed}"


# ---- the search -----------------------------------------------------------------------------------------------------------------


CELLS = 9
EDGES = np.arange(CELLS + 1)


def gain_of(gram: np.ndarray, match: np.ndarray, mask: np.ndarray) -> float:
    size = float(mask @ gram @ mask)
    return 0.5 * float(mask @ match) ** 2 / size if size > 0.0 else 0.0


def random_sums(seed: int):
    """Gram matrix and match of an effect cut into cells, fifty times anew."""
    rng = np.random.default_rng(seed)
    for _ in range(50):
        rows = rng.standard_normal((CELLS, 20))
        yield rows @ rows.T, 10.0 * rng.standard_normal(CELLS)


def assert_best(found, gain: float, every: dict, where: str):
    assert gain == pytest.approx(max(every.values()), rel=1e-9), where
    assert every[found] == pytest.approx(gain, rel=1e-9), where


def test_the_best_stretch_beside_others_is_the_best_of_all():
    others = [(3, 5)]
    taken = stretches._mask(EDGES, others, CELLS)
    free = [(a, b) for a, b in combinations(range(CELLS + 1), 2) if b < 3 or a > 5]
    for gram, match in random_sums(SEED + 70):
        found, gain = stretches._Sums(gram, match).best(others)
        every = {one: gain_of(gram, match, taken + stretches._mask(EDGES, [one], CELLS)) for one in free}
        assert_best(tuple(found), gain, every, f"seed {SEED + 70}")


def test_the_best_gap_within_a_stretch_is_the_best_of_all():
    for gram, match in random_sums(SEED + 80):
        parts, gain = stretches._Sums(gram, match).split([(1, 8)])
        every = {((1, a), (b, 8)): gain_of(gram, match, stretches._mask(EDGES, [(1, a), (b, 8)], CELLS)) for a, b in combinations(range(2, 8), 2)}
        assert_best(tuple(parts), gain, every, f"seed {SEED + 80}")
