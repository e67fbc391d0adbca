"""Nominal calibration of a device: what a perfect laboratory would find on the device that the description describes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev

from wineglass.calibration_block import Calibration, from_binary, make, read_json
from wineglass.device import Device
from wineglass.errors import BadInput
from wineglass.scenario import Run
from wineglass.steady_state import steady_state

MAX_ORDER = 5
CHIRP_S = 0.1
SETTLE_TICKS = 20  # loop ticks; the decimator forgets the drive within three
LISTEN_S = 0.1
AUDIBLE_FS = 3e-4  # 50 dB under full scale and 20 dB over the noise of a loop tick
REBALANCE_SCALE_MAX = 8.0  # rad/s per unit of ratio, end of the firmware's format
DRIVE_LIMIT_FS = 0.9999
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
    return fit(lambda t: _scale(device, t), device)


def decay_fit(device: Device) -> Fit:
    """zeta2 k2 [1/s]: pole of the decoupling filter."""
    return fit(device.resonator.secondary_decay_rate_at, device)


def zero_rate_fit(device: Device) -> Fit:
    """The whole output at zero rate [rad/s]: cross damping and what the frequency split's quadrature leaks, which no output can tell apart."""
    return fit(lambda t: _scale(device, t) * steady_state(device.resonator, t).ratio.real, device)


def _scale(device: Device, temperature_degc: np.ndarray) -> np.ndarray:
    return 2.0 * device.resonator.secondary_decay_rate_at(temperature_degc) / device.resonator.angular_gain


def rebalance_scale_fit(device: Device) -> Fit:
    """K(T) = F/(g 2 pi f) [rad/s per unit of in-phase force over primary amplitude]: the force that holds the secondary at rest is g W x1'."""
    full, gain = rebalance_acceleration_fs_s2(device), device.resonator.angular_gain
    return fit(lambda t: full / (gain * 2.0 * math.pi * device.resonator.frequency_at(t)), device)


def demodulation_phase_rad(device: Device) -> float:
    """By which the secondary pickoff lags the primary: what its channel is later."""
    return 2.0 * math.pi * device.electronics.adc.secondary_delay_samples * device.resonator.frequency_hz / device.electronics.sample_rate_hz


def held_output(device: Device) -> float:
    """What the DAC's zero-order hold leaves of a force at the carrier: sinc(f/fs)."""
    return float(np.sinc(device.resonator.frequency_hz / device.electronics.sample_rate_hz))


def rebalance_acceleration_fs_s2(device: Device) -> float:
    """Amplitude [FS/s^2] of the fullest rebalance force at the carrier, per modal mass."""
    return device.holding_acceleration_fs_s2 * device.electronics.dac.rebalance_reach * held_output(device)


def rebalance_growth_per_s(device: Device) -> float:
    """b [1/s]: how fast a full rebalance force changes the measured secondary amplitude, F/(2 w)."""
    return rebalance_acceleration_fs_s2(device) / (4.0 * math.pi * device.resonator.frequency_hz)


def rebalance_gains(device: Device) -> Gains:
    """Rebalance loop, force over amplitude and the same per s. The controller's zero stands on the mode's pole, which leaves an integrator of
    the wanted bandwidth: b Kp = 2 pi bandwidth, Ki = Kp/tau."""
    decay = float(device.resonator.secondary_decay_rate_at(device.resonator.reference_temperature_degc))
    proportional = 2.0 * math.pi * device.firmware.rebalance_bandwidth_hz / rebalance_growth_per_s(device)
    return Gains(proportional, proportional * decay)


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
    proportional = speed / (device.electronics.dac.drive_reach * held_output(device) * firmware.amplitude_fs * decay)
    return Gains(proportional, proportional * speed / 4.0)


def loop_delay_samples(device: Device) -> float:
    """From displacement to the middle of its force: ADC, DAC latency, and half a sample of the held output."""
    return device.electronics.adc.delay_samples + device.electronics.dac.latency_samples + 0.5


def search_band_hz(device: Device) -> tuple[float, float]:
    """Where cold start looks: every frequency of the temperature range, and the description's tolerance around it."""
    frequency = device.resonator.frequency_at(np.linspace(*device.calibration_range_degc(), 101))
    margin = device.firmware.search_fraction
    return float(np.min(frequency)) * (1.0 - margin), float(np.max(frequency)) * (1.0 + margin)


def calibration(run: Run, *, zero_rate: bool = False) -> Calibration:
    """The nominal calibration of the run's device as described, set up for the run's loop and mode.

    zero_rate: the bias polynomial is the whole output at zero rate, as a thermal sweep would show it, instead of the cross damping alone.
    """
    device = run.device
    return make({
        "device_name": device.name, "serial": 1, "sequence": 1,
        "sample_rate_hz": device.electronics.sample_rate_hz,
        "decimation": device.firmware.decimation, "loops_per_slow": device.firmware.loops_per_slow,
        **_temperature(device), **_polynomials(device, zero_rate), **_acquisition(device), **_loops(device), **_monitors(),
        **_mode(run),
    }, f"nominal calibration of {device.name}")


def from_file(run: Run, path: str) -> Calibration:
    """A calibration file (.json, or .bin as the firmware reads it), set up for the run's mode."""
    found = from_binary(_bytes_of(path), path) if path.endswith(".bin") else read_json(path)
    return found.with_changes(**_mode(run))


def _mode(run: Run) -> dict[str, Any]:
    return {"loop": run.scenario.mode.loop, "compensation": run.scenario.mode.compensation, "output_filter": run.output_filter}


def _bytes_of(path: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise BadInput(f"cannot read the calibration: {error.strerror}", path, "give the path of a calibration file") from None


def _temperature(device: Device) -> dict[str, Any]:
    thermometer, reference = device.electronics.thermometer, device.resonator.reference_temperature_degc
    low, high = device.calibration_range_degc()
    return {"reference_temperature_degc": reference, "temperature_min_degc": low, "temperature_max_degc": high,
            "thermometer_code_at_reference": round((reference - thermometer.zero_degc) / thermometer.lsb_degc),
            "thermometer_degc_per_lsb": thermometer.lsb_degc}


def _polynomials(device: Device, zero_rate: bool) -> dict[str, Any]:
    bias = zero_rate_fit(device).coefficients if zero_rate else list(device.resonator.cross_damping_rad_s)
    return {"bias_rad_s": bias, "angular_gain": device.resonator.angular_gain,
            "scale_rad_s_per_ratio": scale_fit(device).coefficients, "decay_rate_per_s": decay_fit(device).coefficients,
            "demodulation_phase_rad": [demodulation_phase_rad(device)]}


def _acquisition(device: Device) -> dict[str, Any]:
    low, high = search_band_hz(device)
    tick_s = device.firmware.decimation / device.electronics.sample_rate_hz
    return {"nominal_frequency_hz": device.resonator.frequency_hz, "search_min_hz": low, "search_max_hz": high,
            "chirp_s": _power_of_two(CHIRP_S, tick_s), "settle_s": SETTLE_TICKS * tick_s, "listen_s": _power_of_two(LISTEN_S, tick_s),
            "audible_amplitude_fs": AUDIBLE_FS, "acquisition_attempts": 3}


def _power_of_two(seconds: float, tick_s: float) -> float:
    """The nearest 2^n loop ticks [s]."""
    return 2.0 ** round(math.log2(seconds / tick_s)) * tick_s


def _loops(device: Device) -> dict[str, Any]:
    pll, agc = pll_gains(device), agc_gains(device)
    return {"pll_kp_per_s": pll.proportional, "pll_ki_per_s2": pll.integral, "agc_kp": agc.proportional, "agc_ki_per_s": agc.integral,
            "amplitude_set_point_fs": device.firmware.amplitude_fs, "drive_limit_fs": DRIVE_LIMIT_FS,
            "loop_delay_samples": loop_delay_samples(device), **_rebalance(device)}


def _rebalance(device: Device) -> dict[str, Any]:
    """Nothing for a shell so damped that the forces reach beyond the firmware's range of rates: it is run open loop."""
    scale, gains = rebalance_scale_fit(device).coefficients, rebalance_gains(device)
    if scale[0] >= REBALANCE_SCALE_MAX:
        return {}
    return {"rebalance_scale_rad_s_per_ratio": scale, "rebalance_kp": gains.proportional, "rebalance_ki_per_s": gains.integral,
            "rebalance_in_phase_limit_fs": device.firmware.rebalance_in_phase_limit_fs,
            "rebalance_quadrature_limit_fs": device.firmware.rebalance_quadrature_limit_fs}


def _monitors() -> dict[str, Any]:
    return {"lock_phase_limit_deg": 0.5, "lock_amplitude_limit": 0.005, "lock_hold_s": 0.1, "adc_limit_fs": 0.999}
