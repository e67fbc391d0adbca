"""The rebalance loop of a described device: model, gains for a bandwidth, response of the rate output, noise.

Rate output = -(in-phase force, mean over a slow period) / primary amplitude x scale. The other axis is alike, so one complex loop describes both."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from wineglass import nominal, rebalance
from wineglass.device import Device
from wineglass.errors import BadInput
from wineglass.loop_design.margins import Response, bandwidth_hz, margins
from wineglass.loop_design.model import Gains, Loop, Schedule, decimator_response, lag_samples, resonant_plant

SLOT = 3  # firmware/core/gyro_loop.c: run_secondary()
PUBLISH_SLOT = 5  # firmware/core/gyro_slow.c: publish()
KP_MAX, KI_PER_TICK_MAX = 32000.0, 64.0  # firmware/application/limits.h


@dataclass(frozen=True)
class Rebalance:
    """The loop with what it takes to read it as a rate."""

    device: Device
    loop: Loop

    @property
    def slow_s(self) -> float:
        return 1.0 / self.device.slow_rate_hz

    @property
    def highest_hz(self) -> float:
        """Half the rate of the rate output."""
        return 0.5 * self.device.slow_rate_hz

    @property
    def scale_rad_s(self) -> float:
        """Rate per unit of in-phase force over primary amplitude."""
        device = self.device
        w = 2.0 * math.pi * device.resonator.frequency_hz
        return nominal.rebalance_acceleration_fs_s2(device) / (device.resonator.angular_gain * w)

    @property
    def quadrature_at_rest_fs(self) -> float:
        """Force that holds what cross stiffness does, at the set amplitude."""
        resonator, k = self.device.resonator, 2.0 * math.pi * self.device.resonator.frequency_hz
        split = 2.0 * math.pi * resonator.split_hz * math.sin(2.0 * math.radians(resonator.split_axis_deg))
        stiffness = k * (split + resonator.angular_gain * resonator.quadrature_rad_s)
        return stiffness * self.device.firmware.amplitude_fs / nominal.rebalance_acceleration_fs_s2(self.device)

    def mean(self, frequency_hz: np.ndarray | float) -> np.ndarray:
        """Mean over the loop ticks of a slow period; time counts from the newest."""
        loops = self.device.firmware.loops_per_slow
        return np.mean([self.loop.z(frequency_hz) ** -i for i in range(loops)], axis=0)

    def rate_response(self, frequency_hz: np.ndarray | float) -> np.ndarray:
        """Rate output over true rate, sine of any frequency; time of an output: the first sample of its slow tick, where its last amplitude is taken."""
        frequency = np.asarray(frequency_hz, float)
        return _real_part(self._force_per_rate, frequency) * self.mean(frequency)

    def test_response(self, frequency_hz: np.ndarray | float) -> np.ndarray:
        """In-phase force read out (mean over the slow period) over in-phase test force."""
        frequency = np.asarray(frequency_hz, float)
        return -_real_part(self.loop.complementary, frequency) * self.mean(frequency)

    def latency_s(self) -> float:
        """From the rate to its publication, at low frequency: what an output's time stamp must be corrected by."""
        f = 0.01
        publish = PUBLISH_SLOT / self.device.electronics.sample_rate_hz
        return -float(np.angle(complex(self.rate_response(np.array(f))))) / (2.0 * math.pi * f) + publish

    def _force_per_rate(self, frequency_hz: np.ndarray) -> np.ndarray:
        """Complex force read as a rate, per complex rate exp(j 2 pi f t). Coriolis and Euler force on mode 2: g A (j w + s/2) rate."""
        loop, plant = self.loop, self.loop.plant
        s = 2j * np.pi * frequency_hz
        k2, damping = -plant.a[1, 0], -plant.a[1, 1]
        fast = s + 1j * plant.carrier_rad_s
        motion = self.device.resonator.angular_gain * (fast - 0.5 * s) / (fast**2 + damping * fast + k2)
        delayed = motion * np.exp(-s * _pickoff_delay_samples(self.device) / self.device.electronics.sample_rate_hz)
        amplitude = delayed * decimator_response(loop.schedule, frequency_hz)
        force = -1j * loop.controller(frequency_hz) * amplitude * loop.sensitivity(frequency_hz)
        return 1j * force * self.scale_rad_s

    def noise_rad_s(self) -> float:
        """Rms of the unfiltered rate output that the secondary converter's noise (and rounding) causes."""
        adc, schedule = self.device.electronics.adc, self.loop.schedule
        variance = adc.noise_fs_rms**2 + (2.0 ** (1 - adc.bits)) ** 2 / 12.0
        grid = np.linspace(-0.5, 0.5, 4001)[:-1] * schedule.loop_rate_hz + 1e-6
        spectrum = 2.0 * variance * _tick_spectrum(schedule.decimation, 2.0 * np.pi * grid * schedule.tick_s)
        gain = np.abs(loop_gain(self.loop, grid) * self.mean(grid)) ** 2
        return self.scale_rad_s / self.device.firmware.amplitude_fs * math.sqrt(float(np.mean(spectrum * gain)))


def loop_gain(loop: Loop, frequency_hz: np.ndarray) -> np.ndarray:
    """Force per error of the measured amplitude, loop closed."""
    return loop.controller(frequency_hz) * loop.sensitivity(frequency_hz)


def _tick_spectrum(n: int, angle: np.ndarray) -> np.ndarray:
    """Spectrum of decimated unit white noise: the triangular windows of neighbouring ticks overlap."""
    weights = np.concatenate([np.arange(1, n + 1), np.arange(n - 1, 0, -1)]) / n**2
    return float(weights @ weights) + 2.0 * float(weights[:-n] @ weights[n:]) * np.cos(angle)


def _real_part(response: Response, frequency_hz: np.ndarray) -> np.ndarray:
    """Response of the real part to a real sine: (H(f) + conj H(-f))/2."""
    return 0.5 * (response(frequency_hz) + np.conj(response(-frequency_hz)))


def _pickoff_delay_samples(device: Device) -> float:
    return device.electronics.adc.delay_samples + device.electronics.adc.secondary_delay_samples


def schedule(device: Device, slot: int = SLOT) -> Schedule:
    latency = device.electronics.dac.latency_samples + _pickoff_delay_samples(device)
    return Schedule(device.electronics.sample_rate_hz, device.firmware.decimation, slot, latency)


def model(device: Device, gains: Gains) -> Rebalance:
    """Around T0, with the oscillator on the primary mode."""
    resonator = device.resonator
    unequal = 0.5 * resonator.split_hz * math.cos(2.0 * math.radians(resonator.split_axis_deg))
    decay = float(resonator.secondary_decay_rate_at(resonator.reference_temperature_degc))
    full = device.holding_acceleration_fs_s2 * device.electronics.dac.rebalance_reach
    lead = nominal.loop_delay_samples(device) + device.electronics.adc.secondary_delay_samples
    plant = resonant_plant(resonator.frequency_hz - unequal, decay, full, resonator.frequency_hz + unequal, lead,
                           device.electronics.sample_rate_hz)
    return Rebalance(device, Loop(plant, schedule(device), gains))


def gains_of_speed(device: Device, speed_rad_s: float, integral_per_s: float | None = None) -> Gains:
    """PI gains whose loop gain is speed/s: the controller's zero stands on the mode's pole, or at integral_per_s."""
    decay = float(device.resonator.secondary_decay_rate_at(device.resonator.reference_temperature_degc))
    proportional = speed_rad_s / nominal.rebalance_growth_per_s(device)
    return Gains(proportional, proportional * (decay if integral_per_s is None else integral_per_s))


def is_accepted_by_firmware(device: Device, gains: Gains) -> bool:
    """The firmware's own condition, which needs no frequency response."""
    decay = float(device.resonator.secondary_decay_rate_at(device.resonator.reference_temperature_degc))
    growth = nominal.rebalance_growth_per_s(device)
    return rebalance.is_accepted(rebalance.Loop(growth, gains.proportional, gains.integral_per_s, decay, _lag_s(device)))


def _lag_s(device: Device) -> float:
    return lag_samples(schedule(device)) / device.electronics.sample_rate_hz


def check(device: Device, gains: Gains) -> None:
    """Refuses what the firmware's numbers cannot hold, what is unstable, and what is too near to it."""
    where = f"device {device.name}, gains {gains.proportional:.5g} and {gains.integral_per_s:.5g} 1/s"
    loop = model(device, gains).loop
    if not (0.0 < gains.proportional <= KP_MAX and 0.0 <= gains.integral_per_s * loop.schedule.tick_s <= KI_PER_TICK_MAX):
        raise BadInput(f"outside the firmware's range, up to {KP_MAX:g} and {KI_PER_TICK_MAX * loop.schedule.loop_rate_hz:g} 1/s", where,
                       "choose another bandwidth, or a device with more rebalance force")
    if not loop.stable:
        raise BadInput(f"the loop is unstable: its fastest pole grows by {np.max(np.abs(loop.poles)):.4g} per loop tick", where,
                       "choose smaller gains")
    found = margins(loop)
    if found.phase_margin_deg < rebalance.PHASE_MARGIN_DEG or found.gain_margin_db < rebalance.GAIN_MARGIN_DB:
        raise BadInput(f"only {found.phase_margin_deg:.1f} deg and {found.gain_margin_db:.1f} dB of margin, at least "
                       f"{rebalance.PHASE_MARGIN_DEG:g} deg and {rebalance.GAIN_MARGIN_DB:g} dB are needed", where, "choose smaller gains")
    if not is_accepted_by_firmware(device, gains):
        raise BadInput("the firmware refuses these gains: its condition of stability allows a crossover times delay of 0.7 and an integral of a "
                       "quarter of the crossover", where, "choose smaller gains")


def design(device: Device, wanted_hz: float, integral_per_s: float | None = None) -> Gains:
    """Gains with which the rate output is 3 dB down at wanted_hz, or a refusal that says what can be had."""
    def gains(speed: float) -> Gains:
        return gains_of_speed(device, speed, integral_per_s)

    def reached(speed: float) -> float:
        made = model(device, gains(speed))
        found = bandwidth_hz(made.rate_response, made.highest_hz)
        return made.highest_hz if math.isnan(found) else found  # the output's own rate ends before the loop does

    slow, fast = _speeds(device, integral_per_s)
    low, high = reached(slow), reached(fast)
    if not low <= wanted_hz <= high:
        raise BadInput(f"a bandwidth of {wanted_hz:g} Hz is not within the {low:.3g} to {high:.4g} Hz at which the loop is soundly stable",
                       f"device {device.name}", "choose another bandwidth")
    found = gains(float(brentq(lambda speed: reached(speed) - wanted_hz, slow, fast, rtol=1e-6)))
    check(device, found)
    return found


def _speeds(device: Device, integral_per_s: float | None) -> tuple[float, float]:
    """Slowest and fastest loop gain [rad/s] that the firmware accepts (the slowest: a tenth of a hertz, or what the integral asks for)."""
    lag_s = _lag_s(device)
    fast = 0.999 * rebalance.CROSSOVER_DELAY_MAX / lag_s
    slow = 2.0 * math.pi * 0.1
    if integral_per_s is not None:
        slow = max(slow, 4.004 * integral_per_s)
    if slow >= fast:
        raise BadInput(f"an integral of {integral_per_s:g} 1/s is too fast for a loop with {1e6 * lag_s:.0f} us of delay", "--integral",
                       f"stay below {0.25 * fast:.0f} 1/s")
    return slow, fast
