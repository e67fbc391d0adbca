"""Nominal calibration: polynomials against the exact laws, loop gains against their own closed loops."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wineglass import device as devices
from wineglass import nominal

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
    decay = np.pi * resonator.frequency_at(temperature) / resonator.q_at(temperature)
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


def test_chirp_and_listening_times():
    device = devices.load("metal")
    loop_hz = device.electronics.sample_rate_hz / device.firmware.decimation
    assert 2 ** nominal.chirp_ticks_log2(device) / loop_hz == pytest.approx(0.1, rel=0.1)
    assert 2 * 2 ** nominal.listen_ticks_log2(device) / loop_hz == pytest.approx(0.1, rel=0.1)
