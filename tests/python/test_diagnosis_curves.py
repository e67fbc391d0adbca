"""Curves over temperature, against scipy's splines."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from wineglass import effects, paths
from wineglass.diagnosis import curves
from wineglass.diagnosis.contract import EffectFound, Parameter

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")


def test_control_points_are_named_after_their_temperatures() -> None:
    assert [curves.temperature_of(name) for name in ("curve_minus_40_degc", "curve_0_degc", "curve_110_degc")] == [-40.0, 0.0, 110.0]
    assert curves.is_point("curve_0_degc") and not curves.is_point("slope_per_degc")
    found = [curves.temperature_of(p.name) for p in curves.points(effects.find("cross_damping"))]
    assert found == list(np.arange(-50.0, 121.0, 10.0))
    assert curves.points(effects.find("ageing")) == []


def test_weights_are_those_of_a_cubic_spline() -> None:
    degc = np.linspace(-35.0, 105.0, 71)
    points = curves.points(effects.find("cross_damping"))
    expected = BSpline.design_matrix(degc, np.arange(-70.0, 141.0, 10.0), 3).toarray()
    assert np.array([curves.weight(degc, point.name) for point in points]).T == pytest.approx(expected, abs=1e-12)


def test_only_points_near_the_shells_temperatures_are_seen() -> None:
    found = [curves.temperature_of(p.name) for p in curves.seen(effects.find("pickoff_gain"), np.array([12.0, 18.0, 33.0]))]
    assert found == [10.0, 20.0, 30.0, 40.0]


def test_a_curve_is_told_in_a_line() -> None:
    def number(name: str, value: float) -> Parameter:
        return Parameter(name=name, value=value, interval=(value - 1.0, value + 1.0), unit="1")

    plain = [number("gain", 0.5), number("slope_per_degc", 0.25)]
    bent = [*plain, number("curve_minus_10_degc", -2.0), number("curve_0_degc", 3.0), number("curve_10_degc", 1.0)]
    found = [EffectFound(id="pickoff_gain", stage="pickoff", confidence=1.0, share=1.0, parameters=numbers) for numbers in (plain, bent)]
    assert curves.parted(found[0]) == (plain, "")
    assert curves.parted(found[1])[0] == plain
    assert curves.parted(found[1])[1] == "and a curve over temperature, -10 to 10 degC: 3 control points of -2 to 3, each in the JSON"
