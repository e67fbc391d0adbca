"""Where the twins stand, on a twin that is linear but for what a test bends: the unit's place against least squares, and steps that are not confirmed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from linear_bench import LinearBench, ridge, system_of, uncertainties

from wineglass.diagnosis import responses, standing
from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.standing import Standing
from wineglass.diagnosis.system import System
from wineglass.diagnosis.unknowns import Unknown
from wineglass.effects import Setting

GRID = Grid(0.5, 0, 240)
NAMES = ("a", "b")
AGE = ("ageing", "linear_rad_s_per_h")
SPREAD = 1e-3
OFF = np.array([0.9, -0.6, 0.3])


@dataclass(frozen=True)
class Judge:
    """Recorded minus whatever frames are given, in floors."""

    recorded: np.ndarray

    @property
    def pick(self) -> list[int]:
        return [0, 1]

    def system(self, bench: LinearBench, base: Frames) -> System:
        return system_of(GRID, NAMES, self.recorded - base.values)


class Made:
    """Three uncertain values and one effect; columns (2, n), some fifty floors large."""

    def __init__(self, seed: int = 9):
        rng = np.random.default_rng(seed)
        t = GRID.time_s
        self.known = [50.0 * np.vstack([np.sin((i + 1) * t / 20.0 + i), np.cos((i + 2) * t / 30.0)]) for i in range(3)]
        self.effect = 40.0 * np.vstack([t / 120.0, (t / 120.0) ** 2])
        self.noise = rng.standard_normal((2, GRID.count))
        self.bench = LinearBench(GRID, NAMES, {AGE: self.effect / SPREAD}, [(f"known {i}", column) for i, column in enumerate(self.known)])
        self.unknown = Unknown(*AGE, "strength", 0.0, 0.0, SPREAD, -0.1, 0.1)

    def of_unit(self, off: np.ndarray) -> np.ndarray:
        return np.tensordot(off, np.array(self.known), 1)

    def with_effect(self, strength: float) -> Standing:
        """strength: in spreads"""
        return Standing(self.bench, [self.unknown], np.array([strength * SPREAD]), self.effect[None] / SPREAD)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Made:
    monkeypatch.setattr(responses, "uncertainties", uncertainties)
    return Made()


def test_the_envelope_alone_finds_the_unit(made: Made) -> None:
    recorded = made.of_unit(OFF) + made.noise
    there, frames = standing.roughly(Standing(made.bench), Judge(recorded))
    assert there.bench.unit.off == pytest.approx(ridge(np.array(made.known), recorded), abs=2e-4)
    assert frames.values == pytest.approx(made.of_unit(there.bench.unit.off), abs=1e-9)
    assert np.all(made.bench.unit.off == 0.0), "the bench it came from stays"


def test_an_effect_and_the_unit_move_together(made: Made) -> None:
    recorded = made.of_unit(OFF) + 1.3 * made.effect + made.noise
    there, frames = standing.roughly(made.with_effect(0.2), Judge(recorded))
    expected = ridge(np.array([*made.known, made.effect]), recorded)
    assert there.bench.unit.off == pytest.approx(expected[:3], abs=3e-4)
    assert there.values[0] / SPREAD == pytest.approx(expected[3], abs=3e-4)
    assert there.off[0] == pytest.approx(there.values[0] / SPREAD)
    (setting,) = there.settings
    assert (setting.id, setting.values) == (AGE[0], {AGE[1]: pytest.approx(there.values[0])})
    assert frames.values == pytest.approx(made.of_unit(there.bench.unit.off) + there.off[0] * made.effect, abs=1e-9)


def test_what_gains_too_little_is_not_moved(made: Made) -> None:
    recorded = made.of_unit(0.02 * OFF) + made.noise
    there, _ = standing.roughly(Standing(made.bench), Judge(recorded))
    assert np.all(there.bench.unit.off == 0.0)


def test_energy_left_is_that_of_the_best_unit_within_its_tolerances(made: Made) -> None:
    """A unit that is on its way is not blamed for the rest of it; a gap that no unit makes is left whole."""
    gap = 5.0 * np.vstack([np.sign(np.sin(GRID.time_s)), 0.0 * GRID.time_s])
    recorded = made.of_unit(OFF) + made.noise + gap
    left = standing.energy_left(Standing(made.bench), Judge(recorded), made.bench.frames())
    fitted = np.tensordot(ridge(np.array(made.known), recorded), np.array(made.known), 1)
    assert left == pytest.approx(np.mean((recorded - fitted) ** 2, axis=1), rel=1e-6)
    assert left[0] > 20.0 and left[1] < 1.3


def test_no_unit_is_farther_than_its_tolerances_allow(made: Made) -> None:
    from wineglass.diagnosis.unit import FARTHEST

    recorded = made.of_unit(np.array([3.0 * FARTHEST, 0.0, 0.0]))
    left = standing.energy_left(Standing(made.bench), Judge(recorded), made.bench.frames())
    assert float(np.sum(left)) > 0.5 * float(np.sum(np.mean((2.0 * FARTHEST * made.known[0]) ** 2, axis=1)))


def test_frames_are_carried_between_with_and_without_effects_and_units(made: Made) -> None:
    rng = np.random.default_rng(2)
    frames = Frames(GRID, ("b", "other", "a"), rng.standard_normal((3, GRID.count)), rng.random((3, GRID.count)) > 0.2)
    before = frames.values.copy()
    with_them = standing.with_effects(made.with_effect(0.7), frames)
    for name, row in zip(NAMES, 0.7 * made.effect, strict=True):
        assert with_them[name] == pytest.approx(frames[name] + row, abs=1e-9)
    assert np.array_equal(with_them["other"], frames["other"]) and np.array_equal(with_them.use, frames.use)
    assert standing.without_effects(made.with_effect(0.7), with_them).values == pytest.approx(before, abs=1e-9)
    other = made.bench.at(made.bench.unit.toward(OFF), 0.0)
    moved = standing.at_bench(Standing(made.bench), frames, other)
    for name, row in zip(NAMES, made.of_unit(OFF), strict=True):
        assert moved[name] == pytest.approx(frames[name] + row, abs=1e-9)
    assert np.array_equal(frames.values, before)


# ---- the full twin --------------------------------------------------------------------------------------------------------------


def full(monkeypatch: pytest.MonkeyPatch, of: object) -> list[np.ndarray]:
    """The full twin's frames are of(off, effects); the list fills with the units it was asked for."""
    asked: list[np.ndarray] = []

    def run(driven: None, grid: Grid, effects: Sequence[Setting] = (), truth: np.ndarray | None = None) -> Frames:
        assert truth is not None
        asked.append(truth)
        values = of(truth, effects)  # type: ignore[operator]
        return Frames(grid, NAMES, values, np.ones_like(values, bool))

    monkeypatch.setattr(standing, "full_twin", run)
    return asked


def test_the_full_twin_has_the_last_word(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    """It bends: the envelope's slopes lead near, and its own frames the rest of the way."""

    def bent(off: np.ndarray, effects: Sequence[Setting]) -> np.ndarray:
        return made.of_unit(off + 0.05 * off**2)

    asked = full(monkeypatch, bent)
    recorded = bent(OFF, ()) + made.noise
    found = standing.exactly(Standing(made.bench), Judge(recorded))
    there, frames = found.standing, found.frames
    assert there.bench.unit.off == pytest.approx(OFF, abs=0.01)
    assert float(np.mean((recorded - frames.values) ** 2)) < 1.1 * float(np.mean(made.noise**2))
    assert 2 <= len(asked) <= 4
    by_envelope = ridge(np.array(made.known), recorded)
    assert float(np.max(np.abs(by_envelope - OFF))) > 0.03, "the envelope alone would have been wrong"


def test_a_step_that_the_full_twin_does_not_confirm_is_taken_back(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    """It goes the other way from where the envelope says."""
    full(monkeypatch, lambda off, effects: made.of_unit(-off))
    recorded = made.of_unit(OFF) + made.noise
    found = standing.exactly(Standing(made.bench), Judge(recorded))
    there, frames = found.standing, found.frames
    assert np.all(there.bench.unit.off == 0.0)
    assert np.all(frames.values == 0.0)


def test_it_is_known_where_the_full_twin_was_run_last(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = full(monkeypatch, lambda off, effects: made.of_unit(off + 0.05 * off**2))
    found = standing.exactly(Standing(made.bench), Judge(made.of_unit(OFF) + made.noise))
    there, frames = found.ran
    assert np.array_equal(there.bench.unit.off, asked[-1])
    assert np.array_equal(frames.values, made.of_unit(asked[-1] + 0.05 * asked[-1] ** 2))


def test_what_no_unit_explains_gets_one_run(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = full(monkeypatch, lambda off, effects: made.of_unit(off + 0.05 * off**2))
    recorded = made.of_unit(OFF) + made.noise + 100.0 * np.random.default_rng(3).standard_normal(made.noise.shape)
    standing.exactly(Standing(made.bench), Judge(recorded), hopeless=30.0)
    assert len(asked) == 1
