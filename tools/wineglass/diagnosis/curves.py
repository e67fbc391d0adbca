"""An effect's law over temperature that is no polynomial: a uniform cubic B-spline whose control points are parameters of the effect's record
(`curve_20_degc`), sim/effects/effect.h."""

from __future__ import annotations

import numpy as np

from wineglass.diagnosis.contract import EffectFound
from wineglass.diagnosis.contract import Parameter as NamedNumber
from wineglass.effects import Effect, Parameter

PREFIX, SUFFIX, SPACING_DEGC = "curve_", "_degc", 10.0


def is_point(name: str) -> bool:
    """Is a parameter of that name a control point?"""
    return name.startswith(PREFIX)


def temperature_of(name: str) -> float:
    """Where a control point stands [degC]."""
    text = name.removeprefix(PREFIX).removesuffix(SUFFIX)
    return -float(text.removeprefix("minus_")) if text.startswith("minus_") else float(text)


def points(effect: Effect) -> list[Parameter]:
    """All control points of an effect's curve; none where its record has no curve."""
    return [p for p in effect.parameters if is_point(p.name)]


def seen(effect: Effect, shell_degc: np.ndarray) -> list[Parameter]:
    """Control points of which a recording can show something. shell_degc (n,): where the shell has been."""
    low, high = float(np.min(shell_degc)) - SPACING_DEGC, float(np.max(shell_degc)) + SPACING_DEGC
    return [p for p in points(effect) if low < temperature_of(p.name) < high]


def parted(effect: EffectFound) -> tuple[list[NamedNumber], str]:
    """An effect's numbers for people: all but a curve's, and what the curve is in words; '' without one."""
    curve = {temperature_of(p.name): p for p in effect.parameters if is_point(p.name)}
    if not curve:
        return list(effect.parameters), ""
    values = [p.value for p in curve.values()]
    unit = next(iter(curve.values())).unit
    words = (f"and a curve over temperature, {min(curve):g} to {max(curve):g} degC: {len(curve)} control points of {min(values):.3g} to {max(values):.3g}"
             f"{'' if unit == '1' else f' {unit}'}, each in the JSON")
    return [p for p in effect.parameters if not is_point(p.name)], words


def weight(degc: np.ndarray, point: str) -> np.ndarray:
    """(n,): how much the curve has of a control point at temperatures (n,)."""
    off = np.abs(degc - temperature_of(point)) / SPACING_DEGC
    return np.where(off < 1.0, (4.0 - 6.0 * off**2 + 3.0 * off**3) / 6.0, np.maximum(2.0 - off, 0.0) ** 3 / 6.0)


def parts(degc: np.ndarray, names: list[str]) -> np.ndarray:
    """(points, n): which part of what they do together each of these control points has at temperatures (n,)."""
    weights = np.array([weight(degc, name) for name in names])
    return weights / np.maximum(np.sum(weights, axis=0), 1e-12)
