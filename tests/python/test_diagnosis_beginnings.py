"""Where closing begins: effects with an axis, against a law over temperature that is written down here."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from wineglass.diagnosis import beginnings, curves
from wineglass.diagnosis.explain import Explained
from wineglass.diagnosis.responses import REACH, Column, Responses, Variant
from wineglass.diagnosis.unknowns import AXIS, settings_of
from wineglass.effects import Setting, find

REFERENCE_DEGC, N = 25.0, 200
SHELL_DEGC = np.linspace(-40.0, 85.0, N)
SPLIT = find("frequency_split")
SIZES = {p.name: p.typical for p in SPLIT.parameters}
POINTS = [p.name for p in curves.seen(SPLIT, SHELL_DEGC)]


def weight(name: str) -> np.ndarray:
    if name == "split_hz":
        return np.ones(N)
    return curves.weight(SHELL_DEGC, name) if curves.is_point(name) else SHELL_DEGC - REFERENCE_DEGC


@dataclass
class SplitBench:
    """Two channels: the cosine's part and the sine's part of double the axis."""

    shell_degc = SHELL_DEGC
    driven = SimpleNamespace(run=SimpleNamespace(device=SimpleNamespace(resonator=SimpleNamespace(reference_temperature_degc=REFERENCE_DEGC))))
    nominal = np.zeros((2, N))

    def tried(self, settings: list[Setting]) -> np.ndarray:
        return self.run(settings)

    def run(self, settings: list[Setting]) -> np.ndarray:
        (setting,) = settings
        law = sum(value * weight(name) for name, value in setting.values.items() if name != AXIS)
        turn = np.radians(2.0 * setting.values[AXIS])
        return np.array([np.cos(turn) * law, np.sin(turn) * law])


def begun(law: dict[str, float], axis_deg: float) -> tuple[list, np.ndarray]:
    """As a linear pass has it that finds this law exactly."""
    bench, columns, values, coefficients = SplitBench(), [], [], []
    turn = np.radians(2.0 * axis_deg)
    for axis, part in ((0.0, np.cos(turn)), (45.0, np.sin(turn))):
        for name in law:
            columns.append(Column("frequency_split", Setting("frequency_split", {name: SIZES[name], AXIS: axis}), name, REACH))
            values.append(bench.run([columns[-1].probe]))
            coefficients.append(law[name] * part / SIZES[name] / REACH)
    variant = Variant("frequency_split", tuple(range(len(columns))))
    responses = Responses(("a", "b"), bench.nominal, tuple(columns), np.array(values), (), np.zeros(0), {"frequency_split": [variant]})
    start = Explained(("frequency_split",), (variant,), 0.0, 0.0, np.zeros(2), np.array(coefficients))
    return beginnings.begin(bench, responses, [0, 1], start)  # type: ignore[arg-type]


def truth(law: dict[str, float], axis_deg: float) -> np.ndarray:
    return SplitBench().run([Setting("frequency_split", {**law, AXIS: axis_deg})])


@pytest.mark.parametrize("axis_deg", [-80.0, -20.0, 0.0, 30.0, 45.0, 90.0])
@pytest.mark.parametrize("law", [{"split_hz": 0.05, "slope_hz_per_degc": 1e-4}, {"split_hz": 0.0, "slope_hz_per_degc": 2e-3}, {"split_hz": -1e-4, "slope_hz_per_degc": -2e-3}])
def test_a_law_of_one_axis_begins_where_it_is(law: dict[str, float], axis_deg: float) -> None:
    """Whether the constant is most of it, or nothing; in the second case the axis is a number of its own."""
    unknowns, jacobian = begun(law, axis_deg)
    (setting,) = settings_of(unknowns, np.array([u.start for u in unknowns]))
    assert SplitBench().run([setting]) == pytest.approx(truth(law, axis_deg), abs=1e-9)
    assert (AXIS in [u.name for u in unknowns]) == (abs(law["split_hz"]) < 0.01)
    for unknown, row in zip(unknowns, jacobian, strict=True):
        values = np.array([u.start + (1e-4 * u.spread if u is unknown else 0.0) for u in unknowns])
        moved = (SplitBench().run(settings_of(unknowns, values)) - truth(law, axis_deg)) / (1e-4 * unknown.spread)
        if unknown.role not in ("cosine", "sine"):  # of these the slope's axis is taken to stay, and moves only where it is large
            assert row == pytest.approx(moved, abs=0.08 * float(np.max(np.abs(moved)))), unknown.name


def test_a_curve_of_one_axis_begins_where_it_is() -> None:
    """A square of the temperature has neither constant nor slope at the reference, and its axis is that of all its points together."""
    law = {"split_hz": 0.0, "slope_hz_per_degc": 0.0} | {name: 3e-5 * (curves.temperature_of(name) - REFERENCE_DEGC) ** 2 for name in POINTS}
    unknowns, _ = begun(law, -35.0)
    (setting,) = settings_of(unknowns, np.array([u.start for u in unknowns]))
    assert SplitBench().run([setting]) == pytest.approx(truth(law, -35.0), abs=1e-9)
    assert {u.role for u in unknowns if curves.is_point(u.name)} == {"form"}
    assert unknowns[-1].name == AXIS and unknowns[-1].role == "shape"
    assert abs(unknowns[-1].start) == pytest.approx(55.0) or unknowns[-1].start == pytest.approx(-35.0), "or a negative law across it"
