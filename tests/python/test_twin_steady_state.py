"""The twin against the closed form of the coupled modes: rate, cross damping, split, mismatch and quadrature together."""

import numpy as np
import pytest
from scipy.optimize import brentq

from wineglass import device as devices
from wineglass import nominal, paths, scenario
from wineglass.steady_state import steady_state

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")

IDEAL = {"electronics.adc.bits": 32, "electronics.adc.snr_db": 0.0, "electronics.dac.bits": 32}
EVERYTHING = {"resonator.split_hz": 0.05, "resonator.split_axis_deg": 33.0, "resonator.damping_mismatch": 0.1,
              "resonator.damping_axis_deg": 20.0, "resonator.quadrature_rad_s": 0.02, "resonator.q": 3000.0}


@pytest.mark.parametrize(("name", "change", "temperature_degc", "rate_deg_s"), [
    ("paper", {}, 25.0, 10.0),
    ("metal", {}, -30.0, -7.0),
    ("metal", {}, 80.0, 0.0),
    ("metal", EVERYTHING, 10.0, 30.0),
])
def test_twin_settles_where_the_closed_form_says(name, change, temperature_degc, rate_deg_s):
    from wineglass.twin import Twin

    fields = {"device": name, "override": {**IDEAL, **change}, "duration_s": 20.0, "temperature": {"value_degc": temperature_degc},
              "rate": {"value_deg_s": rate_deg_s}, "mode": {"compensation": "none", "output_filter_hz": 10.0}}
    run = scenario.prepare(scenario.parse(fields, "case"))
    with Twin(run, amplitudes=True) as twin:
        twin.step(18_000)
        frequency_hz = np.mean([(twin.step(19), twin.truth().oscillator_hz)[1] for _ in range(100)])
        block, truth, signals = twin.step(100), twin.truth(), twin.signals()
    expected = steady_state(run.truth.resonator, temperature_degc, np.radians(rate_deg_s))
    ratio = np.mean(block.secondary[-100:]) / np.mean(block.primary[-100:])
    assert truth.resonance_hz == pytest.approx(float(expected.frequency_hz), abs=1e-7)
    assert frequency_hz == pytest.approx(float(expected.frequency_hz), abs=1e-5)
    assert ratio == pytest.approx(complex(expected.ratio), abs=2e-6)
    scale = 2 * run.truth.resonator.secondary_decay_rate_at(temperature_degc) / run.truth.resonator.angular_gain
    assert signals["rate_rad_s_q28"] / 2**28 == pytest.approx(float(scale * expected.ratio.real), abs=2e-6)


def test_closed_form_solves_the_equations_of_motion():
    """Both equations as one complex 2x2 system, solved for the drive frequency by a root finder."""
    device = devices.load("metal").override(EVERYTHING)
    resonator, temperature, rate = device.resonator, -12.0, 0.7
    k = 2 * np.pi * resonator.frequency_at(temperature)
    g, d = resonator.angular_gain, k / resonator.q_at(temperature)
    split, cross = 2 * np.pi * 0.05, g * resonator.cross_damping_at(temperature)
    unequal = 0.05 * np.cos(np.radians(40))
    stiffness = np.array([[k * (k + split * np.cos(np.radians(66))), k * (split * np.sin(np.radians(66)) + g * 0.02)], [0, 0]])
    stiffness[1] = [stiffness[0, 1], k * (k - split * np.cos(np.radians(66)))]
    damping = np.array([[d * (1 + unequal), -cross + g * rate], [-cross - g * rate, d * (1 - unequal)]])

    def displacement(w: float) -> np.ndarray:
        return np.linalg.solve(stiffness - (w**2 + rate**2) * np.eye(2) + 1j * w * damping, [1.0, 0.0])

    w = brentq(lambda w: displacement(w)[0].real, k - 1, k + 1, xtol=1e-9)
    found = steady_state(resonator, temperature, rate)
    x = displacement(w)
    assert float(found.frequency_hz) == pytest.approx(w / (2 * np.pi), abs=1e-9)
    assert complex(found.ratio) == pytest.approx(complex(x[1] / x[0]), rel=1e-6)


def test_without_a_split_the_zero_rate_output_is_the_cross_damping():
    device = devices.load("paper")
    assert nominal.zero_rate_fit(device).coefficients == pytest.approx(device.resonator.cross_damping_rad_s, rel=1e-6)


def test_split_leaks_its_quadrature_through_the_detuned_secondary():
    """0.02 Hz of split at 20 deg: quadrature 2 pi 0.02 sin 40 / g, detuning 0.02 cos 40 Hz against half a bandwidth of 0.25 Hz."""
    metal = devices.load("metal")
    leak = nominal.zero_rate_fit(metal).coefficients[0] - metal.resonator.cross_damping_rad_s[0]
    quadrature = 2 * np.pi * 0.02 * np.sin(np.radians(40)) / 2
    assert leak == pytest.approx(quadrature * 0.02 * np.cos(np.radians(40)) / 0.25, rel=0.01)
