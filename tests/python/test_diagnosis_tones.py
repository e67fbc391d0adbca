"""Lines taken out of channels: closed-form tones over closed-form motion, held against what was added."""

from __future__ import annotations

import numpy as np
import pytest

from wineglass.diagnosis import tones
from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.noise_lines import Line

RATE_HZ, SECONDS, SEED = 50.0, 240, 11
TIME_S = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
NOISE, TONE = 1e-7, 2e-5


def slow() -> np.ndarray:
    """A table that turns, slower than a frame sees."""
    return 1e-4 * np.sin(2.0 * np.pi * 0.05 * TIME_S) + 3e-5 * np.tanh((TIME_S - 100.0) / 8.0)


def noise(seed: int = SEED) -> np.ndarray:
    return NOISE * np.random.default_rng(seed).standard_normal(len(TIME_S))


def moving(distance_hz: float, swing_hz: float = 0.8) -> np.ndarray:
    """Turns of a tone whose distance from the carrier swings as a shell's temperature does: the integral in closed form."""
    period_s = 150.0
    return distance_hz * TIME_S + swing_hz * period_s / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * TIME_S / period_s))


def wave(turns: np.ndarray, angle: float = 0.7) -> np.ndarray:
    return TONE * np.cos(2.0 * np.pi * turns + angle)


def frame_means(values: np.ndarray) -> np.ndarray:
    return values[: len(values) // 12 * 12].reshape(-1, 12).mean(axis=1)


@pytest.mark.parametrize("distance_hz", [3.0, 4.7, -6.7, 9.1, 33.0])
def test_a_tone_goes_and_what_is_slow_stays(distance_hz: float) -> None:
    turns = moving(distance_hz)
    cleaned = tones.removed(slow() + noise() + wave(turns), turns, RATE_HZ)
    assert cleaned.stood and cleaned.gone and cleaned.trusted.all()
    left = cleaned.values - slow() - noise()
    assert np.max(np.abs(left)) < 0.02 * TONE
    assert np.std(frame_means(left)) < 0.3 * np.std(frame_means(noise())), "what is left in a mean is below the floor"


def test_nothing_is_taken_from_a_channel_in_which_no_line_stands() -> None:
    values = slow() + noise()
    cleaned = tones.removed(values, moving(5.0), RATE_HZ)
    assert not cleaned.stood and cleaned.gone and cleaned.trusted.all()
    assert np.array_equal(cleaned.values, values)


def test_where_the_line_nearly_stands_still_samples_are_not_trusted() -> None:
    """The distance falls from 6 Hz through zero to -6 Hz."""
    distance = 6.0 - 12.0 * TIME_S / SECONDS
    turns = 6.0 * TIME_S - 6.0 * TIME_S**2 / SECONDS
    cleaned = tones.removed(slow() + noise() + wave(turns), turns, RATE_HZ)
    assert not cleaned.trusted[np.abs(distance) < 1.0].any()
    assert cleaned.trusted[np.abs(distance) > 2.0].all()
    left = (cleaned.values - slow() - noise())[np.abs(distance) > 2.0]
    assert np.max(np.abs(left)) < 0.05 * TONE


def test_a_jump_in_the_channel_does_not_become_a_line() -> None:
    turns = moving(5.0)
    motion = slow() + np.where((TIME_S > 80.0) & (TIME_S < 81.5), 5e-4, 0.0)
    cleaned = tones.removed(motion + noise() + wave(turns), turns, RATE_HZ)
    assert np.max(np.abs(cleaned.values - motion - noise())[cleaned.trusted]) < 0.03 * TONE
    assert cleaned.trusted[np.abs(TIME_S - 80.5) > 6.0].all(), "only what is near is doubted"


def test_a_line_that_a_switch_changes_is_followed_on_both_sides() -> None:
    turns, cut = moving(5.0), len(TIME_S) // 3
    line = np.where(np.arange(len(TIME_S)) < cut, 0.2 * wave(turns, 1.9), wave(turns))
    values = slow() + noise() + line
    left = [np.max(np.abs(tones.removed(values, turns, RATE_HZ, cuts).values - slow() - noise())[cut - 50:cut + 50]) for cuts in (np.array([cut]), None)]
    assert left[0] < 0.03 * TONE < 0.2 * TONE < left[1], "with and without the switch"


def test_lost_samples_stay_lost_and_hurt_nobody() -> None:
    turns = moving(5.0)
    values = slow() + noise() + wave(turns)
    lost = np.random.default_rng(5).random(len(values)) < 0.02
    values[lost] = np.nan
    cleaned = tones.removed(values, turns, RATE_HZ)
    assert np.array_equal(np.isnan(cleaned.values), lost)
    assert np.nanmax(np.abs(cleaned.values - slow() - noise())) < 0.05 * TONE


def test_a_line_off_its_place_is_found_there() -> None:
    """By a tenth of a hertz and a drift: against the phase that was put in."""
    off_hz = 0.1 + 0.15 * np.sin(2.0 * np.pi * TIME_S / 200.0)
    turns = moving(5.0)
    true = turns + 0.1 * TIME_S + 0.15 * 200.0 / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * TIME_S / 200.0))
    shown = slow() + noise() + wave(true)
    found = np.gradient(tones.refined(turns, [shown], RATE_HZ) - turns) * RATE_HZ
    assert np.max(np.abs(found - off_hz)[200:-200]) < 0.02
    assert np.allclose(tones.refined(turns, [slow() + noise()], RATE_HZ), turns, atol=1e-9), "noise moves nothing"


# ---- from a recording -----------------------------------------------------------------------------------------------------------------


class Tap(dict):  # type: ignore[type-arg]
    """Channels at 50 Hz."""

    sample_rate_hz, time_s, length = RATE_HZ, TIME_S, len(TIME_S)
    valid = np.ones(len(TIME_S), bool)

    def codes(self, name: str) -> np.ndarray:
        return np.asarray(self[name]).astype(int)


class Recorded(dict):  # type: ignore[type-arg]
    """Taps by name."""

    def tap(self, name: str) -> Tap:
        return self[name]


def recorded(form: str = "tone", **changed: np.ndarray) -> tuple[Recorded, Line]:
    """A carrier near 5 kHz that swings by 0.8 Hz, a tone 5 Hz above it that the temperature moves, or a vibration at 4 Hz."""
    swing = 0.8 * np.sin(2.0 * np.pi * TIME_S / 150.0)
    degc = 20.0 + 10.0 * np.sin(2.0 * np.pi * TIME_S / 100.0)
    drift = 0.1 if form == "drifting" else 0.0
    turns = moving(5.0, -0.8) + drift * 10.0 * 100.0 / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * TIME_S / 100.0))
    if form == "rate":
        turns = 4.0 * TIME_S
    baseband = Tap(drive_frequency=5000.0 + swing, secondary_in_phase=slow() + noise() + wave(turns), secondary_quadrature=slow() + noise(2) + wave(turns, 2.2))
    output = Tap(rate=slow() + noise(3) + wave(turns, 1.0), temperature_measured=degc)
    line = Line("vibration" if form == "rate" else "interference", 4.0 if form == "rate" else 5005.0, 0.004, TONE, 0.1 * TONE, 1000.0, 100.0, 1000.0, form,
                drift_hz_per_degc=drift)
    return Recorded(baseband=Tap(baseband | changed), output=output), line


def frames() -> Frames:
    grid = Grid(0.24, 4, 990)
    return Frames(grid, (), np.zeros((0, 990)), np.zeros((0, 990), bool))


@pytest.mark.parametrize("form", ["tone", "drifting", "rate"])
def test_means_without_the_line_are_those_of_the_motion(form: str) -> None:
    recording, line = recorded(form)
    found = tones.without(frames(), recording, [line], ["secondary_in_phase", "secondary_quadrature", "rate"])
    assert set(found) == {"secondary_in_phase", "secondary_quadrature", "rate"}
    for name, seed in (("secondary_in_phase", SEED), ("secondary_quadrature", 2), ("rate", 3)):
        values, use = found[name]
        asked = frame_means(slow() + noise(seed))[4:994]
        assert np.mean(use) > 0.98
        assert np.max(np.abs(values - asked)[use]) < 0.6 * NOISE / np.sqrt(12.0), name


def test_without_a_phase_or_a_distance_there_is_nothing_to_take_out() -> None:
    recording, line = recorded()
    del recording["baseband"]["drive_frequency"]
    assert tones.without(frames(), recording, [line], ["rate"]) == {}
    assert tones.without(frames(), Recorded(output=recording["output"]), [line], ["rate"]) == {}
    near, line = recorded(drive_frequency=np.full(len(TIME_S), 5004.6))
    assert tones.without(frames(), near, [line], ["rate"]) == {}, "0.4 Hz off throughout"


def test_a_switch_is_where_the_loop_or_the_set_point_changes() -> None:
    status, set_point = np.zeros(len(TIME_S), int), np.zeros(len(TIME_S), int)
    status[100:300] = 1 << 10
    status[150:160] |= 1
    set_point[500:] = 7
    tap = Tap(status=status, amplitude_set_point=set_point)
    assert tones.switched(tap).tolist() == [100, 300, 500]
    assert tones.switched(Tap()).size == 0
