"""How large a gap is: the recording with the effects against the one of the same seed without them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wineglass.recording import Recording

TAPS = ("baseband", "output")
SKIP = ("status", "angle", "amplitude_set_point")
SETTLED_S = 4.0


@dataclass(frozen=True)
class ChannelGrade:
    """shift: what the effects add, seen through the channel's white noise (root of the sum of squares over it: a matched filter's SNR)
    ratio: rms of what they add over the channel's noise
    noise: change of the channel's noise power over what chance makes of it"""

    shift: float
    ratio: float
    noise: float

    @property
    def snr(self) -> float:
        return max(self.shift, self.noise)


@dataclass(frozen=True)
class Grade:
    """channels: by name; snr: the largest of all"""

    channels: dict[str, ChannelGrade]

    @property
    def snr(self) -> float:
        return max((grade.snr for grade in self.channels.values()), default=0.0)

    @property
    def channel(self) -> str:
        """Where it shows most."""
        return max(self.channels, key=lambda name: self.channels[name].snr, default="")

    def label(self) -> dict[str, Any]:
        return {"snr": self.snr, "channel": self.channel,
                "channels": {name: {"shift": one.shift, "ratio": one.ratio, "noise": one.noise} for name, one in self.channels.items()}}


def grade(with_effects: Path, without: Path) -> Grade:
    """Both recordings of one seed; reference channels count where the effect is one of the reference."""
    with Recording.open(with_effects) as changed, Recording.open(without) as plain:
        found = {}
        for tap in (*TAPS, "reference"):
            if tap in changed.taps and tap in plain.taps:
                found |= _tap(changed.tap(tap), plain.tap(tap))
        return Grade(found)


def _tap(changed: Any, plain: Any) -> dict[str, ChannelGrade]:
    count = min(len(changed.time_s), len(plain.time_s))
    used = plain.time_s[:count] >= SETTLED_S
    return {name: one(np.asarray(changed[name], float)[:count][used], np.asarray(plain[name], float)[:count][used])
            for name in plain.channels if name not in SKIP and name in changed.channels}


def one(changed: np.ndarray, plain: np.ndarray) -> ChannelGrade:
    """(n,) each; lost samples are NaN."""
    difference = changed - plain
    sound = np.isfinite(difference)
    difference, plain, changed = difference[sound], plain[sound], changed[sound]
    n = len(difference)
    if n < 4:
        return ChannelGrade(0.0, 0.0, 0.0)
    before, after, between = _white(plain), _white(changed), _white(difference)
    floor = max(before, 1e-12 * float(np.max(np.abs(plain))) + 1e-300)
    energy = max(0.0, float(np.sum(difference**2)) - n * between * (1.0 + 3.0 * np.sqrt(2.0 / n)))
    power = abs(after - before) / (floor * np.sqrt(8.0 / n))
    return ChannelGrade(float(np.sqrt(energy / floor)), float(np.sqrt(energy / n / floor)), float(power))


def _white(values: np.ndarray) -> float:
    """Power of the white part, from second differences; a robust mean, since steps and jumps are no noise."""
    second = np.diff(values, 2) ** 2 / 6.0
    return float(np.median(second)) / 0.454937 if np.any(second) else 0.0
