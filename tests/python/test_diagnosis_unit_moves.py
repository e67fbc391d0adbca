"""How a unit moves within its tolerances: straight in the plane of an axis, never beyond what is tolerated."""

from __future__ import annotations

import numpy as np
import pytest

from wineglass import device
from wineglass.diagnosis.unit import FARTHEST, Unit

SEED = 3


def coupling(unit: Unit) -> complex:
    """Split as a vector of double its axis' angle: its imaginary part couples the modes."""
    resonator = unit.device.resonator
    return complex(resonator.split_hz * np.exp(2j * np.radians(resonator.split_axis_deg)))


def test_split_and_axis_move_along_a_straight_line() -> None:
    unit = Unit.of(device.load("metal-fast"))
    names = [item.path for item in unit.uncertain]
    change = np.zeros(len(names))
    change[names.index("resonator.split_hz")] = -0.7
    change[names.index("resonator.split_axis_deg")] = 1.5
    small = 1e-4
    slope = (coupling(unit.at(unit.off + small * change)) - coupling(unit)) / small
    assert coupling(unit.toward(change)) == pytest.approx(coupling(unit) + slope, abs=1e-3 * abs(slope))
    assert abs(coupling(unit.at(unit.off + change)) - coupling(unit) - slope) > 0.02 * abs(slope)  # as numbers they would have turned in a circle


def test_no_value_goes_further_than_tolerated() -> None:
    rng = np.random.default_rng(SEED)
    unit = Unit.of(device.load("metal-fast"))
    for _ in range(20):
        unit = unit.toward(rng.normal(0.0, 2.0, len(unit.off)))
        assert np.all(np.abs(unit.off) <= FARTHEST)


def test_a_gain_that_can_only_be_less_is_uncertain_to_that_side() -> None:
    unit = Unit.of(device.load("metal-fast"))
    place = [item.path for item in unit.uncertain].index("resonator.angular_gain")
    change = np.zeros(len(unit.off))
    change[place] = -1.0
    assert unit.toward(change).device.resonator.angular_gain < unit.device.resonator.angular_gain
    assert unit.toward(-change).device == unit.device
