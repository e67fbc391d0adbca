"""Single events: instants at which the drive loop had to catch up with a jump of the shell's phase.

A sample that is lost advances the shell by f/fs of a turn against the oscillator, one that is doubled takes it back; the phase loop turns the
oscillator by as much within milliseconds, so the frequency's excursion, integrated, is k f/fs turns.

A sample that repeats the one before it turns nothing. It is wrong by up to what the shell moves in a sample, so the primary's amplitude is off in one
telemetry interval, by no more than that over the interval's samples; then the amplitude's loop, which was misled, takes it back."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import median_filter

from wineglass.recording.reader import Recording, Tap
from wineglass.wire import Status

THRESHOLD = 12.0
"""sigmas of one sample of the frequency"""
APART_S, APART_SAMPLES = 0.05, 2.5
"""between two jumps, the longer of both; the phase loop forgets one within some 30 ms"""
TOLERANCE = 0.17
"""relative, of the turns: the frequency is sampled once per slow tick while the phase loop answers within a few of them"""
AFTER_START_S, BEFORE_COMMAND_S, AFTER_COMMAND_S = 1.5, 0.5, 1.5
LONGEST_S, LONGEST_SAMPLES = 0.12, 6
LEAST_TURNS = 0.02
"""a corner of the chamber's profile bends the frequency, too, but by less"""
STALE_THRESHOLD, QUIET = 15.0, 5.0
"""sigmas of the step of the amplitude from one interval to the next: of a wrong sample, and of the one before it"""
LEAST_STALE, STALE_MARGIN = 2, 1.15
LARGEST_COUNT = 4
"""more samples at once are told apart from nothing: turns are known modulo one"""


@dataclass(frozen=True)
class Event:
    """turns: by which the oscillator had to turn; samples: how many were lost (below zero: doubled), 0 when no whole number fits; stale: a single wrong
    sample, which turned nothing"""

    time_s: float
    turns: float
    samples: int
    stale: bool = False

    @property
    def of_a_sample(self) -> bool:
        return self.samples != 0 or self.stale


@dataclass(frozen=True)
class Events:
    """hidden_s: spans in which an event would not have been seen: a command shook the loops, too. spikes_s: instants at which the frequency was off and turned
    nothing, as after a wrong sample that the amplitude does not show, or after as many lost ones as make whole turns"""

    found: list[Event]
    examined_s: float
    counter_rate_hz: float
    hidden_s: list[tuple[float, float]] = field(default_factory=list)
    spikes_s: list[float] = field(default_factory=list)

    @property
    def times_s(self) -> np.ndarray:
        return np.array([event.time_s for event in self.found])

    @property
    def slips(self) -> list[Event]:
        return [event for event in self.found if event.of_a_sample]

    @property
    def log_evidence(self) -> dict[str, float]:
        """dropped_samples, and events of another kind, each against none. An excursion of twelve sigmas is no noise."""
        if not self.found:
            return {"dropped_samples": -1.0, "other": -1.0}
        own = sum(3.5 if event.of_a_sample else -8.0 for event in self.found)
        return {"dropped_samples": 60.0 + 2.0 + own, "other": 60.0}


def find(recording: Recording) -> Events | None:
    """None: the recording has no drive frequency."""
    if "baseband" not in recording or "drive_frequency" not in recording.tap("baseband"):
        return None
    tap = recording.tap("baseband")
    frequency = tap["drive_frequency"]
    sound = np.isfinite(frequency)
    if np.count_nonzero(sound) < 64:
        return None
    filled = np.interp(tap.time_s, tap.time_s[sound], frequency[sound])
    rest = filled - _around(filled)
    usable = sound & ~_disturbed(recording, tap.time_s)
    if np.count_nonzero(usable) < 64:
        return None
    sigma = 1.4826 * float(np.median(np.abs(rest[usable])))
    large = np.flatnonzero(usable & (np.abs(rest) > THRESHOLD * sigma))
    groups = np.split(large, np.flatnonzero(np.diff(large) > max(APART_S * tap.sample_rate_hz, APART_SAMPLES)) + 1) if len(large) else []
    per_sample = float(np.median(filled[usable])) / tap.counter_rate_hz
    short = [_event(tap.time_s, rest, group, tap.sample_rate_hz, per_sample) for group in groups
             if len(group) <= max(LONGEST_S * tap.sample_rate_hz, LONGEST_SAMPLES)]
    found = [event for event in short if abs(event.turns) >= LEAST_TURNS]
    found = sorted(found + _stale(tap, usable, [event.time_s for event in found], per_sample), key=lambda event: event.time_s)
    spikes = [event.time_s for event in short if abs(event.turns) < LEAST_TURNS]
    return Events(found, np.count_nonzero(usable) / tap.sample_rate_hz, tap.counter_rate_hz, _around_commands(recording), spikes)


def _around(values: np.ndarray, reach: int = 12, gap: int = 4) -> np.ndarray:
    """Median before and median after, averaged: a straight line passes, a short excursion does not."""
    middle = median_filter(values, size=2 * reach + 1, mode="nearest")
    shift = reach + gap
    before = np.concatenate([np.full(shift, middle[0]), middle[:-shift]])
    after = np.concatenate([middle[shift:], np.full(shift, middle[-1])])
    return 0.5 * (before + after)


def _disturbed(recording: Recording, time_s: np.ndarray) -> np.ndarray:
    """Start, commands, and whatever the device itself reports as a restart, (n,) bool."""
    disturbed = time_s < _locked_since(recording) + AFTER_START_S
    for begin, end in _around_commands(recording):
        disturbed |= (time_s > begin) & (time_s < end)
    return disturbed


def _around_commands(recording: Recording) -> list[tuple[float, float]]:
    at = [event.sample / recording.counter_rate_hz for event in recording.events if event.kind == "command"]
    return [(time_s - BEFORE_COMMAND_S, time_s + AFTER_COMMAND_S) for time_s in at]


def _locked_since(recording: Recording) -> float:
    tap = recording.tap("baseband")
    if "status" not in tap:
        return float(tap.time_s[0]) + 2.0
    locked = np.where(tap.lost, 0, np.nan_to_num(tap["status"])).astype(np.int64) & int(Status.LOCKED) != 0
    return float(tap.time_s[int(np.argmax(locked))]) if locked.any() else math.inf


def _stale(tap: Tap, usable: np.ndarray, jumps_s: list[float], per_sample: float) -> list[Event]:
    """Amplitudes that are off in a single interval. per_sample: turns of the carrier."""
    if "primary_in_phase" not in tap:
        return []
    step = np.diff(tap["primary_in_phase"])
    sound = np.isfinite(step) & usable[1:]
    if np.count_nonzero(sound) < 64:
        return []
    sigma = 1.4826 * float(np.median(np.abs(step[sound])))
    at = np.arange(2, len(step) - 1)
    single = (np.abs(step[at]) > STALE_THRESHOLD * sigma) & (np.abs(step[at - 1]) < QUIET * sigma) & (np.abs(step[at - 2]) < QUIET * sigma)
    single &= (step[at + 1] * step[at] < 0.0) & (np.abs(step[at + 1]) > np.abs(step[at])) & sound[at] & sound[at - 1] & sound[at + 1]
    found = [number for number in at[single] if not any(abs(tap.time_s[number + 1] - jump) < AFTER_COMMAND_S for jump in jumps_s)]
    if len(found) < LEAST_STALE:
        return []
    sines = _sines(tap, step[found], per_sample)
    swings = _swings(sines)
    return [Event(float(tap.time_s[number + 1]), 0.0, 0, swings and abs(sine) < STALE_MARGIN) for number, sine in zip(found, sines, strict=True)]


def _sines(tap: Tap, steps: np.ndarray, per_sample: float) -> np.ndarray:
    """A repeated sample of x = A cos(phi), with a turn of d per sample, is wrong by 2 A sin(d/2) sin(phi - d/2); an interval of n samples reads 2/n cos(phi)
    of that, 2/n A sin(d/2) (sin(2 phi - d/2) - sin(d/2)). The first of both sines from what was read, (k,)."""
    amplitude = float(np.nanmax(np.abs(tap["primary_in_phase"])))
    half = math.sin(math.pi * per_sample)
    size = 2.0 * amplitude * half * tap.sample_rate_hz / tap.counter_rate_hz
    return np.asarray(steps / size + half)


def _swings(sines: np.ndarray) -> bool:
    """Instants of chance: as often up as down, and in two of three cases beyond a half."""
    slack = 0.12 + 1.5 / math.sqrt(len(sines))
    return bool(abs(np.mean(sines > 0.0) - 0.5) < slack and abs(np.mean(np.abs(sines) > 0.5) - 2.0 / 3.0) < slack)


def _event(time_s: np.ndarray, rest: np.ndarray, group: np.ndarray, rate_hz: float, per_sample: float) -> Event:
    first, last = max(0, group[0] - 1), min(len(rest), group[-1] + 2)
    turns = float(np.sum(rest[first:last])) / rate_hz
    count = round(turns / per_sample)
    fits = 1 <= abs(count) <= LARGEST_COUNT and abs(turns / per_sample - count) < TOLERANCE * abs(count)
    return Event(float(time_s[group[0]]), turns, count if fits else 0)
