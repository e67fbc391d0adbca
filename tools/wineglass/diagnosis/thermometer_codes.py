"""Coarse steps in the measured temperature: the greatest step of which all readings are multiples, against the thermometer's own.

Telemetry holds means over an interval, so a reading may lie between two steps while the temperature crosses; most do not. A fine thermometer with
noise of some codes shows values everywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wineglass.device import Device
from wineglass.recording.reader import Recording

LEAST_RATIO = 1.6
"""of the step over the thermometer's own code"""
ON_STEP = 0.04
"""of a step: how near to a multiple counts as on it"""
LEAST_SHARE = 0.55
LEAST_SAMPLES = 200


@dataclass(frozen=True)
class Steps:
    """step_degc: the greatest step that fits; share: of the readings on its multiples, by chance it would be `chance`; dwell_s: longest standstill
    while the temperature went on"""

    step_degc: float
    share: float
    chance: float
    count: int
    own_degc: float
    dwell_s: float

    @property
    def coarse(self) -> bool:
        return self.share > LEAST_SHARE and self.step_degc > LEAST_RATIO * self.own_degc

    @property
    def log_evidence(self) -> float:
        """Readings on the steps count, but not each on its own: neighbours are alike. One nat per visited step, two per crossing seen."""
        if not self.coarse:
            return -6.0
        gain = self.share * math.log(max(self.share, 1e-9) / self.chance) + (1.0 - self.share) * math.log(max(1.0 - self.share, 1e-9) / (1.0 - self.chance))
        return min(200.0, 0.05 * self.count * gain) - 3.0


def find(recording: Recording, device: Device) -> Steps | None:
    """None: no temperature, or too little of it."""
    if "output" not in recording or "temperature_measured" not in recording.tap("output"):
        return None
    tap = recording.tap("output")
    readings = tap["temperature_measured"][tap.valid]
    if len(readings) < LEAST_SAMPLES:
        return None
    own = device.electronics.thermometer.lsb_degc
    step = _commonest_step(readings, own)
    if step is None:
        return Steps(own, 0.0, 1.0, len(readings), own, 0.0)
    step, share = _refined(readings, step)
    return Steps(step, share, 2.0 * ON_STEP, len(readings), own, _dwell(readings) / tap.sample_rate_hz)


def _commonest_step(readings: np.ndarray, own: float) -> float | None:
    """From the values at which the temperature stood still: their least distance that occurs often."""
    still = np.abs(np.diff(readings)) < 0.02 * own
    if np.count_nonzero(still) < 0.3 * len(readings):
        return None
    values, counts = np.unique(np.round(readings[1:][still] / (0.1 * own)), return_counts=True)
    stood = values[counts >= max(3, 0.0005 * len(readings))] * 0.1 * own
    distances = np.diff(stood)
    distances = distances[distances > LEAST_RATIO * own]
    return float(np.median(distances)) if len(distances) else None


def _refined(readings: np.ndarray, step: float) -> tuple[float, float]:
    """The step near the given one, and the offset, on which most readings lie."""
    best = (step, 0.0)
    readings = readings[::max(1, len(readings) // 4000)]
    for trial in step * np.linspace(0.97, 1.03, 121):
        turn = readings / trial
        phase = np.angle(np.mean(np.exp(2j * np.pi * turn))) / (2.0 * np.pi)
        away = np.abs(turn - phase - np.round(turn - phase))
        share = float(np.mean(away < ON_STEP))
        if share > best[1]:
            best = (float(trial), share)
    return best


def _dwell(readings: np.ndarray) -> float:
    """Samples of the longest standstill."""
    moves = np.flatnonzero(np.abs(np.diff(readings)) > 0)
    return float(np.max(np.diff(np.concatenate([[0], moves, [len(readings)]]))))
