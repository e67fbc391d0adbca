"""Where an explanation is confirmed: at the last run of the full twin, or at another one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wineglass.diagnosis import confirmation, standing
from wineglass.diagnosis.confirmation import STRAIGHT

N = 500
TIME = np.linspace(0.0, 1.0, N)


def found_after(power: float) -> SimpleNamespace:
    """An analysis whose full twin was run last at a value of 1, where the effect is (value^power) t in the second of two channels of the bench, in floors of a hundredth."""
    bench = SimpleNamespace(nominal=np.zeros((2, N)))
    there = SimpleNamespace(bench=bench, unknowns=["size"], values=np.array([1.0]), jacobian=power * TIME[None, None], envelope=np.array([np.zeros(N), TIME]))
    return SimpleNamespace(bench=bench, ran=(there, "frames of the run"), pick=[1], system=SimpleNamespace(whiten=lambda series: 100.0 * series))


def chosen_at(value: float, power: float, unknowns: tuple[str, ...] = ("size",)) -> Any:
    return SimpleNamespace(unknowns=list(unknowns), values=np.array([value]), jacobian=None, response=value**power * TIME[None])


@pytest.mark.parametrize(("value", "power", "unknowns", "again"), [
    (1.5, 1.0, ("size",), False), (1.01, 2.0, ("size",), False), (1.5, 2.0, ("size",), True), (1.0, 1.0, ("size", "lag"), True)])
def test_the_full_twin_is_run_again_only_where_no_straight_line_leads(value: float, power: float, unknowns: tuple[str, ...], again: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(standing, "run", lambda there: f"frames at {there.values[0]}")
    found = found_after(power)
    there, frames = confirmation._run(found, chosen_at(value, power, unknowns))  # type: ignore[arg-type]
    assert frames == (f"frames at {value}" if again else "frames of the run") and (there is found.ran[0]) != again


def test_how_far_a_way_is_from_straight_is_the_energy_of_its_second_order() -> None:
    """Of a square, half a value on: a quarter of the effect, in floors of a hundredth."""
    bend = confirmation._bend(found_after(2.0), found_after(2.0).ran[0], chosen_at(1.5, 2.0))  # type: ignore[arg-type]
    assert bend == pytest.approx(float(np.sum((25.0 * TIME) ** 2))) and bend > STRAIGHT
