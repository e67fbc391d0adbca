"""The rebalance loop on paper: its frequency response, its margins, and the condition by which the firmware accepts its gains.

The mode's envelope under force is b/(s + 1/tau); the controller Kp + Ki/s acts once per loop tick, D after the motion it answers:

    L(s) = (Kp + Ki/s) b/(s + 1/tau) exp(-s D),   D = [(N - 1) + 4 + (N - 1)/2 + loop delay] samples

(decimator, task slots, hold of a loop tick, ADC and DAC). docs/decisions/0004-rebalance-margins.md has the derivation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from wineglass.calibration_block import Calibration

PHASE_MARGIN_DEG, GAIN_MARGIN_DB = 30.0, 6.0
CROSSOVER_DELAY_MAX = 0.7  # b Kp D, as in firmware/application/rebalance_check.c
_TASK_SLOTS = 4  # from the decimator's last sample to the first force that knows of it


@dataclass(frozen=True)
class Loop:
    """b [1/s], Kp [FS/FS], Ki [FS/FS/s], 1/tau [1/s], delay [s]"""

    growth_per_s: float
    kp: float
    ki_per_s: float
    decay_per_s: float
    delay_s: float

    def open_loop(self, frequency_hz: np.ndarray) -> np.ndarray:
        """L at frequencies [Hz] from the carrier, complex (n,)."""
        s = 2j * np.pi * np.asarray(frequency_hz)
        return (self.kp + self.ki_per_s / s) * self.growth_per_s / (s + self.decay_per_s) * np.exp(-s * self.delay_s)

    def closed_loop(self, frequency_hz: np.ndarray) -> np.ndarray:
        """Rate that the force reads over true rate, complex (n,). The decimator's and the rate's own delays are not in it."""
        loop = self.open_loop(frequency_hz)
        return loop / (1.0 + loop)


@dataclass(frozen=True)
class Margins:
    crossover_hz: float
    phase_deg: float
    gain_db: float
    bandwidth_hz: float
    """-3 dB of the closed loop"""


def loop_of(calibration: Calibration) -> Loop:
    """The loop that a calibration makes, at its reference temperature."""
    c = calibration
    growth = 0.5 * c.rebalance_scale_rad_s_per_ratio[0] * c.angular_gain * c.pickoff_gain_ratio
    return Loop(growth, c.rebalance_kp, c.rebalance_ki_per_s, c.decay_rate_per_s[0], delay_samples(c) / c.sample_rate_hz)


def delay_samples(calibration: Calibration) -> float:
    n = calibration.decimation
    return (n - 1) + _TASK_SLOTS + (n - 1) / 2 + calibration.loop_delay_samples


def is_described(calibration: Calibration) -> bool:
    """Gains, limit and scale factor are there."""
    c = calibration
    return c.rebalance_kp > 0.0 and c.rebalance_in_phase_limit_fs > 0.0 and c.rebalance_scale_rad_s_per_ratio[0] > 0.0


def is_accepted(loop: Loop) -> bool:
    """The firmware's condition: b Kp D <= 0.7 and Ki/Kp <= b Kp/4 + 1/tau. It gives PHASE_MARGIN_DEG and GAIN_MARGIN_DB at least."""
    crossover = loop.growth_per_s * loop.kp
    return crossover * loop.delay_s <= CROSSOVER_DELAY_MAX and loop.ki_per_s <= loop.kp * (0.25 * crossover + loop.decay_per_s)


def margins(loop: Loop) -> Margins:
    """From the frequency response on a fine grid, interpolated."""
    top = 0.6 / loop.delay_s
    frequency = np.geomspace(1e-6 * top, top, 200_001)
    response = loop.open_loop(frequency)
    size_db = 20.0 * np.log10(np.abs(response))
    phase = np.unwrap(np.angle(response))
    phase -= 2.0 * math.pi * round((phase[0] + 0.5 * math.pi) / (2.0 * math.pi))
    crossover = _where(frequency, -size_db, 0.0)
    turn = _where(frequency, -phase, math.pi)
    closed = np.abs(response / (1.0 + response))
    return Margins(crossover, 180.0 + math.degrees(float(np.interp(crossover, frequency, phase))),
                   -float(np.interp(turn, frequency, size_db)), _where(frequency, -closed, -math.sqrt(0.5)))


def _where(frequency: np.ndarray, rising: np.ndarray, level: float) -> float:
    """Where the last crossing of a level upwards is; NaN if there is none."""
    above = rising >= level
    upward = np.flatnonzero(~above[:-1] & above[1:])
    if len(upward) == 0:
        return math.nan
    i = upward[-1]
    part = (level - rising[i]) / (rising[i + 1] - rising[i])
    return float(frequency[i] + part * (frequency[i + 1] - frequency[i]))
