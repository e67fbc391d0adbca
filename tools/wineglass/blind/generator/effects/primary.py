"""The driven mode: its frequency and damping."""

from __future__ import annotations

import numpy as np

from wineglass.blind.generator.effects.register import effect
from wineglass.blind.generator.world import Slow, World
from wineglass.errors import BadInput

FREQUENCY, LEVEL = ("drive_frequency",), ("drive_level",)
SPAN_DEGC = 50.0  # temperature shift at which curved laws have the size of the straight ones


def _detune(world: World, ppm: Slow) -> None:
    world.frequency_hz = world.frequency_hz * (1.0 + 1e-6 * ppm)


def _thicken(world: World, relative: Slow) -> None:
    """More damping of both modes by a part."""
    world.decay_1, world.decay_2 = world.decay_1 * (1.0 + relative), world.decay_2 * (1.0 + relative)


@effect("frequency_temperature", "slope", stage="primary", unit="ppm/degC", typical=3.0, channels=FREQUENCY)
def frequency_slope(world: World, strength: float) -> None:
    """f changes with T in a straight line"""
    _detune(world, strength * world.shift)


@effect("frequency_temperature", "curvature", stage="primary", unit="ppm/degC^2", typical=0.06, channels=FREQUENCY)
def frequency_curvature(world: World, strength: float) -> None:
    """f changes with T squared"""
    _detune(world, strength * world.shift**2)


@effect("frequency_temperature", "sigmoid", stage="primary", unit="ppm", typical=150.0, channels=FREQUENCY)
def frequency_sigmoid(world: World, strength: float) -> None:
    """f steps softly by `strength` around a temperature, as at a change of phase of the alloy"""
    _detune(world, strength * 0.5 * (np.tanh((world.shift - 8.0) / 20.0) - np.tanh(-8.0 / 20.0)))


@effect("damping_temperature", "slope", stage="primary", unit="1/degC", typical=2e-3, channels=LEVEL)
def damping_slope(world: World, strength: float) -> None:
    """1/Q changes with T in a straight line"""
    _thicken(world, np.maximum(strength * world.shift, -0.6))


@effect("damping_temperature", "curvature", stage="primary", unit="1/degC^2", typical=4e-5, channels=LEVEL)
def damping_curvature(world: World, strength: float) -> None:
    """1/Q changes with T squared"""
    _thicken(world, np.maximum(strength * world.shift**2, -0.6))


@effect("damping_temperature", "thermoelastic", stage="primary", unit="1", typical=0.15, channels=LEVEL)
def damping_thermoelastic(world: World, strength: float) -> None:
    """1/Q has a Debye peak over T: relaxation time halves every 20 degC, peak at T0 + 20 degC"""
    turn = 2.0 ** (-(world.shift - 20.0) / 20.0)
    peak = 2.0 * turn / (1.0 + turn**2)
    _thicken(world, strength * (peak - 2.0 * 2.0 / (1.0 + 2.0**2)))


def _nonlinear(world: World, strength: float, power: int) -> tuple[float, float]:
    """Both modes follow that power of the amplitude; a device has one power."""
    taken = any(np.any(one) for one in (*world.stiffening, *world.thickening))
    if taken and world.amplitude_power != power:
        raise BadInput("two powers of the amplitude at once", "case", "take variants of the same power")
    world.amplitude_power = power
    return strength, strength


@effect("amplitude_frequency", "duffing", stage="primary", unit="ppm/FS^2", typical=3.0, channels=FREQUENCY)
def duffing(world: World, strength: float) -> None:
    """f changes with amplitude squared"""
    world.stiffening = _nonlinear(world, 2e-6 * strength, 2)


@effect("amplitude_frequency", "drive_mode_only", stage="primary", unit="ppm/FS^2", typical=3.0, channels=FREQUENCY)
def duffing_of_one_mode(world: World, strength: float) -> None:
    """f of the driven mode alone changes with amplitude squared"""
    world.stiffening = (_nonlinear(world, 2e-6 * strength, 2)[0], 0.0)


@effect("amplitude_frequency", "quartic", stage="primary", unit="ppm/FS^4", typical=4.0, channels=FREQUENCY)
def quartic(world: World, strength: float) -> None:
    """f changes with the fourth power of amplitude"""
    world.stiffening = _nonlinear(world, 2e-6 * strength, 4)


@effect("amplitude_damping", "square", stage="primary", unit="1/FS^2", typical=0.02, channels=LEVEL)
def amplitude_damping(world: World, strength: float) -> None:
    """1/Q changes with amplitude squared"""
    world.thickening = _nonlinear(world, strength, 2)


@effect("amplitude_damping", "linear", stage="primary", unit="1/FS", typical=0.02, channels=LEVEL)
def amplitude_drag(world: World, strength: float) -> None:
    """1/Q changes with amplitude, as turbulent drag does"""
    world.thickening = _nonlinear(world, strength, 1)


@effect("amplitude_damping", "quartic", stage="primary", unit="1/FS^4", typical=0.03, channels=LEVEL)
def amplitude_damping_quartic(world: World, strength: float) -> None:
    """1/Q changes with the fourth power of amplitude"""
    world.thickening = _nonlinear(world, strength, 4)


def _when(world: World, low: float = 0.35, high: float = 0.7) -> float:
    """A part of the day at which something happens."""
    return float(world.random("when it happens").uniform(low, high))


@effect("damping_step", "step", stage="primary", unit="1", typical=0.01, channels=LEVEL)
def damping_step(world: World, strength: float) -> None:
    """1/Q steps once and stays"""
    _thicken(world, strength * (world.part >= _when(world)))


@effect("damping_step", "creep", stage="primary", unit="1", typical=0.015, channels=LEVEL)
def damping_creep(world: World, strength: float) -> None:
    """1/Q creeps exponentially to another value, as when a joint settles"""
    since = np.maximum(world.part - _when(world, 0.15, 0.5), 0.0)
    _thicken(world, strength * -np.expm1(-since / 0.15))


@effect("damping_step", "leak", stage="primary", unit="1 a day's end", typical=0.015, channels=LEVEL)
def damping_leak(world: World, strength: float) -> None:
    """1/Q rises steadily as gas leaks in"""
    _thicken(world, strength * world.part)


@effect("damping_step", "there_and_back", stage="primary", unit="1", typical=0.015, channels=LEVEL)
def damping_there_and_back(world: World, strength: float) -> None:
    """1/Q steps, and back later"""
    begin = _when(world, 0.25, 0.55)
    _thicken(world, strength * ((world.part >= begin) & (world.part < begin + 0.25)))
