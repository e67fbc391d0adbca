"""From displacement to ADC codes."""

from __future__ import annotations

import numpy as np

from wineglass.blind.generator import laws
from wineglass.blind.generator.effects.register import effect
from wineglass.blind.generator.world import Slow, World

MRAD, PPM = 1e-3, 1e-6
KNOTS = 8193
NOISE = ("noise of secondary_quadrature", "noise of secondary_in_phase")


def _amplify(world: World, relative: Slow) -> None:
    world.pickoff_gain[1] = world.pickoff_gain[1] * (1.0 + relative)


def _late(world: World, mrad: Slow) -> None:
    """The secondary pickoff lags by a phase of the carrier."""
    world.pickoff_delay_s[1] = world.pickoff_delay_s[1] + MRAD * mrad / (2.0 * np.pi * world.described.resonator.frequency_hz)


@effect("pickoff_gain", "constant", stage="pickoff", unit="1", typical=0.05)
def gain(world: World, strength: float) -> None:
    """secondary pickoff too sensitive by a part"""
    _amplify(world, strength)


@effect("pickoff_gain", "slope", stage="pickoff", unit="1/degC", typical=5e-4)
def gain_slope(world: World, strength: float) -> None:
    """secondary pickoff's gain changes with temperature"""
    _amplify(world, strength * world.shift)


@effect("pickoff_gain", "curvature", stage="pickoff", unit="1/degC^2", typical=1e-5)
def gain_curvature(world: World, strength: float) -> None:
    """secondary pickoff's gain changes with temperature squared"""
    _amplify(world, strength * world.shift**2)


@effect("pickoff_phase", "constant", stage="pickoff", unit="mrad", typical=2.0, channels=("rate", "quadrature"))
def phase(world: World, strength: float) -> None:
    """secondary pickoff late by a constant time"""
    _late(world, strength)


@effect("pickoff_phase", "slope", stage="pickoff", unit="mrad/degC", typical=0.05, channels=("rate", "quadrature"))
def phase_slope(world: World, strength: float) -> None:
    """secondary pickoff late by a time that grows with temperature"""
    _late(world, strength * world.shift)


@effect("pickoff_phase", "pole", stage="pickoff", unit="mrad", typical=2.0, channels=("rate", "quadrature"))
def phase_pole(world: World, strength: float) -> None:
    """a pole of the secondary preamplifier: late, and weaker by the cosine; its corner falls 0.3 % per degC"""
    angle = np.arctan(MRAD * strength * (1.0 + 3e-3 * world.shift))
    _late(world, angle / MRAD)
    _amplify(world, np.cos(angle) - 1.0)


def _add(world: World, name: str, value: Slow) -> None:
    world.extra[name] = world.extra.get(name, 0.0) + value


@effect("drive_feedthrough", "resistive", stage="pickoff", unit="ppm", typical=100.0, channels=("quadrature", "rate"))
def feedthrough(world: World, strength: float) -> None:
    """drive voltage leaks into the secondary pickoff in phase"""
    _add(world, "drive_leak_2", PPM * strength)


@effect("drive_feedthrough", "capacitive", stage="pickoff", unit="ppm", typical=200.0, channels=("quadrature", "rate"))
def feedthrough_capacitive(world: World, strength: float) -> None:
    """the drive voltage's steps leak into the secondary pickoff through a capacitance"""
    _add(world, "drive_edge_2", PPM * strength)


@effect("drive_feedthrough", "thermal", stage="pickoff", unit="ppm/degC", typical=3.0, channels=("quadrature", "rate"))
def feedthrough_thermal(world: World, strength: float) -> None:
    """drive voltage leaks into the secondary pickoff, the more the warmer"""
    _add(world, "drive_leak_2", PPM * strength * world.shift)


def _bend(world: World, error: np.ndarray, channels: tuple[int, ...] = (0, 1)) -> None:
    for channel in channels:
        before = world.adc_error[channel]
        world.adc_error[channel] = error if before is None else before + error


def _input() -> np.ndarray:
    return np.linspace(-1.0, 1.0, KNOTS)


@effect("adc_nonlinearity", "cubic", stage="pickoff", unit="FS", typical=3e-3, channels=("drive_level", "secondary_in_phase"))
def inl_cubic(world: World, strength: float) -> None:
    """both converters bend with the third power"""
    _bend(world, strength * _input() ** 3)


@effect("adc_nonlinearity", "sawtooth", stage="pickoff", unit="FS", typical=5e-4, channels=("drive_level", "secondary_in_phase"))
def inl_sawtooth(world: World, strength: float) -> None:
    """both converters: a sawtooth with eight teeth, as of a segmented converter"""
    _bend(world, strength * 2.0 * ((4.0 * _input()) % 1.0 - 0.5))


@effect("adc_nonlinearity", "step", stage="pickoff", unit="FS", typical=5e-4, channels=("drive_level", "secondary_in_phase"))
def inl_step(world: World, strength: float) -> None:
    """both converters: codes above half scale are off, as by a wrong weight of one bit"""
    x = _input()
    _bend(world, strength * np.where(np.abs(x) > 0.5, np.sign(x), 0.0))


@effect("adc_nonlinearity", "zero_step", stage="pickoff", unit="FS", typical=2e-4, channels=("secondary_in_phase", "drive_level"))
def inl_zero(world: World, strength: float) -> None:
    """both converters: a step at zero, as by a wrong weight of the sign bit"""
    _bend(world, 0.5 * strength * np.sign(_input()))


@effect("adc_saturation", "hard", stage="pickoff", unit="1", typical=5e-3, channels=("drive_level",))
def clipping(world: World, strength: float) -> None:
    """the converters clip below the amplitude's set-point by a part of it"""
    x, ceiling = _input(), world.described.firmware.amplitude_fs * (1.0 - strength)
    _bend(world, np.clip(x, -ceiling, ceiling) - x)


@effect("adc_saturation", "one_sided", stage="pickoff", unit="1", typical=5e-3, channels=("drive_level",))
def clipping_one_sided(world: World, strength: float) -> None:
    """the converters clip on the positive side only"""
    x, ceiling = _input(), world.described.firmware.amplitude_fs * (1.0 - strength)
    _bend(world, np.minimum(x, ceiling) - x)


@effect("adc_saturation", "soft", stage="pickoff", unit="1", typical=0.03, channels=("drive_level",))
def clipping_soft(world: World, strength: float) -> None:
    """the preamplifiers compress above 0.7 FS: strength is the part lost of what exceeds it"""
    x = _input()
    _bend(world, -strength * np.sign(x) * np.maximum(np.abs(x) - 0.7, 0.0))


@effect("excess_noise", "white", stage="pickoff", unit="1", typical=1.5, channels=NOISE)
def noise_white(world: World, strength: float) -> None:
    """secondary pickoff noisier: strength is the added noise over the described one"""
    world.noise_fs[1] = world.noise_fs[1] * np.hypot(1.0, strength)


@effect("excess_noise", "both", stage="pickoff", unit="1", typical=1.5, channels=NOISE)
def noise_both(world: World, strength: float) -> None:
    """both pickoffs noisier"""
    world.noise_fs = [noise * np.hypot(1.0, strength) for noise in world.noise_fs]


@effect("excess_noise", "thermal", stage="pickoff", unit="1/degC", typical=0.05, channels=NOISE)
def noise_thermal(world: World, strength: float) -> None:
    """secondary pickoff's noise grows above T0"""
    world.noise_fs[1] = world.noise_fs[1] * np.hypot(1.0, strength * np.maximum(world.shift, 0.0))


@effect("excess_noise", "lost_bits", stage="pickoff", unit="bit", typical=3.0, channels=NOISE)
def noise_lost_bits(world: World, strength: float) -> None:
    """the secondary converter's last bits are stuck"""
    world.quantum[1] = 1 << max(0, round(abs(strength)))


def _bias_noise(world: World, noise: np.ndarray) -> None:
    world.bias_rad_s = world.bias_rad_s + noise


@effect("flicker_noise", "flicker", stage="pickoff", unit="deg/h", typical=6.0)
def flicker(world: World, strength: float) -> None:
    """bias with 1/f noise of an Allan floor"""
    _bias_noise(world, np.asarray(world.flicker("effect flicker", abs(strength) * np.pi / 180.0 / 3600.0)))


@effect("flicker_noise", "wander", stage="pickoff", unit="deg/h", typical=10.0)
def bias_wander(world: World, strength: float) -> None:
    """bias wanders with one time constant, a fifteenth of the recording; strength: rms"""
    constant = world.duration_s / 15.0
    _bias_noise(world, strength * np.pi / 180.0 / 3600.0 * world.coarsely(
        lambda t: laws.wander(world.random("effect wander"), len(t), 0.1, constant)))


@effect("flicker_noise", "phase", stage="pickoff", unit="mrad", typical=0.3, channels=("quadrature", "rate"))
def phase_flicker(world: World, strength: float) -> None:
    """the secondary pickoff's phase has 1/f noise, so quadrature comes and goes in the rate"""
    _late(world, world.flicker("effect phase flicker", abs(strength)))
