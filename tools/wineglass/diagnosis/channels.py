"""Recordings as frames: means of every slow channel over common stretches of time, from a recording or from the envelope twin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scipy.interpolate import CubicSpline

from wineglass.diagnosis import own_line
from wineglass.recording.memory import Samples, Source
from wineglass.wire import Status

FRAME_S = 0.24  # about; a whole number of samples of the slowest tap, and at the usual 50 Hz of the envelope twin's longest steps
MOST_FRAMES = 8000
SETTLING_S = 1.0  # after the first lock
LONGEST_GAP, LEAST_FOR_SPLINE = 3, 8  # samples: lost ones that are bridged, and those that a spline needs
MOST_BENT = 5.0  # times the usual second difference
BASEBAND = ("primary_in_phase", "primary_quadrature", "drive_frequency", "drive_level", "secondary_in_phase", "secondary_quadrature",
            "rebalance_in_phase", "rebalance_quadrature")
OUTPUT = ("rate_uncompensated", "rate", "quadrature", "temperature_measured")
UNITS = {"drive_frequency": "Hz", "rate_uncompensated": "rad/s", "rate": "rad/s", "quadrature": "rad/s", "temperature_measured": "degC"}
LEAST_AMPLITUDE = 0.15  # of the usual one: below that the pickoffs show noise


@dataclass(frozen=True)
class Grid:
    """Frame j covers [j frame_s, (j + 1) frame_s) since power-up, j from `first` on."""

    frame_s: float
    first: int
    count: int

    @cached_property
    def time_s(self) -> np.ndarray:
        """Middles (n,)."""
        return (self.first + 0.5 + np.arange(self.count)) * self.frame_s


@dataclass(frozen=True)
class Frames:
    """values (channels, n); use (channels, n): the mean is sound; bridged (n,): lost samples are in it, None: nowhere; shaken: single events shake
    the shell again and again; beating: harmonics beat with the sampling clock; freed: channels from which lines that beat were taken out."""

    grid: Grid
    names: tuple[str, ...]
    values: np.ndarray
    use: np.ndarray
    bridged: np.ndarray | None = None
    shaken: bool = False
    beating: bool = False
    freed: frozenset[str] = frozenset()

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[self.names.index(name)]


def unit_of(channel: str) -> str:
    return UNITS.get(channel, "FS")


def grid_of(recording: Source) -> Grid:
    taps = [recording.tap(name) for name in ("baseband", "output") if name in recording]
    slowest = min(tap.sample_rate_hz for tap in taps)
    first = max(float(tap.time_s[0]) - 0.5 / tap.sample_rate_hz for tap in taps)
    end = min(float(tap.time_s[-1]) + 0.5 / tap.sample_rate_hz for tap in taps)
    frame_s = max(FRAME_S, (end - first) / MOST_FRAMES)
    frame_s = max(1, math.floor(frame_s * slowest + 1e-9)) / slowest
    start = math.ceil(first / frame_s - 1e-6)
    return Grid(frame_s, start, max(0, math.floor(end / frame_s + 1e-6) - start))


def read(recording: Source, grid: Grid) -> Frames:
    """The channels that the recording has."""
    rows: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for tap_name, names in (("baseband", BASEBAND), ("output", OUTPUT)):
        if tap_name in recording:
            tap = recording.tap(tap_name)
            turns = own_line.phase(tap)
            for name in (name for name in names if name in tap):
                values = tap[name] if turns is None or name not in own_line.CHANNELS else own_line.removed(tap, tap[name], turns)
                rows[name] = means(tap, values, grid)
    sound = _sound(recording, grid)
    values = np.array([row[0] for row in rows.values()]).reshape(len(rows), grid.count)
    use = np.array([row[1] & sound for row in rows.values()]).reshape(len(rows), grid.count)
    return Frames(grid, tuple(rows), values, use, _with_losses(recording, grid))


def means(tap: Samples, values: np.ndarray, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Means (n,), and which of them are of all their samples, short gaps bridged."""
    place = np.floor(tap.time_s / grid.frame_s + 1e-9).astype(int) - grid.first
    inside = (place >= 0) & (place < grid.count)
    values = _bridged(tap.time_s, values)
    there = np.isfinite(values) & inside
    slots, count = (np.bincount(place[chosen], minlength=grid.count) for chosen in (inside, there))
    total = np.bincount(place[there], values[there], minlength=grid.count)
    usual = max(1.0, grid.frame_s * tap.sample_rate_hz)
    return total / np.maximum(count, 1), (count == slots) & (count >= 0.5 * usual)


def _bridged(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Lost samples from a cubic spline through their neighbours: the mean of those that are left would be that of another time. Where a straight line
    says something else, too much happened to tell."""
    there = np.isfinite(values)
    if there.all() or np.count_nonzero(there) < LEAST_FOR_SPLINE:
        return values
    known = np.flatnonzero(there)
    gaps = np.diff(known) - 1
    found = values.copy()
    lost = np.concatenate([known[i] + 1 + np.arange(gaps[i]) for i in np.flatnonzero((gaps > 0) & (gaps <= LONGEST_GAP))] or [np.zeros(0, int)])
    bent, straight = CubicSpline(time_s[known], values[known])(time_s[lost]), np.interp(time_s[lost], time_s[known], values[known])
    usual = float(np.median(np.abs(np.diff(values[known], 2))))
    found[lost] = np.where(np.abs(bent - straight) <= MOST_BENT * usual, bent, np.nan)
    return found


def _with_losses(recording: Source, grid: Grid) -> np.ndarray | None:
    if "baseband" not in recording or recording.tap("baseband").valid.all():
        return None
    tap = recording.tap("baseband")
    place = np.floor(tap.time_s[~tap.valid] / grid.frame_s + 1e-9).astype(int) - grid.first
    return np.bincount(place[(place >= 0) & (place < grid.count)], minlength=grid.count) > 0


def _sound(recording: Source, grid: Grid) -> np.ndarray:
    """Frames (n,) after the first lock, without a saturated converter flagged as overflow, with enough amplitude."""
    sound = np.ones(grid.count, bool)
    if "baseband" not in recording:
        return sound & (grid.time_s > SETTLING_S)
    tap = recording.tap("baseband")
    if "status" in tap:
        locked = tap.valid & (tap.codes("status").astype(np.int64) & Status.LOCKED != 0)
        first = float(tap.time_s[int(np.argmax(locked))]) if locked.any() else math.inf
        sound &= grid.time_s - 0.5 * grid.frame_s > first + SETTLING_S
    if "primary_in_phase" in tap:
        amplitude, there = means(tap, tap["primary_in_phase"], grid)
        sound &= there & (amplitude > LEAST_AMPLITUDE * np.median(amplitude[there]) if there.any() else there)
    return sound
