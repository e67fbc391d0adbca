"""Effects that the catalogue of the diagnosis does not have. A good answer to them is `unknown`, with the right place."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from wineglass.blind.generator import laws
from wineglass.blind.generator.effects.register import Law, effect
from wineglass.blind.generator.world import Slow, Tone, World

DEG_H = math.pi / 180.0 / 3600.0
PPM = 1e-6
KNOTS = 8193


def outside(id: str, name: str, **more: object) -> Callable[[Law], Law]:
    return effect(id, name, in_catalogue=False, **more)  # type: ignore[arg-type]


def _bias(world: World, deg_h: Slow) -> None:
    world.bias_rad_s = world.bias_rad_s + DEG_H * deg_h


def _add(world: World, name: str, value: Slow) -> None:
    world.extra[name] = world.extra.get(name, 0.0) + value


@outside("channel_memory", "same_sample", stage="pickoff", unit="ppm", typical=100.0, channels=("secondary_in_phase", "rate"))
def memory(world: World, strength: float) -> None:
    """the multiplexed converter's secondary channel remembers a share of the primary"""
    _add(world, "memory_2", PPM * strength)


@outside("channel_memory", "both_ways", stage="pickoff", unit="ppm", typical=100.0, channels=("secondary_in_phase", "rate"))
def memory_both_ways(world: World, strength: float) -> None:
    """each channel of the multiplexed converter remembers the other one's last conversion"""
    _add(world, "memory_2", PPM * strength)
    _add(world, "memory_1", PPM * strength)


@outside("third_mode", "near", stage="secondary", unit="ppm", typical=3000.0, channels=("secondary_quadrature", "quadrature"))
def third_mode(world: World, strength: float) -> None:
    """a third mode 30 Hz above, driven by the drive force and seen by the secondary pickoff; its frequency follows the temperature"""
    _third(world, strength, 30.0 + 0.3 * world.shift, 8.0)


@outside("third_mode", "crossing", stage="secondary", unit="ppm", typical=1000.0, channels=("secondary_quadrature", "quadrature"))
def third_mode_crossing(world: World, strength: float) -> None:
    """a third mode that crosses the carrier at T0 + 15 degC"""
    _third(world, strength, 0.5 * (world.shift - 15.0), 4.0)


def _third(world: World, ppm: float, above_hz: Slow, decay_per_s: float) -> None:
    _add(world, "third_hz", world.truth.resonator.frequency_hz + above_hz)
    _add(world, "third_decay", decay_per_s)
    _add(world, "third_drive", world.drive_force)
    _add(world, "third_seen_2", PPM * ppm)


@outside("parametric_pumping", "at_twice", stage="primary", unit="ppm", typical=0.5, channels=("drive_level", "drive_frequency"))
def pumping(world: World, strength: float) -> None:
    """the stiffness is modulated at twice the carrier, 0.3 Hz beside it, as by a supply of the electrodes"""
    _add(world, "pump", PPM * strength)
    _add(world, "pump_hz", 2.0 * world.truth.resonator.frequency_hz + 0.3)


@outside("parametric_pumping", "tracking", stage="primary", unit="ppm", typical=0.5, channels=("drive_level", "drive_frequency"))
def pumping_tracking(world: World, strength: float) -> None:
    """the stiffness is modulated at nearly twice the shell's own frequency as it follows the temperature"""
    _add(world, "pump", PPM * strength)
    _add(world, "pump_hz", 2.0 * world.frequency_hz + 0.05)


@outside("reference_voltage", "electronics", stage="pickoff", unit="ppm/degC", typical=200.0, channels=("drive_level",))
def reference_voltage(world: World, strength: float) -> None:
    """the converters' reference follows the electronics' temperature, later than the shell's: codes fall and forces rise with it"""
    relative = PPM * strength * (world.electronics_degc - world.truth.resonator.reference_temperature_degc)
    _reference(world, relative)


@outside("reference_voltage", "noise", stage="pickoff", unit="ppm", typical=300.0, channels=("drive_level",))
def reference_flicker(world: World, strength: float) -> None:
    """the converters' reference has 1/f noise"""
    _reference(world, world.flicker("reference voltage", PPM * abs(strength)))


def _reference(world: World, relative: Slow) -> None:
    world.pickoff_gain = [gain / (1.0 + relative) for gain in world.pickoff_gain]
    world.drive_force, world.rebalance_force = world.drive_force * (1.0 + relative), world.rebalance_force * (1.0 + relative)


@outside("stick_slip", "bias", stage="coupling", unit="deg/h", typical=50.0)
def stick_slip(world: World, strength: float) -> None:
    """the mount sticks and slips: strain follows the temperature in jumps, and the bias with it"""
    _bias(world, strength * _slips(world))


@outside("stick_slip", "quadrature", stage="coupling", unit="deg/s", typical=0.05, channels=("quadrature",))
def stick_slip_quadrature(world: World, strength: float) -> None:
    """the mount sticks and slips, and the cross stiffness with it"""
    world.quadrature_rad_s = world.quadrature_rad_s + math.radians(strength) * _slips(world)


def _slips(world: World) -> np.ndarray:
    """Strain that is held until the temperature has moved by a random amount (5 to 15 degC), then let go: -1 .. 1 about."""
    random, temperature = world.random("slips"), world.coarse(world.shell_degc)
    held, limit, out = temperature[0], random.uniform(5.0, 15.0), np.empty(len(temperature))
    for i, value in enumerate(temperature):
        if abs(value - held) > limit:
            held, limit = value, random.uniform(5.0, 15.0)
        out[i] = (value - held) / 10.0
    return np.interp(np.arange(world.edges) * world.block_s, np.arange(len(out)) * 0.1, out)


@outside("telegraph_bias", "slow", stage="coupling", unit="deg/h", typical=25.0)
def telegraph(world: World, strength: float) -> None:
    """bias jumps between two values at random, every 20 s in the mean"""
    _bias(world, strength * world.coarsely(lambda t: laws.telegraph(world.random("telegraph"), len(t), 0.1, 20.0)))


@outside("telegraph_bias", "fast", stage="coupling", unit="deg/h", typical=40.0)
def telegraph_fast(world: World, strength: float) -> None:
    """bias jumps between two values at random, every 3 s in the mean"""
    _bias(world, strength * world.coarsely(lambda t: laws.telegraph(world.random("telegraph"), len(t), 0.1, 3.0)))


@outside("thermal_acceleration", "smooth", stage="coupling", unit="deg/h per degC/s^2", typical=30.0)
def thermal_acceleration(world: World, strength: float) -> None:
    """bias follows d2T/dt2 of the shell"""
    speed = laws.slope(world.shell_degc, world.block_s)
    _bias(world, strength * laws.lag(laws.slope(speed, world.block_s), world.block_s, 0.5))


@outside("nonlinear_coupling", "cubic", stage="coupling", unit="1/s/FS^2", typical=0.02, channels=("rate", "quadrature"))
def nonlinear_coupling(world: World, strength: float) -> None:
    """a cubic stiffness between the modes, with a term in conj(A2) A1^2; strength as the detuning of mode 2 it makes"""
    _add(world, "cubic_cross", 2.0 * strength * 2.0 * math.pi * world.truth.resonator.frequency_hz)


@outside("time_stamps", "constant", stage="environment", unit="s", typical=0.05, channels=("true_rate", "rate"))
def time_stamps(world: World, strength: float) -> None:
    """the rate table's time stamps are late"""
    world.bench.delay_s += strength


@outside("rate_squared", "bias", stage="coupling", unit="deg/h per (rad/s)^2", typical=200.0)
def rate_squared(world: World, strength: float) -> None:
    """bias grows with the square of the rate"""
    _bias(world, strength * world.rate_rad_s**2)


@outside("rate_squared", "after_effect", stage="coupling", unit="deg/h per (rad/s)^2", typical=200.0)
def rate_after_effect(world: World, strength: float) -> None:
    """bias grows with the square of the rate and forgets it within 5 s"""
    _bias(world, strength * laws.lag(np.broadcast_to(world.rate_rad_s**2, (world.edges,)).copy(), world.block_s, 5.0))


@outside("dac_crossover", "dead_zone", stage="actuation", unit="ppm of FS", typical=300.0, channels=("rebalance_in_phase", "rate"), loop="rebalance")
def dac_dead_zone(world: World, strength: float) -> None:
    """the rebalance amplifier does nothing around zero"""
    x = np.linspace(-1.0, 1.0, KNOTS)
    world.dac_error[1] = -np.clip(x, -PPM * abs(strength), PPM * abs(strength))


@outside("dac_crossover", "cubic", stage="actuation", unit="1", typical=0.01, channels=("drive_level", "rate"))
def dac_cubic(world: World, strength: float) -> None:
    """both force amplifiers compress with the third power"""
    x = np.linspace(-1.0, 1.0, KNOTS)
    world.dac_error = [-strength * x**3, -strength * x**3]


@outside("mains_modulation", "gain", stage="pickoff", unit="ppm", typical=30.0, channels=("noise of primary_in_phase", "noise of rate"))
def mains(world: World, strength: float) -> None:
    """the pickoffs' supply breathes at 9.7 Hz, the beat of mains and frame rate"""
    swing = PPM * strength * np.sin(2.0 * np.pi * 9.7 * world.time_s)
    world.pickoff_gain = [gain * (1.0 + swing) for gain in world.pickoff_gain]


@outside("secondary_sees_primary", "tilt", stage="pickoff", unit="ppm", typical=100.0, channels=("secondary_in_phase", "rate"))
def pickoff_tilt(world: World, strength: float) -> None:
    """the secondary pickoff's electrodes are turned and see the primary"""
    _add(world, "sees_primary", PPM * strength)


@outside("chamber_stress", "mount", stage="coupling", unit="deg/h per degC", typical=8.0, imitates="thermal_gradient")
def chamber_stress(world: World, strength: float) -> None:
    """bias follows a fixture, a quarter of the shell's time constant behind the chamber, over the shell: as with dT/dt but ahead at a ramp's ends"""
    fixture = laws.lag(world.chamber_degc, world.block_s, 0.25 * world.truth.thermal.shell_time_constant_s)
    _bias(world, strength * (fixture - world.shell_degc))  # the chamber's own temperature over a first-order shell's is exactly the latter's dT/dt


@outside("self_heating", "thermometer", stage="temperature", unit="degC", typical=1.0, channels=("temperature_measured", "rate"))
def self_heating(world: World, strength: float) -> None:
    """the thermometer warms itself after power-up and settles within a fifth of the day"""
    world.thermometer_degc = world.thermometer_degc - strength * np.expm1(-world.part / 0.07)


@outside("rebalance_pickup", "resistive", stage="pickoff", unit="ppm", typical=3000.0, channels=("rebalance_quadrature", "quadrature", "rate"),
         loop="rebalance")
def rebalance_pickup(world: World, strength: float) -> None:
    """the rebalance voltage leaks into its own pickoff"""
    _add(world, "rebalance_leak_2", PPM * strength)


@outside("swept_rocking", "swept", stage="environment", unit="deg/s", typical=0.5, channels=("noise of rate",))
def swept_rocking(world: World, strength: float) -> None:
    """the base rocks at a frequency that sweeps from 2 to 12 Hz and back with the day"""
    frequency = 7.0 - 5.0 * np.cos(2.0 * np.pi * world.part)
    world.tones.append(Tone("rate", math.radians(strength), frequency))
