"""The sensed mode against the driven one."""

from __future__ import annotations

from wineglass.blind.generator.effects.register import effect
from wineglass.blind.generator.world import Slow, World

SENSE = ("quadrature", "rate", "drive_frequency")


def _split(world: World, hz: Slow) -> None:
    """Real part of the complex split: mode 1 over mode 2."""
    world.split_hz = world.split_hz + hz


@effect("frequency_split", "constant", stage="secondary", unit="Hz", typical=0.03, channels=SENSE)
def split(world: World, strength: float) -> None:
    """k1 and k2 apart, half each way"""
    _split(world, strength)


@effect("frequency_split", "secondary_only", stage="secondary", unit="Hz", typical=0.03, channels=("quadrature", "rate"))
def split_of_secondary(world: World, strength: float) -> None:
    """k2 lower, k1 as described"""
    _split(world, strength)
    world.frequency_hz = world.frequency_hz - 0.5 * strength


@effect("frequency_split", "thermal", stage="secondary", unit="Hz/degC", typical=5e-4, channels=SENSE)
def split_thermal(world: World, strength: float) -> None:
    """k1 and k2 go apart with temperature"""
    _split(world, strength * world.shift)


@effect("frequency_split", "thermal_curved", stage="secondary", unit="Hz/degC^2", typical=1e-5, channels=SENSE)
def split_curved(world: World, strength: float) -> None:
    """k1 and k2 go apart with temperature squared"""
    _split(world, strength * world.shift**2)


@effect("damping_mismatch", "secondary_only", stage="secondary", unit="1", typical=0.3, channels=("rate",))
def mismatch(world: World, strength: float) -> None:
    """mode 2 is damped more by a part"""
    world.decay_2 = world.decay_2 * (1.0 + strength)


@effect("damping_mismatch", "symmetric", stage="secondary", unit="1", typical=0.3, channels=("rate",))
def mismatch_symmetric(world: World, strength: float) -> None:
    """mode 1 is damped less and mode 2 more, half each"""
    world.decay_1, world.decay_2 = world.decay_1 * (1.0 - 0.5 * strength), world.decay_2 * (1.0 + 0.5 * strength)


@effect("damping_mismatch", "thermal", stage="secondary", unit="1/degC", typical=5e-3, channels=("rate",))
def mismatch_thermal(world: World, strength: float) -> None:
    """mode 2 is damped more, the more the warmer"""
    world.decay_2 = world.decay_2 * (1.0 + strength * world.shift)
