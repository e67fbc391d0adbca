"""The sampling clock."""

from __future__ import annotations

import numpy as np

from wineglass.blind.generator.effects.register import effect
from wineglass.blind.generator.world import Tone, Trouble, World

PPM, NS = 1e-6, 1e-9
FREQUENCY = ("drive_frequency",)
NOISE = ("noise of primary_quadrature", "noise of drive_frequency")
SETTLED_S = 4.0


@effect("clock_error", "constant", stage="clock", unit="ppm", typical=200.0, channels=FREQUENCY)
def clock_error(world: World, strength: float) -> None:
    """the sampling clock is fast by a constant part"""
    world.set_clock(-PPM * strength)


@effect("clock_error", "thermal", stage="clock", unit="ppm/degC", typical=2.0, channels=FREQUENCY)
def clock_thermal(world: World, strength: float) -> None:
    """the sampling clock's frequency follows the electronics' temperature"""
    world.set_clock(-PPM * strength * (world.electronics_degc - world.truth.resonator.reference_temperature_degc))


@effect("clock_error", "ageing", stage="clock", unit="ppm a day", typical=10.0, channels=FREQUENCY)
def clock_ageing(world: World, strength: float) -> None:
    """the sampling clock drifts steadily"""
    world.set_clock(-PPM * strength * world.part)


@effect("clock_jitter", "white", stage="clock", unit="ns", typical=5.0, channels=NOISE)
def jitter(world: World, strength: float) -> None:
    """sampling instants off by independent errors"""
    world.extra["jitter"] = NS * abs(strength)


@effect("clock_jitter", "bandlimited", stage="clock", unit="ns", typical=1.0, channels=NOISE)
def jitter_bandlimited(world: World, strength: float) -> None:
    """sampling instants wander slowly, correlated over some 50 samples"""
    world.extra["jitter"] = NS * abs(strength)
    world.jitter_memory = 0.98


@effect("clock_jitter", "periodic", stage="clock", unit="ns", typical=1.0, channels=NOISE)
def jitter_periodic(world: World, strength: float) -> None:
    """sampling instants swing at 13 Hz, as a clock pulled by a supply"""
    world.tones.append(Tone("sample_time", NS * strength, 13.0))


def _instants(world: World, per_minute: float) -> np.ndarray:
    """Random sample numbers after the start, Poisson, but at least one."""
    random, rate_hz = world.random("sample troubles"), world.described.electronics.sample_rate_hz
    length_s = max(world.duration_s - SETTLED_S, 0.0)
    count = max(1, random.poisson(abs(per_minute) / 60.0 * length_s))
    return np.sort((SETTLED_S + length_s * random.random(count)) * rate_hz).astype(np.int64)


@effect("dropped_samples", "lost", stage="clock", unit="1/min", typical=5.0, channels=("primary_quadrature",))
def samples_lost(world: World, strength: float) -> None:
    """single samples never arrive"""
    world.troubles += [Trouble(int(sample), "lost") for sample in _instants(world, strength)]


@effect("dropped_samples", "doubled", stage="clock", unit="1/min", typical=5.0, channels=("primary_quadrature",))
def samples_doubled(world: World, strength: float) -> None:
    """single samples arrive twice"""
    world.troubles += [Trouble(int(sample), "doubled") for sample in _instants(world, strength)]


@effect("dropped_samples", "stale", stage="clock", unit="1/min", typical=30.0, channels=("primary_quadrature",))
def samples_stale(world: World, strength: float) -> None:
    """single samples are replaced by those before"""
    world.troubles += [Trouble(int(sample), "stale") for sample in _instants(world, strength)]


@effect("dropped_samples", "bursts", stage="clock", unit="1/min", typical=3.0, channels=("primary_quadrature",))
def samples_lost_in_bursts(world: World, strength: float) -> None:
    """two to twelve samples in a row never arrive"""
    counts = world.random("burst lengths")
    world.troubles += [Trouble(int(sample), "lost", int(counts.integers(2, 13))) for sample in _instants(world, strength)]
