"""Spectra that a healthy device's telemetry has, and what noise at the pickoffs or in the rate adds to them: closed forms, for any description.

White noise of a pickoff passes mixer and decimator, is answered by the loop that acts on it, is averaged over telemetry intervals and folds at
their rate. With n the noise of an amplitude and L the loop's gain the amplitude reads n/(1 + L) and the loop's force -C n/(1 + L)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from wineglass.calibration_block import OUTPUT_FILTERS, Calibration
from wineglass.device import Device
from wineglass.loop_design import drive, rebalance
from wineglass.loop_design.model import Gains, Loop
from wineglass.native import library, pointer

PRIMARY = ("primary_in_phase", "primary_quadrature")
SECONDARY = ("secondary_in_phase", "secondary_quadrature")
FORCES = ("rebalance_in_phase", "rebalance_quadrature")
RATE = "rate"
DRIVE = ("drive_frequency", "drive_level")
"""Hz and FS: what the loops of phase and amplitude make of the primary's noise"""


@dataclass(frozen=True)
class Pickoff:
    """Variances per sample [FS^2]: of the converter's noise, which has a tolerance, and of its steps, which have none."""

    noise: float
    steps: float

    @staticmethod
    def of(device: Device) -> Pickoff:
        adc = device.electronics.adc
        return Pickoff(adc.noise_fs_rms**2, 2.0 ** (2 * (1 - adc.bits)) / 12.0)

    @property
    def whole(self) -> float:
        return self.noise + self.steps


@dataclass(frozen=True)
class FloorModel:
    """frequency_hz: bins (m,) of the telemetry's spectra; every answer is a one-sided density (m,), in the channel's unit squared per Hz."""

    device: Device
    calibration: Calibration
    rate_hz: float
    frequency_hz: np.ndarray
    loop: str

    # ---- what the channels show of white pickoff noise of unit variance per sample --------------------------------------------

    def of_white(self, channel: str) -> np.ndarray:
        """Channel's density for pickoff noise of variance 1 FS^2 per sample, on its own pickoff."""
        if channel not in self._known:
            self._known[channel] = self._of_white(channel)
        return self._known[channel]

    @cached_property
    def _known(self) -> dict[str, np.ndarray]:
        return {}

    def _of_white(self, channel: str) -> np.ndarray:
        white = self._white_tick
        if channel == RATE:
            return self._rate_of_white()
        if channel in (*PRIMARY, *DRIVE):
            loop = self._agc if channel in (PRIMARY[0], DRIVE[1]) else self._pll
            if channel in PRIMARY:
                return self._folded(lambda f: white(f) * np.abs(loop.sensitivity(f)) ** 2)
            turns = 2.0 * math.pi * self.calibration.amplitude_set_point_fs if channel == DRIVE[0] else 1.0
            return self._sampled(lambda f: white(f) * np.abs(loop.sensitivity(f) * loop.controller(f)) ** 2) / turns**2
        if self.loop == "rebalance":
            loop = self._rebalance
            seen = loop.controller if channel in FORCES else np.ones_like
            return self._folded(lambda f: white(f) * np.abs(loop.sensitivity(f) * seen(f)) ** 2)
        return self._folded(white) if channel in SECONDARY else np.zeros(len(self.frequency_hz))

    def _rate_of_white(self) -> np.ndarray:
        """Rate output: what is read, times the scale, through the output filter."""
        white, loop = self._white_tick, self._rebalance if self.loop == "rebalance" else None
        read = (lambda f: white(f) * np.abs(loop.sensitivity(f) * loop.controller(f)) ** 2) if loop is not None else white
        return self._scale**2 * self._folded(lambda f: read(f) * self._filter_power(f))

    @property
    def _scale(self) -> float:
        """Rate per FS that is read, at the described amplitude and T0."""
        calibration = self.calibration
        scale = calibration.rebalance_scale_rad_s_per_ratio if self.loop == "rebalance" else calibration.scale_rad_s_per_ratio
        return scale[0] / calibration.amplitude_set_point_fs

    def _filter_power(self, frequency_hz: np.ndarray) -> np.ndarray:
        """|output filter|^2, from the firmware's own answer to one pulse."""
        response = np.fft.rfft(_filter_pulse(OUTPUT_FILTERS.index(self.calibration.output_filter)))
        turns = np.asarray(frequency_hz) / self.calibration.slow_rate_hz
        folded = np.abs(turns - np.round(turns))
        return np.asarray(np.interp(folded, np.linspace(0.0, 0.5, len(response)), np.abs(response) ** 2))

    # ---- what the channels show of a rate ------------------------------------------------------------------------------------

    def of_rate(self, channel: str, density: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Channel's density for a rate of that one-sided density [(rad/s)^2/Hz]; in-phase channels of the secondary axis only."""
        gain = self.rate_gain(channel) ** 2 * (self._filter_power(self.frequency_hz) if channel == RATE else 1.0)
        return np.asarray(gain * self.rate_answer(self.frequency_hz) ** 2 * density(self.frequency_hz))

    def rate_gain(self, channel: str) -> float:
        """FS of the channel per rad/s at zero frequency, at the described amplitude."""
        amplitude, calibration = self.calibration.amplitude_set_point_fs, self.calibration
        if channel == SECONDARY[0] and self.loop == "open":
            return amplitude / calibration.scale_rad_s_per_ratio[0]
        if channel == FORCES[0] and self.loop == "rebalance":
            return -amplitude / calibration.rebalance_scale_rad_s_per_ratio[0]
        return 1.0 if channel == RATE else 0.0

    def rate_answer(self, frequency_hz: np.ndarray) -> np.ndarray:
        """Size of the answer to a rate, 1 at zero frequency; telemetry's means included."""
        means = np.sqrt(self._mean_power(frequency_hz))
        if self.loop == "rebalance":
            loop = self._rebalance
            return np.asarray(np.abs(loop.complementary(frequency_hz)) * means)
        return np.asarray(means / np.hypot(1.0, 2.0 * np.pi * frequency_hz / self.calibration.decay_rate_per_s[0]))

    # ---- what the channels show of the wander that the description grants -----------------------------------------------------

    def of_wander(self, channel: str) -> np.ndarray:
        """Channel's density for the described slow noise, as 1/f noise whose Allan deviation is flat at the described figure: of the drive level in the
        primary's in-phase channel, of the resonance in its quadrature, of the bias in whatever shows the rate. At the described amplitude."""
        floor = self.device.noise_floor
        if channel == PRIMARY[0]:
            return self._held_back(self._agc, floor.drive_level_relative / self.device.electronics.dac.drive_reach)
        if channel == PRIMARY[1]:
            shift = 2e-6 * math.pi * self.device.resonator.frequency_hz * floor.frequency_ppm
            return self._held_back(self._pll, shift * self.calibration.amplitude_set_point_fs)
        return self.of_rate(channel, lambda f: floor.rate_bias_instability_rad_s**2 * flicker(f))

    def _held_back(self, loop: Loop, size: float) -> np.ndarray:
        """1/f noise of an Allan floor `size` that is added to a loop's force, as the loop's input shows it."""
        f = self.frequency_hz
        left = np.abs(loop.sensitivity(f) * loop.plant_response(f)) ** 2
        return np.asarray(size**2 * flicker(f) * left * self._mean_power(f))

    # ---- what the channels show of a tone -----------------------------------------------------------------------------------

    def of_tone(self, channel: str, frequency_hz: np.ndarray) -> np.ndarray:
        """|channel|^2 per |complex amplitude|^2 of a tone so far from the carrier at the secondary pickoff, (m,)."""
        answer = self._mean_power(frequency_hz)
        if self.loop != "rebalance":
            return np.asarray(answer)
        answer = answer * np.abs(self._rebalance.sensitivity(frequency_hz)) ** 2
        return np.asarray(answer * np.abs(self._rebalance.controller(frequency_hz)) ** 2 if channel in FORCES else answer)

    # ---- inside ----------------------------------------------------------------------------------------------------------------

    @property
    def _ticks(self) -> int:
        """Loop ticks per telemetry interval."""
        return max(1, round(self.calibration.loop_rate_hz / self.rate_hz))

    def _white_tick(self, frequency_hz: np.ndarray) -> np.ndarray:
        """Two-sided density of an amplitude at loop ticks: mixed noise has twice the variance, and neighbours share half a triangle."""
        n, tick_s = self.calibration.decimation, 1.0 / self.calibration.loop_rate_hz
        own, shared = (2.0 * n**2 + 1.0) / (3.0 * n**3), (n**2 - 1.0) / (6.0 * n**3)
        return 2.0 * tick_s * (own + 2.0 * shared * np.cos(2.0 * np.pi * frequency_hz * tick_s))

    def _mean_power(self, frequency_hz: np.ndarray) -> np.ndarray:
        """|mean over the ticks of an interval|^2."""
        ticks, half = self._ticks, np.pi * np.asarray(frequency_hz) / self.calibration.loop_rate_hz
        sine = np.sin(half)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.sin(ticks * half) / (ticks * sine)
        return np.where(np.abs(sine) < 1e-12, 1.0, ratio**2)

    def _folded(self, density: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """One-sided density at the telemetry's rate of a two-sided one at loop ticks, all images summed."""
        images = np.arange(self._ticks) - self._ticks // 2
        frequency = self.frequency_hz[:, None] + images * self.rate_hz
        frequency = np.where(np.abs(frequency) < 1e-6, 1e-6, frequency)
        return 2.0 * np.sum(density(frequency) * self._mean_power(frequency), axis=1)

    def _sampled(self, density: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """The same of what is looked at once per slow tick, and averaged from there."""
        slow_hz = self.calibration.slow_rate_hz
        count, ticks = max(1, round(slow_hz / self.rate_hz)), max(1, round(self.calibration.loop_rate_hz / slow_hz))
        frequency = self.frequency_hz[:, None] + (np.arange(count) - count // 2) * self.rate_hz
        half = np.pi * np.where(np.abs(frequency) < 1e-6, 1e-6, frequency) / slow_hz
        means = (np.sin(count * half) / (count * np.sin(half))) ** 2
        looked_at = sum(density(frequency + image * slow_hz) for image in np.arange(ticks) - ticks // 2)
        return np.asarray(2.0 * np.sum(looked_at * means, axis=1))

    @cached_property
    def _pll(self) -> Loop:
        return drive.pll(self.device, Gains(self.calibration.pll_kp_per_s, self.calibration.pll_ki_per_s2))

    @cached_property
    def _agc(self) -> Loop:
        return drive.agc(self.device, Gains(self.calibration.agc_kp, self.calibration.agc_ki_per_s))

    @cached_property
    def _rebalance(self) -> Loop:
        return rebalance.model(self.device, Gains(self.calibration.rebalance_kp, self.calibration.rebalance_ki_per_s)).loop


@cache
def _filter_pulse(choice: int, length: int = 2048) -> np.ndarray:
    """Answer (length,) of an output filter to 1, at the slow rate."""
    unit = 1 << 28
    values, out = np.zeros(length, np.int32), np.empty(length, np.int32)
    values[0] = unit
    library().wg_output_filter_run(choice, 0, pointer(values, "int32_t"), pointer(out, "int32_t"), length)
    return out / unit


def flicker(frequency_hz: np.ndarray) -> np.ndarray:
    """One-sided density of noise with equal power per octave, 1/f: relaxations a factor of four apart, each of rms 1, have 0.72/f in their midst."""
    return 1.0 / (math.log(4.0) * np.asarray(frequency_hz))


def walk(frequency_hz: np.ndarray) -> np.ndarray:
    """One-sided density of a random walk of 1 per root second."""
    return 1.0 / (2.0 * (math.pi * np.asarray(frequency_hz)) ** 2)


def relaxations(frequency_hz: np.ndarray, fastest_s: float = 1.0, count: int = 5, factor: float = 4.0) -> np.ndarray:
    """The same with a fastest relaxation: beyond it 1/f^2."""
    tau = fastest_s * factor ** np.arange(count)
    return np.sum(4.0 * tau / (1.0 + (2.0 * np.pi * np.asarray(frequency_hz)[..., None] * tau) ** 2), axis=-1)
