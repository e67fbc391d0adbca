"""How large a gap is: the recording with the effects against the one of the same seed without them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wineglass import device as devices
from wineglass.device import Device
from wineglass.recording import Recording
from wineglass.recording.memory import MemoryRecording

TAPS = ("baseband", "output", "reference")
SEEN_THROUGH = {"true_rate": "rate", "chamber_temperature": "temperature_measured", "shell_temperature": "temperature_measured"}
SKIP = ("status", "angle", "amplitude_set_point")
SETTLED_S = 4.0
MEDIAN_OF_SQUARE = 0.454937  # of a normal number
MEAN_S = 1.0  # below 1/this the described noise floors count, too


@dataclass(frozen=True)
class ChannelGrade:
    """shift: what the effects add over the channel's noise, energy over the whole recording (SNR of a matched filter)
    ratio: the same as rms over rms, in means over a second
    noise: change of the channel's noise power over what chance makes of it"""

    shift: float
    ratio: float
    noise: float

    @property
    def snr(self) -> float:
        return max(self.shift, self.noise)


@dataclass(frozen=True)
class Grade:
    """channels: by name; healthy: how unlikely a healthy unit would have to be that explains the rest, in standard deviations; snr: the largest of the
    channels and that"""

    channels: dict[str, ChannelGrade]
    healthy: float = 0.0

    @property
    def snr(self) -> float:
        return float(np.hypot(max((grade.snr for grade in self.channels.values()), default=0.0), self.healthy))

    @property
    def channel(self) -> str:
        """Where it shows most."""
        return max(self.channels, key=lambda name: self.channels[name].snr, default="")

    def label(self) -> dict[str, Any]:
        return {"snr": self.snr, "channel": self.channel, "healthy": self.healthy,
                "channels": {name: {"shift": one.shift, "ratio": one.ratio, "noise": one.noise} for name, one in self.channels.items()}}


@dataclass(frozen=True)
class Measured:
    """What is looked at of a recording, once the drive has settled. values: (n,) by channel, lost samples NaN; per_mean: samples that make a mean;
    floor: described slow noise, rms of a mean"""

    values: dict[str, np.ndarray]
    per_mean: dict[str, int]
    floor: dict[str, float]

    def white(self, name: str) -> float:
        """Power of the white noise against which a channel is held. Errors of the reference are seen through the device's own channel."""
        own = white_power(self._sound(name))
        through = SEEN_THROUGH.get(name, "")
        other = white_power(self._sound(through)) if through in self.values else 0.0
        return max(own, other, 1e-24 * float(np.max(self._sound(name) ** 2, initial=0.0)), 1e-300)

    def _sound(self, name: str) -> np.ndarray:
        return self.values[name][np.isfinite(self.values[name])]


def measured(path: Path) -> Measured:
    """The reference counts, too: what is wrong may be in it."""
    with Recording.open(path) as recording:
        return measured_of(recording, devices.loads(recording.device_toml))


def measured_of(recording: Recording | MemoryRecording, device: Device) -> Measured:
    """The same of an open recording. device: as it is described"""
    found = Measured({}, {}, {})
    for tap in (recording.tap(name) for name in TAPS if name in recording):
        used = tap.time_s >= SETTLED_S
        for name in tap.channels:
            if name not in SKIP:
                found.values[name] = np.asarray(tap[name], float)[used]
                found.per_mean[name] = max(1, round(MEAN_S * tap.sample_rate_hz))
                found.floor[name] = described_floor(device, name)
    return found


def grade(with_effects: Path, without: Path) -> Grade:
    """Both recordings of one seed."""
    changed, plain = measured(with_effects), measured(without)
    found = {}
    for name in plain.values:
        if name in changed.values:
            count = min(len(changed.values[name]), len(plain.values[name]))
            found[name] = channel_grade(changed.values[name][:count], plain.values[name][:count], plain.per_mean[name], plain.floor[name], plain.white(name))
    return Grade(found)


def described_floor(device: Device, channel: str) -> float:
    """Slow noise [of the channel's unit] that the description grants a healthy device."""
    floor = device.noise_floor
    return {"rate": floor.rate_bias_instability_rad_s, "true_rate": floor.rate_bias_instability_rad_s,
            "rate_uncompensated": floor.rate_bias_instability_rad_s,
            "temperature_measured": floor.temperature_degc, "drive_frequency": 1e-6 * floor.frequency_ppm * device.resonator.frequency_hz,
            "drive_level": floor.drive_level_relative}.get(channel, 0.0)


def channel_grade(changed: np.ndarray, plain: np.ndarray, per_mean: int, floor: float, white: float) -> ChannelGrade:
    """(n,) each, of which `per_mean` make a mean; lost samples are NaN. floor: slow noise, rms; white: noise power."""
    sound = np.isfinite(changed - plain)
    changed, plain = changed[sound], plain[sound]
    means = len(plain) // per_mean
    if means < 2:
        return ChannelGrade(0.0, 0.0, 0.0)
    before, after = white_power(plain), white_power(changed)
    blocks = (changed - plain)[: means * per_mean].reshape(means, per_mean)
    between = white_power(changed - plain)
    slow, fast = blocks.mean(axis=1), (blocks - blocks.mean(axis=1, keepdims=True)).ravel()
    slow_energy = beyond(float(np.sum(slow**2)), means, between / per_mean)
    fast_energy = beyond(float(np.sum(fast**2)), len(fast), between)
    slow_noise = white / per_mean + floor**2
    power = abs(after - before) / (white * np.sqrt(8.0 / len(plain)))
    return ChannelGrade(float(np.sqrt(slow_energy / slow_noise + fast_energy / white)), float(np.sqrt(slow_energy / means / slow_noise)), float(power))


def beyond(energy: float, count: int, noise: float) -> float:
    """What noise of that power does not explain."""
    return max(0.0, energy - count * noise * (1.0 + 3.0 * np.sqrt(2.0 / count)))


def white_power(values: np.ndarray) -> float:
    """Power of the white part, from second differences; by their median, since steps and jumps are no noise. Lost samples (NaN) are left out."""
    second = np.diff(values[np.isfinite(values)], 2) ** 2 / 6.0
    return float(np.median(second)) / MEDIAN_OF_SQUARE if np.any(second) else 0.0
