"""A rate that changes, against a law that needs no integration: with g = 2 an oscillation keeps its plane in space while the frame turns under it, so
x2/x1 is the tangent of the angle turned, in every sample."""

import math

import numpy as np

from wineglass import scenario
from wineglass.twin import Twin

SLOPE_DEG_S2 = 1000.0
SAMPLES_S = 50_000.0


def leaning(codes: np.ndarray) -> complex:
    """What x2 has beside x1 tan(angle), over x1, in the last two milliseconds; codes (n, 4) from the start of the ramp on. Real: as a rate would."""
    time_s = np.arange(len(codes)) / SAMPLES_S
    angle = 0.5 * math.radians(SLOPE_DEG_S2) * time_s**2
    x1, x2 = codes[:, 0] * 2.0**-31, codes[:, 1] * 2.0**-31
    beside = x2 - x1 * np.tan(angle)
    quarter_later = (np.roll(x1, -1) - np.roll(x1, 1)) / (2.0 * math.sin(2.0 * math.pi * 5000.0 / SAMPLES_S))
    part = slice(len(codes) - 120, len(codes) - 20)
    found = np.linalg.lstsq(np.stack([x1[part], quarter_later[part]], axis=1), beside[part], rcond=None)[0]
    return complex(*found)


def test_a_ramp_of_the_rate_leans_on_nothing():
    """40 ms into a ramp of 1000 deg/s^2; the rate then is 0.70 rad/s, so 2e-8 stands for 0.03 us."""
    run = scenario.prepare(scenario.parse({
        "name": "turned frame", "device": "paper", "duration_s": 3.1,
        "rate": {"kind": "steps", "times_s": [3.0], "values_deg_s": [0.1 * SLOPE_DEG_S2], "edge_s": 0.1},
        "override": {"resonator.cross_damping_rad_s": [0.0], "electronics.adc.snr_db": 0.0, "electronics.adc.bits": 32, "electronics.dac.bits": 24},
        "plant": {"override": {"resonator.q": 1e7}},
    }, "turned frame"))
    with Twin(run, codes=True) as twin:
        twin.step(3000)
        codes = twin.step(40).codes
    assert codes is not None
    assert abs(leaning(codes)) < 2e-8
