"""The thermometer."""

from __future__ import annotations

from wineglass.blind.generator import laws
from wineglass.blind.generator.effects.register import effect
from wineglass.blind.generator.world import World

MEASURED = ("temperature_measured", "rate")


@effect("thermometer_lag", "one_pole", stage="temperature", unit="s", typical=1.0, channels=MEASURED)
def lag(world: World, strength: float) -> None:
    """the thermometer follows the shell with one time constant"""
    world.thermometer_degc = laws.lag(world.thermometer_degc, world.block_s, abs(strength))


@effect("thermometer_lag", "two_poles", stage="temperature", unit="s", typical=1.0, channels=MEASURED)
def lag_of_two_poles(world: World, strength: float) -> None:
    """the thermometer follows the shell with two time constants, together `strength`"""
    world.thermometer_degc = laws.lags(world.thermometer_degc, world.block_s, (0.65 * abs(strength), 0.35 * abs(strength)))


@effect("thermometer_lag", "diffusion", stage="temperature", unit="s", typical=1.0, channels=MEASURED)
def lag_of_diffusion(world: World, strength: float) -> None:
    """the thermometer sits behind a layer that heat diffuses through"""
    world.thermometer_degc = laws.diffusion(world.thermometer_degc, world.block_s, abs(strength))


@effect("thermometer_error", "offset", stage="temperature", unit="degC", typical=2.0, channels=MEASURED)
def offset(world: World, strength: float) -> None:
    """the thermometer reads too much"""
    world.thermometer_degc = world.thermometer_degc + strength


@effect("thermometer_error", "gain", stage="temperature", unit="1", typical=0.03, channels=MEASURED)
def gain(world: World, strength: float) -> None:
    """the thermometer's shift from T0 is too large by a part"""
    reference = world.truth.resonator.reference_temperature_degc
    world.thermometer_degc = world.thermometer_degc + strength * (world.thermometer_degc - reference)


@effect("thermometer_error", "curvature", stage="temperature", unit="1/degC", typical=6e-4, channels=MEASURED)
def curvature(world: World, strength: float) -> None:
    """the thermometer is off with the square of the shift from T0"""
    reference = world.truth.resonator.reference_temperature_degc
    world.thermometer_degc = world.thermometer_degc + strength * (world.thermometer_degc - reference) ** 2


@effect("thermometer_quantisation", "steps", stage="temperature", unit="degC", typical=0.5, channels=MEASURED)
def steps(world: World, strength: float) -> None:
    """the thermometer reads in coarse steps"""
    world.thermometer_steps_degc = abs(strength)


@effect("thermometer_quantisation", "sticking_steps", stage="temperature", unit="degC", typical=0.5, channels=MEASURED)
def sticking_steps(world: World, strength: float) -> None:
    """the thermometer reads in coarse steps and changes late, as with a comparator's dead band of half a step"""
    world.thermometer_steps_degc = abs(strength)
    world.thermometer_deadband_degc = 0.25 * abs(strength)
