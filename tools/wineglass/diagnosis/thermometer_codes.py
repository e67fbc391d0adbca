"""Coarse steps in the measured temperature: the greatest step of which the readings are multiples where they stand still, against the thermometer's own.

Telemetry holds means over an interval, so a reading lies anywhere while the temperature moves on by more than a step per interval. Where it moves
slowly, a coarse thermometer repeats one reading exactly, again and again; one whose code is fine against its noise never does."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wineglass.device import Device
from wineglass.recording.reader import Recording

LEAST_RATIO = 1.6
"""of the step over the thermometer's own code"""
RUN = 5
"""equal readings in a row that count as standing still"""
ON_STEP = 0.04
"""of a step: how near to a multiple counts as on it, beside half of the thermometer's own code, to which it is rounded"""
LEAST_SHARE, LEAST_LEVELS, LEAST_NEIGHBOURS = 0.85, 8, 0.4
LEAST_SAMPLES = 200


@dataclass(frozen=True)
class Steps:
    """step_degc: the greatest step that fits; levels: readings, more than half of the thermometer's own code apart, at which the temperature stood still; share:
    of them on its multiples, counted from offset_degc"""

    step_degc: float
    share: float
    levels: int
    own_degc: float
    neighbours: float = 0.0
    """share of the distances between levels that are one step: a temperature that creeps meets them one after the other"""
    offset_degc: float = 0.0

    @property
    def coarse(self) -> bool:
        return self.neighbours >= LEAST_NEIGHBOURS and self.levels >= LEAST_LEVELS and self.share > LEAST_SHARE and self.step_degc > LEAST_RATIO * self.own_degc

    @property
    def log_evidence(self) -> float:
        """Levels that are on a multiple by chance do not count; two are needed to find step and offset."""
        if not self.coarse:
            return -6.0
        return min(200.0, self.share * (self.levels - 2) * -math.log(2.0 * _tolerance(self.step_degc, self.own_degc))) - 1.0


def find(recording: Recording, device: Device) -> Steps | None:
    """None: no temperature, or too little of it."""
    if "output" not in recording or "temperature_measured" not in recording.tap("output"):
        return None
    tap = recording.tap("output")
    readings = tap["temperature_measured"][tap.valid]
    if len(readings) < LEAST_SAMPLES:
        return None
    own = device.electronics.thermometer.lsb_degc
    levels = _standing(readings, own)
    distances = np.diff(levels)
    distances = distances[distances > 0.5 * own]
    if len(distances) == 0:
        return Steps(own, 0.0, 1, own)
    step, offset, share = _refined(levels, float(np.median(distances)), own)
    near = float(np.mean(np.abs(distances / step - 1.0) < 2.0 * _tolerance(step, own)))
    return Steps(step, share, 1 + len(distances), own, near, offset)


def _standing(readings: np.ndarray, own: float) -> np.ndarray:
    """Different values, in order, that were read RUN times in a row."""
    equal = np.abs(np.diff(readings)) < 0.01 * own
    length = RUN - 1
    runs = np.convolve(equal, np.ones(length), "valid") >= length if len(equal) >= length else np.zeros(0, bool)
    values = np.sort(readings[:len(runs)][runs])
    if len(values) == 0:
        return values
    return values[np.concatenate([[True], np.diff(values) > 0.05 * own])]


def _refined(levels: np.ndarray, step: float, own: float) -> tuple[float, float, float]:
    """The step near the given one on whose multiples, from some offset, most levels lie; the offset, and the share of them. Of the steps that do, the one that
    meets these levels best."""
    best, offset, share = step, 0.0, 0.0
    for trial in step * np.concatenate([[1.0], np.linspace(0.9, 1.1, 801)]):
        turn = levels / trial
        phase = np.angle(np.mean(np.exp(2j * np.pi * turn))) / (2.0 * np.pi)
        number = np.round(turn - phase)
        on = np.abs(turn - phase - number) < _tolerance(trial, own)
        if np.mean(on) > share:
            best, offset, share = float(trial), float(phase * trial), float(np.mean(on))
            if np.ptp(number[on]) > 0.0:
                best, offset = (float(value) for value in np.polyfit(number[on], levels[on], 1))
    return best, offset, share


def _tolerance(step: float, own: float) -> float:
    """Of a step."""
    return min(0.45, ON_STEP + 0.55 * own / step)
