"""How coarse readings are: steps are found in multiples, and not where there are none."""

import os

import numpy as np
import pytest

from wineglass.diagnosis import digits
from wineglass.diagnosis.soundness import unit_factor

SEED = int(os.environ.get("WINEGLASS_SEED", "0"))


@pytest.mark.parametrize("step", [0.0625, 0.25, 1.0])
def test_steps_of_readings(step):
    rng = np.random.default_rng([SEED, 1])
    degc = np.interp(np.arange(4000), [0, 1500, 4000], [-20.0, 60.0, 10.0]) + 0.02 * rng.standard_normal(4000)
    assert digits.step_of(np.round(degc / step) * step) == pytest.approx(step)
    assert digits.step_of(degc) is None


def test_what_steps_do_is_said():
    degc = np.round(np.linspace(-20.0, 60.0, 4000))
    found = digits.notes(degc, 1e-3 * degc + 1e-6 * np.random.default_rng([SEED, 2]).standard_normal(4000), 1e-6)
    assert len(found) == 1 and "steps of 1 degC" in found[0] and "0.00029 rad/s" in found[0]  # 1e-3 over the root of 12


@pytest.mark.parametrize("factor, wrong", [(1.0, False), (1.03, False), (57.3, True), (1 / 57.3, True), (1e3, True), (10.0, False)])
def test_a_ratio_of_two_units(factor, wrong):
    turning = np.array([0.3, -0.3, 0.0])[np.arange(600) // 50 % 3]
    noisy = factor * turning + 1e-3 * factor * np.random.default_rng([SEED, 3]).standard_normal(600)
    assert (unit_factor(turning, noisy) is not None) == wrong
