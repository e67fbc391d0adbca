"""What estimated noise effects do to slow channels: spectra and covariances for an engine that looks at frames.

    added = noise_added.of(evidence.spectral.estimates, frozenset({"clock_jitter"}))
    added.densities(device, calibration, loop, frame_s, names, freq_hz)      # like described_noise.densities, to be added to it
    added.wander_psd(freq_hz)                                                # of the bias, as a rate
    added.wander_covariance(lags_s)

Estimates come from quiet windows of five and ten seconds; what is slower is extrapolated along the form that fits best there (relaxations, 1/f, or
a walk), so a sum of squares over long times is good to a factor of a few."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wineglass.calibration_block import Calibration
from wineglass.device import Device
from wineglass.diagnosis.noise_floor import DRIVE, FORCES, PRIMARY, RATE, SECONDARY, FloorModel, flicker, relaxations, walk

WANDERS = {"bias_rad_s": relaxations, "octaves_rad_s": flicker, "walk_rad_s_per_rt_s": walk}
JITTER = ("jitter_s", "slow_jitter_s")
IN_PHASE = {"jitter_s": 0.25, "slow_jitter_s": 0.0}
"""of the variance of a late sample's error; the other three quarters are in quadrature"""
LONGEST_S = 4000.0
"""a wander's covariance takes what is slower as no stronger"""
ALIKE = {"rate_uncompensated": RATE}
UNREAD, UNREAD_S = "unread_fs", 20.0
"""FS, s: how far from zero a secondary held by its loop may rest where its converter jumps back at zero, and how long it stays in one place"""


@dataclass(frozen=True)
class Added:
    """strengths: of noise sources by name, noise_spectra.py"""

    strengths: dict[str, float]

    def densities(self, device: Device, calibration: Calibration, loop: str, frame_s: float, names: Sequence[str], freq_hz: np.ndarray) -> np.ndarray:
        """(channels, n): one-sided densities of frame means, in the channels' units^2/Hz. freq_hz (n,): up to half the frame rate, without zero."""
        model = FloorModel(device, calibration, 1.0 / frame_s, np.asarray(freq_hz), loop)
        return np.array([self._of(model, ALIKE.get(name, name)) for name in names]).reshape(len(names), len(freq_hz))

    def _of(self, model: FloorModel, name: str) -> np.ndarray:
        found = np.zeros(len(model.frequency_hz))
        if name in (*PRIMARY, *DRIVE):
            found += self._on_primary(model, in_phase=name in (PRIMARY[0], DRIVE[1])) * model.of_white(name)
        elif name in (*SECONDARY, *FORCES, RATE):
            found += self.strengths.get("secondary_fs", 0.0) ** 2 * model.of_white(name)
        if name in (SECONDARY[0], FORCES[0], RATE):
            found += model.of_rate(name, self.wander_psd)
        if UNREAD in self.strengths and model.loop == "rebalance" and name in (*FORCES, RATE):
            found += model.of_rate(FORCES[0] if name in FORCES else name, lambda f: self._unread_psd(model, f))
        return found

    def _unread_psd(self, model: FloorModel, freq_hz: np.ndarray) -> np.ndarray:
        """One-sided [(rad/s)^2/Hz] of the rate that does to the loop's force what the secondary's rest away from zero does: it decays and turns there, in
        a direction that hangs on where the samples lie on the cycle."""
        resonator = model.device.resonator
        pole = math.hypot(float(resonator.decay_rate_at(resonator.reference_temperature_degc)), math.pi * resonator.split_hz)
        rate_rad_s = 2.0 * pole * self.strengths[UNREAD] / (resonator.angular_gain * model.calibration.amplitude_set_point_fs)
        return np.asarray(4.0 * rate_rad_s**2 * UNREAD_S / (1.0 + (2.0 * math.pi * UNREAD_S * freq_hz) ** 2))

    def _on_primary(self, model: FloorModel, in_phase: bool) -> float:
        """Variance per sample [FS^2] as one quadrature sees it."""
        speed = 2.0 * math.pi * model.device.resonator.frequency_hz * model.calibration.amplitude_set_point_fs
        late = sum((self.strengths.get(name, 0.0) * speed) ** 2 * (IN_PHASE[name] if in_phase else 0.75) for name in JITTER)
        return self.strengths.get("primary_fs", 0.0) ** 2 + late

    def wander_psd(self, freq_hz: np.ndarray) -> np.ndarray:
        """One-sided density [(rad/s)^2/Hz] of the bias that wanders, as a rate; zero without flicker_noise."""
        f = np.asarray(freq_hz, float)
        return np.asarray(sum((self.strengths.get(name, 0.0) ** 2 * form(f) for name, form in WANDERS.items()), np.zeros_like(f)))

    def wander_covariance(self, lags_s: np.ndarray) -> np.ndarray:
        """Of that bias [(rad/s)^2] at lags (n,)."""
        f = np.geomspace(1.0 / LONGEST_S, 50.0, 4000)
        integrand = self.wander_psd(f) * f  # over log f; below its first value the density goes on as it begins
        return np.asarray(integrand[0] + np.trapezoid(integrand * np.cos(2.0 * np.pi * np.asarray(lags_s, float)[:, None] * f), np.log(f), axis=1))


def of(estimates: Mapping[str, Sequence], effects: frozenset[str]) -> Added:
    """estimates: per effect, noise_spectra.Estimate each, of that effect alone."""
    return Added({item.name: item.value for effect in sorted(effects) for item in estimates.get(effect, [])})
