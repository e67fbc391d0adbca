"""Nominal calibration of a device: what a perfect laboratory would find on the device that the description describes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev

from wineglass.device import Device

MAX_ORDER = 5
FIT_TARGET = 1e-6  # relative; the order grows until the fit is this good or MAX_ORDER is reached


@dataclass(frozen=True)
class Fit:
    """coefficients: in the shift from T0, degC^-i; error: largest deviation over the largest value, over the temperature range"""

    coefficients: list[float]
    error: float


@dataclass(frozen=True)
class Gains:
    proportional: float
    integral: float


def fit(law: Callable[[np.ndarray], np.ndarray], device: Device) -> Fit:
    """Polynomial of least order for a law over the temperature [degC], over the device's temperature range."""
    low, high = device.calibration_range_degc()
    reference = device.resonator.reference_temperature_degc
    domain = [low - reference, high - reference]
    shift = np.linspace(*domain, 2001)
    exact = law(shift + reference)
    scale = float(np.max(np.abs(exact)))
    for order in range(MAX_ORDER + 1):
        series = Chebyshev.interpolate(lambda t: law(t + reference), order, domain=domain)
        error = float(np.max(np.abs(series(shift) - exact)))
        if error <= FIT_TARGET * scale:
            break
    coefficients = series.convert(domain=[-1, 1], kind=np.polynomial.Polynomial, window=[-1, 1]).coef
    return Fit([float(value) for value in coefficients], error / scale if scale else 0.0)


def scale_fit(device: Device) -> Fit:
    """S(T) = 2 zeta2 k2 / g [rad/s per unit of secondary over primary amplitude]: what the open loop's ratio is worth."""
    return fit(lambda t: 2.0 * device.resonator.decay_rate_at(t) / device.resonator.angular_gain, device)


def decay_fit(device: Device) -> Fit:
    """zeta2 k2 [1/s]: pole of the decoupling filter."""
    return fit(device.resonator.decay_rate_at, device)


def pll_gains(device: Device) -> Gains:
    """Phase loop, [1/s] and [1/s^2]: the oscillator's frequency answers the phase at once, so phase' = -Kp phase - Ki integral; damping 0.7."""
    proportional = 2.0 * math.pi * device.firmware.pll_bandwidth_hz
    return Gains(proportional, (proportional / 1.4) ** 2)


def agc_gains(device: Device) -> Gains:
    """Amplitude loop, force over amplitude and the same per s: A' = b u - A/tau with b = (amplitude at full force)/tau.
    Both closed-loop poles lie at half the bandwidth: no overshoot when the loop comes out of saturation."""
    firmware = device.firmware
    decay = float(device.resonator.decay_rate_at(device.resonator.reference_temperature_degc))
    speed = 2.0 * math.pi * firmware.agc_bandwidth_hz
    proportional = speed / (device.electronics.dac.drive_reach * firmware.amplitude_fs * decay)
    return Gains(proportional, proportional * speed / 4.0)


def loop_delay_samples(device: Device) -> float:
    """From displacement to the middle of its force: ADC, DAC latency, and half a sample of the held output."""
    return device.electronics.adc.delay_samples + device.electronics.dac.latency_samples + 0.5


def chirp_ticks_log2(device: Device) -> int:
    """Chirp of about 0.1 s, in powers of two of loop ticks."""
    return _nearest_log2(0.1 * device.electronics.sample_rate_hz / device.firmware.decimation)


def listen_ticks_log2(device: Device) -> int:
    """Each half of the listening: about 0.05 s."""
    return _nearest_log2(0.05 * device.electronics.sample_rate_hz / device.firmware.decimation)


def _nearest_log2(ticks: float) -> int:
    return round(math.log2(ticks))
