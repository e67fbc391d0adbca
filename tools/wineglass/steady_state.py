"""What the shell does in the end at a constant temperature and rate: closed forms, by another way than the twin's integration.

The drive force acts on mode 1 alone and the drive loop holds x1 exactly 90 degrees behind it. Then x2 = r x1 with

    r = (j w (g W + c12) - K12) / (k2^2 - W^2 - w^2 + j w d2)

and w solves  Re[k1^2 - W^2 - w^2 + (K12 + j w (g W - c21)) r] = 0,  c12 = c21 = 2 z12 k = g bias, d = 2 z k."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wineglass.device import Resonator

_ROUNDS = 50  # of the fixed-point iteration for w; each gains a factor of about Q


@dataclass(frozen=True)
class SteadyState:
    """ratio: secondary over primary amplitude, complex (n,); frequency_hz of the drive (n,)"""

    ratio: np.ndarray
    frequency_hz: np.ndarray


def steady_state(resonator: Resonator, temperature_degc: np.ndarray | float, rate_rad_s: np.ndarray | float = 0.0) -> SteadyState:
    """At shell temperatures [degC] and rates [rad/s], broadcast against each other."""
    temperature, rate = np.broadcast_arrays(np.asarray(temperature_degc, float), np.asarray(rate_rad_s, float))
    k = 2.0 * np.pi * resonator.frequency_at(temperature)
    split = 2.0 * np.pi * resonator.split_hz * np.exp(2j * math.radians(resonator.split_axis_deg))
    stiffness_1 = k * (k + split.real) - rate**2
    stiffness_2 = k * (k - split.real) - rate**2
    cross_stiffness = k * (split.imag + resonator.angular_gain * resonator.quadrature_rad_s)
    damping_2 = 2.0 * resonator.secondary_decay_rate_at(temperature)
    cross_damping = resonator.angular_gain * resonator.cross_damping_at(temperature)
    coriolis = resonator.angular_gain * rate
    w = np.sqrt(stiffness_1)
    for _ in range(_ROUNDS):
        ratio = (1j * w * (coriolis + cross_damping) - cross_stiffness) / (stiffness_2 - w**2 + 1j * w * damping_2)
        w = np.sqrt(stiffness_1 + np.real((cross_stiffness + 1j * w * (coriolis - cross_damping)) * ratio))
    return SteadyState(ratio, w / (2.0 * np.pi))
