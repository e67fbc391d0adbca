"""Nominal calibration: polynomials against the exact laws, loop gains against their own closed loops."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wineglass import device as devices
from wineglass import nominal, scenario
from wineglass.calibration_block import from_binary, to_binary

SHIPPED = devices.names()


def shifts(device):
    low, high = device.calibration_range_degc()
    return np.linspace(low, high, 777) - device.resonator.reference_temperature_degc


@pytest.mark.parametrize(("name", "limit"), [("paper", 1e-14), ("metal", 1e-6), ("silica", 0.011)])
def test_polynomials_follow_the_exact_laws(name, limit):
    """silica's Q has a knee at 60 degC, which a polynomial can only round off: 1.1 % at worst."""
    device = devices.load(name)
    resonator, shift = device.resonator, shifts(device)
    temperature = shift + resonator.reference_temperature_degc
    unequal = 0.5 * resonator.damping_mismatch * np.cos(2 * np.radians(resonator.damping_axis_deg))
    decay = np.pi * resonator.frequency_at(temperature) / resonator.q_at(temperature) * (1 - unequal)
    for fit, exact in ((nominal.decay_fit(device), decay), (nominal.scale_fit(device), 2 * decay / resonator.angular_gain)):
        fitted = np.polynomial.polynomial.polyval(shift, fit.coefficients)
        error = np.max(np.abs(fitted - exact)) / np.max(np.abs(exact))
        assert error <= limit and fit.error == pytest.approx(error, abs=1e-4)


def test_scale_of_the_paper_device():
    device = devices.load("paper")
    assert nominal.scale_fit(device).coefficients == pytest.approx([2 * np.pi * 5000 / (1e4 * 2)])


def test_polynomial_order_is_no_larger_than_needed():
    assert len(nominal.scale_fit(devices.load("paper")).coefficients) == 1
    assert len(nominal.scale_fit(devices.load("silica")).coefficients) == 6


@pytest.mark.parametrize("name", SHIPPED)
def test_pll_is_well_damped(name):
    gains = nominal.pll_gains(devices.load(name))
    poles = np.roots([1, gains.proportional, gains.integral])
    assert np.all(poles.real < 0)
    assert -poles[0].real / abs(poles[0]) == pytest.approx(0.7, abs=1e-6)


@pytest.mark.parametrize("name", ["metal", "silica"])
def test_amplitude_loop_comes_out_of_saturation_without_overshoot(name):
    """The loop as a differential equation: saturated force, integral frozen while the force is at its limit."""
    device = devices.load(name)
    gains = nominal.agc_gains(device)
    target = device.firmware.amplitude_fs
    tau = device.resonator.q / (np.pi * device.resonator.frequency_hz)
    gain = device.electronics.dac.drive_reach * target / tau

    def slope(_, state):
        amplitude, integral = state
        error = target - amplitude
        wanted = gains.proportional * error + integral
        held = (wanted > 1 and error > 0) or (wanted < 0 and error < 0)
        return [gain * np.clip(wanted, 0, 1) - amplitude / tau, 0.0 if held else gains.integral * error]

    step = 0.05 / device.firmware.agc_bandwidth_hz
    end = 3 * tau + 20 / device.firmware.agc_bandwidth_hz
    path = solve_ivp(slope, (0, end), [0, 0], max_step=step, rtol=1e-6)
    assert path.y[0].max() < 1.01 * target
    assert path.y[0][-1] == pytest.approx(target, rel=1e-3)


def calibration(name):
    return nominal.calibration(scenario.prepare(scenario.parse({"device": name}, "case")))


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_device_has_a_calibration_that_fits_the_firmware(name):
    nominal_calibration = calibration(name)
    back = from_binary(to_binary(nominal_calibration))
    device = devices.load(name)
    assert back.device_name == name and back.compensation == "g2"
    assert back.bias_rad_s == pytest.approx(device.resonator.cross_damping_rad_s, rel=1e-5)
    shift = shifts(device)
    for field in ("bias_rad_s", "scale_rad_s_per_ratio", "decay_rate_per_s"):
        wanted, got = (np.polynomial.polynomial.polyval(shift, getattr(c, field)) for c in (nominal_calibration, back))
        assert np.max(np.abs(got - wanted)) < 1.1e-5 * np.max(np.abs(wanted)), field  # silica's decay rate in Q22


def test_chirp_and_listening_take_a_tenth_of_a_second_each():
    metal = calibration("metal")
    assert (metal.chirp_s, metal.listen_s) == pytest.approx((0.1024, 0.1024))


@pytest.mark.parametrize("name", SHIPPED)
def test_search_band_holds_the_resonance_at_every_temperature(name):
    device, found = devices.load(name), calibration(name)
    frequency = device.resonator.frequency_at(np.linspace(*device.calibration_range_degc(), 50))
    assert found.search_min_hz < 0.99 * frequency.min() and found.search_max_hz > 1.01 * frequency.max()


def test_thermometer_code_of_the_reference():
    run = scenario.prepare(scenario.parse({"override": {"electronics.thermometer.zero_degc": -10.0}}, "case"))
    assert nominal.calibration(run).thermometer_code_at_reference == 35 * 128
