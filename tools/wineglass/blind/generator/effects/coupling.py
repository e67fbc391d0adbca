"""What couples the modes: bias, quadrature, angular gain, and what temperature's history does to them."""

from __future__ import annotations

import numpy as np

from wineglass.blind.generator import laws
from wineglass.blind.generator.effects.register import effect
from wineglass.blind.generator.world import Slow, World

DEG_H = np.pi / 180.0 / 3600.0
REVERSALS_DEGC = (-25.0, 75.0)  # range of the Preisach grid


def _bias(world: World, deg_h: Slow) -> None:
    world.bias_rad_s = world.bias_rad_s + DEG_H * deg_h


@effect("cross_damping", "constant", stage="coupling", unit="deg/h", typical=60.0)
def cross_damping(world: World, strength: float) -> None:
    """cross damping beside the calibrated one, constant"""
    _bias(world, strength)


@effect("cross_damping", "slope", stage="coupling", unit="deg/h/degC", typical=1.5)
def cross_damping_slope(world: World, strength: float) -> None:
    """cross damping off the calibrated polynomial by a straight line"""
    _bias(world, strength * world.shift)


@effect("cross_damping", "bump", stage="coupling", unit="deg/h", typical=60.0)
def cross_damping_bump(world: World, strength: float) -> None:
    """a bump of cross damping around T0 + 20 degC, as of a mode crossing"""
    _bias(world, strength * np.exp(-0.5 * ((world.shift - 20.0) / 8.0) ** 2))


@effect("cross_damping", "sigmoid", stage="coupling", unit="deg/h", typical=60.0)
def cross_damping_sigmoid(world: World, strength: float) -> None:
    """cross damping steps softly around a temperature"""
    _bias(world, strength * 0.5 * (1.0 + np.tanh((world.shift - 5.0) / 15.0)))


@effect("cross_stiffness", "constant", stage="coupling", unit="deg/s", typical=0.6, channels=("quadrature",))
def cross_stiffness(world: World, strength: float) -> None:
    """quadrature, constant"""
    world.quadrature_rad_s = world.quadrature_rad_s + np.radians(strength)


@effect("cross_stiffness", "slope", stage="coupling", unit="deg/s/degC", typical=0.01, channels=("quadrature",))
def cross_stiffness_slope(world: World, strength: float) -> None:
    """quadrature in a straight line over temperature"""
    world.quadrature_rad_s = world.quadrature_rad_s + np.radians(strength * world.shift)


@effect("cross_stiffness", "curvature", stage="coupling", unit="deg/s/degC^2", typical=2e-4, channels=("quadrature",))
def cross_stiffness_curvature(world: World, strength: float) -> None:
    """quadrature over temperature squared"""
    world.quadrature_rad_s = world.quadrature_rad_s + np.radians(strength * world.shift**2)


@effect("coriolis_gain", "constant", stage="coupling", unit="1", typical=0.04)
def gain(world: World, strength: float) -> None:
    """angular gain off by a part"""
    world.angular_gain = world.angular_gain * (1.0 + strength)


@effect("coriolis_gain", "slope", stage="coupling", unit="1/degC", typical=3e-4)
def gain_slope(world: World, strength: float) -> None:
    """angular gain changes with temperature"""
    world.angular_gain = world.angular_gain * (1.0 + strength * world.shift)


@effect("coriolis_gain", "cubic", stage="coupling", unit="1/(rad/s)^2", typical=0.02)
def gain_cubic(world: World, strength: float) -> None:
    """angular gain changes with rate squared"""
    world.angular_gain = world.angular_gain * (1.0 + strength * world.rate_rad_s**2)


@effect("coriolis_gain", "saturating", stage="coupling", unit="1/(rad/s)", typical=0.02)
def gain_saturating(world: World, strength: float) -> None:
    """angular gain changes with the magnitude of the rate"""
    world.angular_gain = world.angular_gain * (1.0 + strength * np.abs(world.rate_rad_s))


@effect("thermal_gradient", "derivative", stage="coupling", unit="deg/h per degC/s", typical=20.0)
def gradient(world: World, strength: float) -> None:
    """bias follows the shell's dT/dt at once"""
    _bias(world, strength * laws.slope(world.shell_degc, world.block_s))


@effect("thermal_gradient", "mount", stage="coupling", unit="deg/h per degC", typical=20.0)
def gradient_of_mount(world: World, strength: float) -> None:
    """bias follows the difference between the shell and an inner node a fifth of its time constant behind"""
    inner = laws.lag(world.shell_degc, world.block_s, 0.2 * world.truth.thermal.shell_time_constant_s)
    _bias(world, strength * (world.shell_degc - inner))


@effect("thermal_gradient", "distributed", stage="coupling", unit="deg/h per degC", typical=20.0)
def gradient_distributed(world: World, strength: float) -> None:
    """bias follows the difference along a slab that heat diffuses through"""
    inner = laws.diffusion(world.shell_degc, world.block_s, 0.2 * world.truth.thermal.shell_time_constant_s)
    _bias(world, strength * (world.shell_degc - inner))


def _hysteresis(world: World, deg_h: np.ndarray) -> None:
    """Values on the coarse grid."""
    times = np.arange(len(deg_h)) * 0.1
    _bias(world, np.interp(np.arange(world.edges) * world.block_s, times, deg_h))


@effect("thermal_hysteresis", "play", stage="coupling", unit="deg/h", typical=20.0)
def hysteresis_play(world: World, strength: float) -> None:
    """bias depends on how a play of +-8 degC stands against the temperature; strength: half the opening"""
    temperature = world.coarse(world.shell_degc)
    _hysteresis(world, strength * (laws.play(temperature, 8.0) - temperature) / 8.0)


@effect("thermal_hysteresis", "prandtl_ishlinskii", stage="coupling", unit="deg/h", typical=20.0)
def hysteresis_prandtl(world: World, strength: float) -> None:
    """bias depends on six plays of 2 to 17 degC against the temperature; strength: half the opening"""
    temperature, widths = world.coarse(world.shell_degc), np.arange(2.0, 18.0, 3.0)
    offsets = (laws.plays(temperature, widths) - temperature[:, None]) / widths
    _hysteresis(world, strength * offsets.mean(axis=1))


@effect("thermal_hysteresis", "preisach", stage="coupling", unit="deg/h", typical=60.0)
def hysteresis_preisach(world: World, strength: float) -> None:
    """bias depends on relays of a Preisach plane, their mean over temperature taken off; strength: saturation"""
    temperature = world.coarse(world.shell_degc)
    relays = laws.preisach(temperature, *REVERSALS_DEGC)
    middle = 2.0 * (temperature - REVERSALS_DEGC[0]) / (REVERSALS_DEGC[1] - REVERSALS_DEGC[0]) - 1.0
    _hysteresis(world, strength * (relays - np.clip(middle, -1.0, 1.0)))


@effect("ageing", "linear", stage="coupling", unit="deg/h a day", typical=30.0)
def ageing_linear(world: World, strength: float) -> None:
    """bias drifts steadily; strength: change over the whole recording"""
    _bias(world, strength * world.part)


@effect("ageing", "logarithmic", stage="coupling", unit="deg/h a day", typical=40.0)
def ageing_logarithmic(world: World, strength: float) -> None:
    """bias drifts with the logarithm of time; strength: change over the whole recording"""
    _bias(world, strength * np.log1p(50.0 * world.part) / np.log(51.0))


@effect("ageing", "exponential", stage="coupling", unit="deg/h a day", typical=40.0)
def ageing_exponential(world: World, strength: float) -> None:
    """bias settles exponentially within a third of the recording"""
    _bias(world, strength * -np.expm1(-3.0 * world.part))
