"""The loop models on their own: against brute force sample by sample, against Nyquist's count, and margins against what they promise."""

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest

from wineglass import cli, nominal
from wineglass import device as devices
from wineglass import rebalance as on_paper
from wineglass.errors import BadInput
from wineglass.loop_design import drive, rebalance
from wineglass.loop_design.margins import bandwidth_hz, margins, noise_bandwidth_hz, step
from wineglass.loop_design.model import Gains, Loop, Schedule, decimator_response, phase_plant

METAL = devices.load("metal")
LOOPS = {
    "rebalance": lambda: rebalance.model(METAL, rebalance.design(METAL, 100.0)).loop,
    "rebalance, integral": lambda: rebalance.model(METAL, rebalance.design(METAL, 150.0, 60.0)).loop,
    "fractional delays": lambda: _rebalance({"electronics.adc.delay_samples": 2.3, "electronics.dac.latency_samples": 6}).loop,
    "detuned": lambda: _rebalance({"resonator.split_hz": 40.0, "resonator.split_axis_deg": 0.0}).loop,
    "pll": lambda: drive.pll(METAL),
    "agc": lambda: drive.agc(METAL),
}


def _rebalance(changes, bandwidth=100.0):
    device = METAL.override(changes)
    return rebalance.model(device, rebalance.gains_of_speed(device, 2 * math.pi * bandwidth))


def brute_force(device, gains, ticks, force_in):
    """The loop as the firmware runs it, real samples, image included; in-phase force per tick. (The image must turn from tick to tick.)

    force_in: (ticks,) in-phase force that is added to the controller's.
    """
    rate, n = device.electronics.sample_rate_hz, device.firmware.decimation
    w = 2 * math.pi * device.resonator.frequency_hz / rate
    decay = float(device.resonator.secondary_decay_rate_at(25.0)) / rate
    push = device.holding_acceleration_fs_s2 * device.electronics.dac.rebalance_reach / rate**2
    damped = cmath.exp(complex(-decay, math.sqrt(w * w - decay * decay)))
    pole = (damped - 1) / complex(-decay, math.sqrt(w * w - decay * decay))  # integral of the free motion over a sample
    latency, lead = device.electronics.dac.latency_samples, nominal.loop_delay_samples(device) * w
    window = np.concatenate([np.arange(1, n + 1), np.arange(n - 1, 0, -1)]) / n**2
    mode, outputs, mixed, forces = 0j, [0.0] * (latency + 1), [0j] * (2 * n - 1), []
    integral, force = 0j, 0j
    frequency = math.sqrt(w * w - decay * decay)
    for sample in range(ticks * n):
        mixed.append(2 * (mode / frequency).imag * cmath.exp(-1j * w * sample))  # amplitude and image
        outputs.append((force * cmath.exp(1j * (w * sample + lead))).real)
        if sample % n == 0:
            amplitude = np.dot(mixed[-1:-2 * n:-1], window)
        if sample % n == rebalance.SLOT:
            error = -1j * amplitude
            force = gains.proportional * error + integral
            integral += gains.integral_per_s * n / rate * error
            forces.append(force.imag)
            force += 1j * force_in[len(forces) - 1]
        mode = damped * mode + pole * push * outputs[-1 - latency]
    return np.array(forces)


@pytest.mark.parametrize("changes", [{"resonator.frequency_hz": 50e3 / 10 * 61 / 60}, {"resonator.frequency_hz": 4250.0, "firmware.decimation": 20,
                                     "firmware.loops_per_slow": 2, "electronics.dac.latency_samples": 3}])
def test_closed_loop_is_what_samples_do(changes):
    device = METAL.override({**changes, "resonator.split_hz": 0.0})
    gains = rebalance.gains_of_speed(device, 2 * math.pi * 90.0, 40.0)
    loop = rebalance.model(device, gains).loop
    periods, per_period = 6, 50
    frequency = loop.schedule.loop_rate_hz / per_period
    test = 0.01 * np.cos(2 * np.pi * np.arange(20 * per_period) / per_period)
    answer = brute_force(device, gains, len(test), test)[-periods * per_period:]
    line = 2 * np.fft.rfft(answer)[periods] / len(answer)
    both_sides = loop.complementary(np.array([frequency, -frequency]))
    assert line / 0.01 == pytest.approx(-0.5 * (both_sides[0] + np.conj(both_sides[1])), rel=1e-3)


@pytest.mark.parametrize("name", LOOPS)
def test_margins_are_where_the_loop_becomes_unstable(name):
    """More gain by the gain margin, or more lag by the phase margin, puts a pole on the unit circle; a little more or less, outside or inside."""
    loop = LOOPS[name]()
    found = margins(loop)
    assert found.stable
    for factor, inside in ((0.99, True), (1.01, False)):
        gain = 10 ** (found.gain_margin_db / 20) * factor
        lag = cmath.exp(-1j * math.radians(found.phase_margin_deg * factor))
        lead = lag.conjugate()
        louder = replace(loop, gains=Gains(loop.gains.proportional * gain, loop.gains.integral_per_s * gain))
        later = [replace(loop, plant=replace(loop.plant, turn=loop.plant.turn * turn)) for turn in (lag, lead)]
        assert louder.stable == inside
        assert all(one.stable for one in later) == inside


@pytest.mark.parametrize("gain", [0.5, 1.0, 5.0, 8.0, 9.0, 30.0])
def test_poles_agree_with_nyquist(gain):
    """The curve 1 + L, closed around the integrator's pole, turns around zero as often as there are unstable poles."""
    loop = LOOPS["rebalance"]()
    loop = replace(loop, gains=Gains(loop.gains.proportional * gain, loop.gains.integral_per_s * gain))
    radius = 1.0 + 1e-7  # around the integrator's pole at 1, which so lies inside
    angle = np.concatenate([-np.geomspace(np.pi, 1e-9, 100_000), np.geomspace(1e-9, np.pi, 100_000)])
    frequency = (angle - 1j * math.log(radius)) / (2 * np.pi * loop.schedule.tick_s)
    turns = np.sum(np.diff(np.unwrap(np.angle(1.0 + loop.open_loop(frequency))))) / (2 * np.pi)
    unstable = int(np.count_nonzero(np.abs(loop.poles) > radius))
    assert -round(turns) == unstable
    assert loop.stable == (unstable == 0)


def test_margins_agree_with_the_formula_on_paper():
    """Integrator with delay, as the firmware's condition of stability assumes it."""
    loop = LOOPS["rebalance"]()
    paper = on_paper.margins(on_paper.Loop(nominal.rebalance_growth_per_s(METAL), loop.gains.proportional, loop.gains.integral_per_s,
                                           float(METAL.resonator.secondary_decay_rate_at(25.0)), 380e-6))
    found = margins(loop)
    assert found.crossover_hz == pytest.approx(paper.crossover_hz, rel=0.01)
    assert found.phase_margin_deg == pytest.approx(paper.phase_deg, abs=0.5)
    assert found.gain_margin_db == pytest.approx(paper.gain_db, abs=0.5)


def test_decimator_is_two_moving_means():
    schedule = Schedule(50e3, 10, 3, 1.0)
    frequency = np.array([1.0, 370.0, 1900.0, 4999.0, 10_000.0])
    x = np.pi * frequency / 50e3
    expected = (np.sin(10 * x) / (10 * np.sin(x))) ** 2 * np.exp(-2j * x * 9)
    assert decimator_response(schedule, frequency) == pytest.approx(expected, abs=1e-12)


def test_step_and_bandwidth_of_a_loop_in_closed_form():
    """A slow integrator loop is a one-pole low-pass: bandwidth Kp/2 pi, noise bandwidth pi/2 of it, no overshoot, settled after ln 100 / Kp."""
    loop = Loop(phase_plant(0.0), Schedule(50e3, 10, 2, -1), Gains(5.0, 0.0))
    assert bandwidth_hz(loop.complementary, 100.0) == pytest.approx(5 / (2 * np.pi), rel=3e-3)
    assert noise_bandwidth_hz(loop.complementary, 400.0) == pytest.approx(5 / 4, rel=0.02)
    assert step(loop).overshoot < 1e-3
    assert step(loop).settling_s == pytest.approx(math.log(100) / 5, rel=5e-3)


def test_overshoot_of_a_second_order_loop():
    """L = (Kp s + Ki)/s^2: step = 1 - exp(-a t)(cos b t - a/b sin b t) with a = Kp/2, b^2 = Ki - a^2."""
    kp, ki = 14.0, 100.0
    loop = Loop(phase_plant(0.0), Schedule(50e3, 10, 2, -1), Gains(kp, ki))
    a, t = kp / 2, np.linspace(0, 2, 20_001)
    b = math.sqrt(ki - a * a)
    expected = np.max(1 - np.exp(-a * t) * (np.cos(b * t) - a / b * np.sin(b * t))) - 1
    assert step(loop).overshoot == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("name", ["paper", "metal", "silica"])
@pytest.mark.parametrize("wanted", [10.0, 100.0, 200.0])
def test_design_meets_its_bandwidth(name, wanted):
    device = devices.load(name)
    made = rebalance.model(device, rebalance.design(device, wanted))
    level = abs(made.rate_response(np.array([1e-3, wanted])))
    assert level[1] / level[0] == pytest.approx(math.sqrt(0.5), rel=1e-5)
    assert level[0] == pytest.approx(1.0, abs=1e-5)


def test_nominal_gains_reach_the_bars():
    """100 Hz, 60 degrees, 15 %: what docs promise of a shell with Q = 1e4."""
    made = rebalance.model(METAL, rebalance.gains_of_speed(METAL, 2 * math.pi * METAL.firmware.rebalance_bandwidth_hz))
    assert made.loop.gains.proportional == pytest.approx(nominal.rebalance_gains(METAL).proportional)
    assert made.loop.gains.integral_per_s == pytest.approx(nominal.rebalance_gains(METAL).integral)
    assert bandwidth_hz(made.rate_response, made.highest_hz) >= 100.0
    assert margins(made.loop).phase_margin_deg >= 60.0
    assert step(made.loop).overshoot <= 0.15


@pytest.mark.parametrize(("gains", "words"), [
    (Gains(5000.0, 100.0), "unstable"),
    (Gains(900.0, 100.0), "of margin"),
    (Gains(100.0, 1e9), "range"),
    (Gains(-1.0, 0.0), "range"),
    (Gains(60.0, 60.0 * 200.0), "firmware refuses"),
])
def test_unsound_gains_are_refused(gains, words):
    with pytest.raises(BadInput, match=words):
        rebalance.check(METAL, gains)


@pytest.mark.parametrize("arguments", [
    ["--bandwidth", "900"], ["--bandwidth", "0.01"], ["--bandwidth", "nan"], ["--bandwidth", "-5"], ["--gains", "5000", "100"],
    ["--bandwidth", "100", "--integral", "2000"], ["--mode", "pll", "--bandwidth", "500"], ["--mode", "agc", "--integral", "3"],
    ["--gains", "100", "100", "--bandwidth", "50"], ["-o", "calibration.txt"], ["-o", "/nowhere/at/all/calibration.json"], ["--plot", "bode.html"],
])
def test_command_refuses_in_one_line(arguments, capsys):
    assert cli.main(["design-loop", "metal", "--no-measure", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "error" in error
