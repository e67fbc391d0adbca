"""How large a gap is: the recording with the effects against the one of the same seed without them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wineglass import device as devices
from wineglass.device import Device
from wineglass.recording import Recording

TAPS = ("baseband", "output", "reference")
SKIP = ("status", "angle", "amplitude_set_point")
SETTLED_S = 4.0
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
    """Both recordings of one seed. The reference counts, too: what is wrong may be in it."""
    with Recording.open(with_effects) as changed, Recording.open(without) as plain:
        device, found = devices.loads(plain.device_toml), {}
        seen_through = _noise_of_the_device(plain)
        for tap in TAPS:
            if tap in changed.taps and tap in plain.taps:
                found |= _tap(changed.tap(tap), plain.tap(tap), device, seen_through)
        return Grade(found)


def _noise_of_the_device(plain: Recording) -> dict[str, float]:
    """White power of the channel against which each reference channel is held: errors of the reference are seen through it."""
    if "output" not in plain.taps:
        return {}
    output = plain.tap("output")
    used = output.time_s >= SETTLED_S
    pairs = {"true_rate": "rate", "chamber_temperature": "temperature_measured", "shell_temperature": "temperature_measured"}
    found = {}
    for reference, name in pairs.items():
        if name in output.channels:
            values = np.asarray(output[name], float)[used]
            found[reference] = _white(values[np.isfinite(values)])
    return found


def _tap(changed: Any, plain: Any, device: Device, seen_through: dict[str, float]) -> dict[str, ChannelGrade]:
    count = min(len(changed.time_s), len(plain.time_s))
    used = plain.time_s[:count] >= SETTLED_S
    per_mean = max(1, round(MEAN_S * plain.sample_rate_hz))
    found = {}
    for name in plain.channels:
        if name not in SKIP and name in changed.channels:
            before, after = (np.asarray(tap[name], float)[:count][used] for tap in (plain, changed))
            found[name] = channel_grade(after, before, per_mean, described_floor(device, name), seen_through.get(name, 0.0))
    return found


def described_floor(device: Device, channel: str) -> float:
    """Slow noise [of the channel's unit] that the description grants a healthy device."""
    floor = device.noise_floor
    return {"rate": floor.rate_bias_instability_rad_s, "true_rate": floor.rate_bias_instability_rad_s,
            "rate_uncompensated": floor.rate_bias_instability_rad_s,
            "temperature_measured": floor.temperature_degc, "drive_frequency": 1e-6 * floor.frequency_ppm * device.resonator.frequency_hz,
            "drive_level": floor.drive_level_relative}.get(channel, 0.0)


def channel_grade(changed: np.ndarray, plain: np.ndarray, per_mean: int, floor: float, least_white: float = 0.0) -> ChannelGrade:
    """(n,) each, of which `per_mean` make a mean; lost samples are NaN. floor: slow noise, rms; least_white: noise power at least."""
    sound = np.isfinite(changed - plain)
    changed, plain = changed[sound], plain[sound]
    means = len(plain) // per_mean
    if means < 2:
        return ChannelGrade(0.0, 0.0, 0.0)
    before, after = _white(plain), _white(changed)
    white = max(before, least_white, 1e-24 * float(np.max(plain**2)), 1e-300)
    blocks = (changed - plain)[: means * per_mean].reshape(means, per_mean)
    between = _white(changed - plain)
    slow, fast = blocks.mean(axis=1), (blocks - blocks.mean(axis=1, keepdims=True)).ravel()
    slow_energy = _beyond(float(np.sum(slow**2)), means, between / per_mean)
    fast_energy = _beyond(float(np.sum(fast**2)), len(fast), between)
    slow_noise = white / per_mean + floor**2
    power = abs(after - before) / (white * np.sqrt(8.0 / len(plain)))
    return ChannelGrade(float(np.sqrt(slow_energy / slow_noise + fast_energy / white)), float(np.sqrt(slow_energy / means / slow_noise)), float(power))


def _beyond(energy: float, count: int, noise: float) -> float:
    """What noise of that power does not explain."""
    return max(0.0, energy - count * noise * (1.0 + 3.0 * np.sqrt(2.0 / count)))


def _white(values: np.ndarray) -> float:
    """Power of the white part, from second differences; by their median, since steps and jumps are no noise."""
    second = np.diff(values, 2) ** 2 / 6.0
    return float(np.median(second)) / 0.454937 if np.any(second) else 0.0
