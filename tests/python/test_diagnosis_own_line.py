"""The device's own line: its phase against integrals in closed form, and what is left of signals that are known apart from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from wineglass.diagnosis import own_line

RATE_HZ = 50.0


@dataclass(frozen=True)
class Tap:
    """As much of a tap as the line needs."""

    channels: dict[str, np.ndarray]
    sample_rate_hz: float = RATE_HZ

    @property
    def length(self) -> int:
        return len(next(iter(self.channels.values())))

    def __contains__(self, name: object) -> bool:
        return name in self.channels

    def __getitem__(self, name: str) -> np.ndarray:
        return self.channels[name]


def time_of(n: int) -> np.ndarray:
    return np.arange(n) / RATE_HZ


def line(turns: np.ndarray, size: float, at: float) -> np.ndarray:
    return size * np.cos(2.0 * np.pi * (turns + at))


def test_the_phase_is_twice_the_integral_of_the_frequency() -> None:
    t = time_of(400)
    assert own_line.phase(Tap({"drive_frequency": np.full(400, 4001.25)})) == pytest.approx(2.0 * 4001.25 * t, rel=1e-12)
    ramp = 4000.0 + 3.0 * t
    assert own_line.phase(Tap({"drive_frequency": ramp})) == pytest.approx(8000.0 * t + 3.0 * t**2, rel=1e-12)


def test_lost_samples_of_the_frequency_are_bridged() -> None:
    t = time_of(400)
    ramp = 4000.0 + 3.0 * t
    ramp[[20, 21, 22, 250]] = np.nan
    assert own_line.phase(Tap({"drive_frequency": ramp})) == pytest.approx(8000.0 * t + 3.0 * t**2, rel=1e-12)


@pytest.mark.parametrize("channels", [
    {"primary_in_phase": np.zeros(40)}, {"drive_frequency": np.full(1, 4000.0)}, {"drive_frequency": np.full(40, np.nan)},
    {"drive_frequency": np.where(np.arange(40) == 3, 4000.0, np.nan)},
])
def test_without_a_frequency_there_is_no_phase(channels: dict[str, np.ndarray]) -> None:
    assert own_line.phase(Tap(channels)) is None


@pytest.mark.parametrize("n", [400, 530, 201, 100, 17])  # whole windows of 200, a rest, one and a bit, less than one
def test_the_line_goes_and_what_moves_slowly_stays(n: int) -> None:
    """Its frequency wanders, as the resonator's does; a parabola beside it is left as it was."""
    t = time_of(n)
    tap = Tap({"drive_frequency": 4003.7 + 0.05 * t})
    turns = own_line.phase(tap)
    assert turns is not None
    slow = 0.8 + 0.01 * t - 0.002 * t**2
    assert own_line.removed(tap, slow + line(turns, 3e-3, 0.17), turns) == pytest.approx(slow, abs=1e-12)


def test_the_input_is_not_changed() -> None:
    turns = 2.0 * 4003.7 * time_of(400)
    values = line(turns, 1.0, 0.1)
    before = values.copy()
    own_line.removed(Tap({}), values, turns)
    assert np.array_equal(values, before)


def test_noise_is_left_alone() -> None:
    """A line that is no clear one is not fitted to noise: a fit would always take a little of it."""
    rng = np.random.default_rng(7)
    turns = 2.0 * 4003.7 * time_of(1000)
    values = rng.standard_normal(1000)
    assert np.array_equal(own_line.removed(Tap({}), values, turns), values)


def test_a_clear_line_goes_from_noise_but_for_what_two_numbers_cost() -> None:
    rng = np.random.default_rng(8)
    turns = 2.0 * 4003.7 * time_of(4000)
    noise = rng.standard_normal(4000)
    left = own_line.removed(Tap({}), noise + line(turns, 4.0, 0.3), turns)
    lost = float(np.mean((left - noise) ** 2))  # two of 200 numbers in every window: a hundredth of the noise, give or take its own scatter
    assert 0.005 < lost < 0.02


@pytest.mark.parametrize(("folded_hz", "goes"), [(2.9, False), (-2.9, False), (3.1, True), (-3.1, True)])
def test_a_line_that_folds_near_to_zero_stays(folded_hz: float, goes: bool) -> None:
    turns = (8000.0 + folded_hz) * time_of(400)  # 8000 Hz are whole turns from sample to sample
    values = line(turns, 1.0, 0.1)
    left = own_line.removed(Tap({}), values, turns)
    assert float(np.max(np.abs(left))) < 1e-9 if goes else np.array_equal(left, values)


def test_lost_samples_stay_lost_and_spoil_nothing() -> None:
    turns = 2.0 * 4003.7 * time_of(400)
    values = 0.5 + line(turns, 1.0, 0.1)
    values[[3, 50, 51, 399]] = np.nan
    left = own_line.removed(Tap({}), values, turns)
    assert np.array_equal(np.isnan(left), np.isnan(values))
    assert left[np.isfinite(left)] == pytest.approx(0.5, abs=1e-9)


def test_a_window_with_hardly_a_sample_is_left() -> None:
    turns = 2.0 * 4003.7 * time_of(200)
    values = np.where(np.arange(200) < 11, line(turns, 1.0, 0.1), np.nan)
    assert np.array_equal(own_line.removed(Tap({}), values, turns), values, equal_nan=True)
