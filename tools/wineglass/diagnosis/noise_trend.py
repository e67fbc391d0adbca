"""Noise that follows the temperature: its level in the cold, the middle and the warm third of the quiet windows. A mean over a day in which it is quiet
for half of the time hardly shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wineglass.diagnosis import noise_windows
from wineglass.diagnosis.noise_windows import Windows

FROM_HZ = 5.0
"""what is slow has other reasons to change"""
LEAST_SPAN_DEGC, LEAST_BINS = 5.0, 12
LEVEL_ERROR = 0.03
"""relative, of a third's level: loops answer a little otherwise in the warmth"""
SURE = 6.0
OCCAM = 5.0
MEDIAN = 0.80
"""of a bin's power over its mean: gamma distributed with two tapers"""
AGREED = 0.35
"""by which both quadratures may differ, of the log of how much the level changes"""


@dataclass(frozen=True)
class Trend:
    """levels: of the noise power over its floor, cold to warm, (3,); log_evidence: of a changing against a steady level; windows: level in each window (n,)"""

    axis: str
    temperature_degc: np.ndarray
    levels: np.ndarray
    log_evidence: float
    windows: np.ndarray

    @property
    def relative(self) -> np.ndarray:
        """Level of each window over the usual one, (n,); 1 where it does not change for sure."""
        usual = float(np.mean(np.sort(self.windows)[:max(1, round(noise_windows.KEPT * len(self.windows)))]))
        return self.windows / usual if self.log_evidence > SURE else np.ones(len(self.windows))


def find(axis: str, windows: Windows, channels: dict[str, np.ndarray], white: dict[str, np.ndarray], taken: np.ndarray, degc: np.ndarray,
         floor: float) -> Trend | None:
    """channels: the two quadratures of an axis, at the tap's samples; white: density of each per unit of pickoff variance; taken: bins (n, m) of the
    windows that hold lines; degc: of the windows; floor: the described variance. None: too little to say."""
    if len(windows) < 3 * noise_windows.LEAST_WINDOWS or float(np.ptp(degc)) < LEAST_SPAN_DEGC:
        return None
    usable = (windows.frequency_hz > FROM_HZ) & ~(taken.mean(axis=0) > 0.5)
    if np.count_nonzero(usable) < LEAST_BINS:
        return None
    thirds = np.array_split(np.argsort(degc, kind="stable"), 3)
    logs, each_window, shape = [], [], 0.5 * np.count_nonzero(usable)
    for name, values in channels.items():
        relative = np.where(taken, np.nan, windows.densities(values) / white[name])[:, usable]
        level = np.nanmedian(np.where(np.isnan(relative).all(axis=1)[:, None], 1.0, relative), axis=1) / MEDIAN  # the sides of lines count little
        each_window.append(level / floor)
        logs.append(np.log([noise_windows.trimmed(level[third][:, None], shape)[0] / floor for third in thirds]))
    each = np.array([len(third) for third in thirds])
    both = np.mean(logs, axis=0)
    sigma = np.sqrt(1.0 / (0.8 * shape * len(logs) * each) + LEVEL_ERROR**2)
    middle = np.sum(both / sigma**2) / np.sum(sigma**-2)
    score = float(0.5 * np.sum(((both - middle) / sigma) ** 2)) - OCCAM
    if max(abs(np.ptp(one) - np.ptp(both)) for one in logs) > AGREED * max(1.0, float(np.ptp(both))):
        score = min(score, 0.0)
    return Trend(axis, np.array([float(np.mean(degc[third])) for third in thirds]), np.exp(both), score, np.mean(each_window, axis=0))
