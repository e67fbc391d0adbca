"""From DAC codes to forces."""

from __future__ import annotations

import numpy as np

from wineglass.blind.generator.effects.register import effect
from wineglass.blind.generator.world import Slow, World

MRAD = 1e-3


def _lag(world: World, mrad: Slow) -> None:
    """Both forces late by a phase of the carrier."""
    delay_s = MRAD * mrad / (2.0 * np.pi * world.described.resonator.frequency_hz)
    world.drive_delay_s, world.rebalance_delay_s = world.drive_delay_s + delay_s, world.rebalance_delay_s + delay_s


@effect("drive_misalignment", "constant", stage="actuation", unit="mrad", typical=0.05)
def misalignment(world: World, strength: float) -> None:
    """drive electrodes turned: a part of the drive force acts on mode 2"""
    world.drive_angle_rad = world.drive_angle_rad + MRAD * strength


@effect("drive_misalignment", "thermal", stage="actuation", unit="mrad/degC", typical=2e-3)
def misalignment_thermal(world: World, strength: float) -> None:
    """the drive force turns with temperature"""
    world.drive_angle_rad = world.drive_angle_rad + MRAD * strength * world.shift


@effect("drive_misalignment", "curved", stage="actuation", unit="mrad/degC^2", typical=4e-5)
def misalignment_curved(world: World, strength: float) -> None:
    """the drive force turns with temperature squared"""
    world.drive_angle_rad = world.drive_angle_rad + MRAD * strength * world.shift**2


def _amplify(world: World, relative: Slow) -> None:
    world.drive_force, world.rebalance_force = world.drive_force * (1.0 + relative), world.rebalance_force * (1.0 + relative)


@effect("actuator_gain", "slope", stage="actuation", unit="1/degC", typical=1e-3, channels=("drive_level",))
def actuator_slope(world: World, strength: float) -> None:
    """force per code changes with temperature in a straight line"""
    _amplify(world, strength * world.shift)


@effect("actuator_gain", "curvature", stage="actuation", unit="1/degC^2", typical=2e-5, channels=("drive_level",))
def actuator_curvature(world: World, strength: float) -> None:
    """force per code changes with temperature squared"""
    _amplify(world, strength * world.shift**2)


@effect("actuator_gain", "sigmoid", stage="actuation", unit="1", typical=0.04, channels=("drive_level",))
def actuator_sigmoid(world: World, strength: float) -> None:
    """force per code steps softly around a temperature"""
    _amplify(world, strength * 0.5 * (np.tanh((world.shift - 5.0) / 15.0) + np.tanh(5.0 / 15.0)))


@effect("drive_phase", "delay", stage="actuation", unit="mrad", typical=3.0, channels=("drive_frequency", "rate", "quadrature"))
def drive_delay(world: World, strength: float) -> None:
    """forces come late by a constant time (negative strengths are not possible)"""
    _lag(world, abs(strength))


@effect("drive_phase", "pickoffs", stage="actuation", unit="mrad", typical=3.0, channels=("drive_frequency", "rate", "quadrature"))
def common_delay(world: World, strength: float) -> None:
    """both pickoffs late by a constant time"""
    delay_s = MRAD * strength / (2.0 * np.pi * world.described.resonator.frequency_hz)
    world.pickoff_delay_s = [delay + delay_s for delay in world.pickoff_delay_s]


@effect("drive_phase", "amplifier_pole", stage="actuation", unit="mrad", typical=3.0, channels=("drive_frequency", "rate", "quadrature"))
def drive_pole(world: World, strength: float) -> None:
    """a pole of the force amplifiers: late, and weaker by the cosine; its corner falls 0.3 % per degC"""
    phase = np.arctan(MRAD * abs(strength) * (1.0 + 3e-3 * world.shift))
    _lag(world, phase / MRAD)
    _amplify(world, np.cos(phase) - 1.0)
