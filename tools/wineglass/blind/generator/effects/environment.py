"""What comes from outside, and the bench's own reference."""

from __future__ import annotations

import math

import numpy as np

from wineglass.blind.generator.effects.register import effect
from wineglass.blind.generator.world import Tone, World

DEG_H = math.pi / 180.0 / 3600.0
MILLI = 1e-3
EARTH_DEG_H = 15.041


def _bursts(world: World, purpose: str) -> np.ndarray:
    """0/1 over time: on for parts of the day."""
    random, on = world.random(purpose), np.zeros(world.edges)
    for begin in random.uniform(0.15, 0.85, 4):
        on[(world.part >= begin) & (world.part < begin + 0.08)] = 1.0
    return on


@effect("vibration", "rocking", stage="environment", unit="deg/s", typical=0.3, channels=("noise of rate",))
def rocking(world: World, strength: float) -> None:
    """the base rocks at 7.3 Hz about the sense axis; the table does not know"""
    swing = np.radians(strength) * np.sin(2.0 * np.pi * 7.3 * world.time_s + 0.7)
    world.rate_error_rad_s = world.rate_error_rad_s + swing


@effect("vibration", "rectified", stage="environment", unit="deg/h", typical=60.0)
def rectified(world: World, strength: float) -> None:
    """bias while the base shakes, four times a day"""
    world.bias_rad_s = world.bias_rad_s + DEG_H * strength * _bursts(world, "shaking")


@effect("vibration", "near_carrier", stage="environment", unit="ppm of holding force", typical=100.0, channels=("noise of rate", "noise of quadrature"))
def shaken_near_carrier(world: World, strength: float) -> None:
    """the base shakes mode 2 at a line 4.2 Hz above the carrier"""
    size = 1e-6 * strength * float(np.mean(world.drive_force)) / world.truth.electronics.dac.drive_reach
    world.tones.append(Tone("force_2", size, world.truth.resonator.frequency_hz + 4.2, 0.4))


@effect("interference", "near_carrier", stage="environment", unit="ppm of FS", typical=20.0, channels=("noise of rate", "noise of quadrature"))
def tone_near_carrier(world: World, strength: float) -> None:
    """an electrical tone 6.7 Hz above the carrier in the secondary channel"""
    world.tones.append(Tone("adc_2", 1e-6 * strength, world.truth.resonator.frequency_hz + 6.7, 1.1))


@effect("interference", "alias", stage="environment", unit="ppm of FS", typical=10.0, channels=("noise of rate", "noise of quadrature"))
def tone_alias(world: World, strength: float) -> None:
    """a tone in both channels whose alias lies 9.1 Hz below the carrier"""
    frequency = world.described.electronics.sample_rate_hz - world.truth.resonator.frequency_hz + 9.1
    world.tones.append(Tone("both_adc", 1e-6 * strength, frequency, 2.0))


@effect("interference", "drifting", stage="environment", unit="ppm of FS", typical=20.0, channels=("noise of rate", "noise of quadrature"))
def tone_drifting(world: World, strength: float) -> None:
    """a tone of a free-running converter that drifts through the carrier's band with temperature"""
    frequency = world.truth.resonator.frequency_hz + 5.0 + 0.15 * world.shift
    world.tones.append(Tone("adc_2", 1e-6 * strength, frequency, 0.2))


@effect("rate_reference", "earth", stage="environment", unit="deg/h", typical=EARTH_DEG_H)
def earth(world: World, strength: float) -> None:
    """a rate that the table does not know of: the Earth's along the axis"""
    world.rate_error_rad_s = world.rate_error_rad_s + DEG_H * strength


@effect("rate_reference", "scale", stage="environment", unit="1", typical=0.03, channels=("true_rate", "rate"))
def reference_scale(world: World, strength: float) -> None:
    """the true-rate channel reads too much by a part"""
    world.bench.rate_gain *= 1.0 + strength


@effect("rate_reference", "misalignment", stage="environment", unit="deg", typical=12.0)
def table_misalignment(world: World, strength: float) -> None:
    """the sense axis is tilted against the table's: the device sees the cosine, and the Earth's rate as the table turns"""
    tilt = math.radians(strength)
    angle = np.concatenate(([0.0], np.cumsum(0.5 * (world.table_rate_rad_s[1:] + world.table_rate_rad_s[:-1]) * world.block_s)))
    earth_part = DEG_H * EARTH_DEG_H * math.sin(tilt) * np.cos(angle)
    world.rate_error_rad_s = world.rate_error_rad_s + (math.cos(tilt) - 1.0) * world.table_rate_rad_s + earth_part


@effect("rate_reference", "offset", stage="environment", unit="deg/h", typical=30.0, channels=("true_rate", "rate"))
def reference_offset(world: World, strength: float) -> None:
    """the true-rate channel has an offset"""
    world.bench.rate_offset_rad_s = world.bench.rate_offset_rad_s + DEG_H * strength
