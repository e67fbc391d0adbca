"""The numbers that an explanation fits: their priors, the settings they stand for, and what the envelope twin does with them."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from wineglass.diagnosis import curves
from wineglass.diagnosis.responses import POLAR, REACH, Bench
from wineglass.effects import Setting
from wineglass.errors import BadInput

POLAR_ROLES = ("cosine", "sine")
AXIS = "axis_deg"
SHAPE_STEP, STRENGTH_STEP = 0.05, 0.005
HELD = 1e-3  # of a spread: a number that stays where it is


@dataclass(frozen=True)
class Unknown:
    """One fitted number. role: 'strength', 'shape', 'form', 'cosine' or 'sine' (of double the axis); the prior is normal about `middle`. held: it stays where it is
    while a curve beside it takes the rest."""

    effect: str
    name: str
    role: str
    start: float
    middle: float
    spread: float
    low: float
    high: float
    held: bool = False


def held(unknown: Unknown, value: float) -> Unknown:
    return unknown if unknown.held else replace(unknown, middle=value, spread=HELD * unknown.spread, held=True)


def freed(unknown: Unknown) -> Unknown:
    return replace(unknown, middle=0.0, spread=unknown.spread / HELD, held=False) if unknown.held else unknown


def possible(unknowns: list[Unknown], values: np.ndarray) -> bool:
    """No strength stands at the end of what physics allows."""
    return all(u.low < v < u.high or v == 0.0 for u, v in zip(unknowns, values, strict=True) if u.role == "strength")


def settings_of(unknowns: list[Unknown], values: np.ndarray) -> list[Setting]:
    """Every effect switched on with these values, kept within their bounds."""
    found: dict[str, dict[str, float]] = {}
    for unknown, value in zip(unknowns, values, strict=True):
        if unknown.role not in POLAR_ROLES:
            value = min(max(float(value), unknown.low), unknown.high)
        if unknown.name == AXIS:
            value = folded_deg(value)
        found.setdefault(unknown.effect, {})[unknown.role if unknown.role in POLAR_ROLES else unknown.name] = float(value)
    return [Setting(effect, _polar(effect, given)) for effect, given in found.items()]


def folded_deg(axis_deg: float) -> float:
    """The same axis between -90 and 90 deg."""
    return (axis_deg + 90.0) % 180.0 - 90.0


def _polar(effect: str, given: dict[str, float]) -> dict[str, float]:
    if "cosine" not in given:
        return given
    cosine, sine = given.pop("cosine"), given.pop("sine")
    return {**given, POLAR[effect][0]: float(np.hypot(cosine, sine)), "axis_deg": float(np.degrees(0.5 * np.arctan2(sine, cosine)))}


def within_bounds(unknowns: list[Unknown], values: np.ndarray) -> np.ndarray:
    return np.array([v if u.role in POLAR_ROLES else min(max(v, u.low), u.high) for u, v in zip(unknowns, values, strict=True)])


def respond(bench: Bench, pick: list[int], unknowns: list[Unknown], values: np.ndarray) -> np.ndarray:
    """(channels, n). BadInput where the twin refuses these values."""
    return bench.tried(settings_of(unknowns, values))[pick]


def differences(bench: Bench, pick: list[int], unknowns: list[Unknown], values: np.ndarray, response: np.ndarray, first: int = 0) -> np.ndarray:
    """The Jacobian (k, channels, n) at these values, of unknowns from `first` on, by one run each, and one for all points of a curve, each of which has its
    part of it at the temperature of the moment; response: the one there."""
    rows = np.empty((len(unknowns) - first, *response.shape))
    groups: dict[tuple[str, int], list[int]] = {}
    for i, unknown in list(enumerate(unknowns))[first:]:
        groups.setdefault((unknown.effect, -1 if curves.is_point(unknown.name) else i), []).append(i)
    for places in groups.values():
        parts = curves.parts(bench.measured_degc, [unknowns[i].name for i in places]) if len(places) > 1 else np.ones((1, 1))
        rows[np.array(places) - first] = _slope(bench, pick, unknowns, values, response, places) * parts[:, None]
    return rows


def _slope(bench: Bench, pick: list[int], unknowns: list[Unknown], values: np.ndarray, response: np.ndarray, places: list[int]) -> np.ndarray:
    """(channels, n): what one of a parameter does, or one of all of them together; nothing, where the twin refuses to move it either way."""
    step = max(SHAPE_STEP * u.spread if u.role == "shape" else STRENGTH_STEP * max(abs(values[i]), u.spread / REACH) for i, u in ((i, unknowns[i]) for i in places))
    if any(values[i] + step > unknowns[i].high and unknowns[i].role not in POLAR_ROLES for i in places):
        step = -step
    for by in (step, -step):
        moved = values.copy()
        moved[places] += by
        with suppress(BadInput):
            return (respond(bench, pick, unknowns, moved) - response) / by
    return np.zeros_like(response)
