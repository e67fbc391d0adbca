"""Where the closing of an explanation begins: values and slopes as the linear pass has them."""

from __future__ import annotations

import numpy as np

from wineglass import effects
from wineglass.diagnosis import curves
from wineglass.diagnosis.explain import Explained
from wineglass.diagnosis.responses import AXES_DEG, POLAR, REACH, STAIRS, Bench, Responses, Variant
from wineglass.diagnosis.unknowns import AXIS, Unknown, differences, respond
from wineglass.errors import BadInput

KNOWN = {"time_s": 2.0, "origin_degc": 1e-3}  # about the moment that a linear pass found, and about where readings show the codes to be
DOMINATES = 0.7  # of the amplitude of a split or mismatch: a constant of more has an axis that everything else follows
SEEN = 1e-4  # of stairs that readings show: so well are their height, and where they are, known
AXIS_SPREAD_DEG, AXIS_BOUND_DEG = 45.0, 1e3
Begun = list[tuple[Unknown, np.ndarray]]
"""Unknowns, each with what one of its unit does (channels of the bench, n)"""


def begin(bench: Bench, responses: Responses, pick: list[int], start: Explained) -> tuple[list[Unknown], np.ndarray]:
    """Unknowns with their first values, and the first Jacobian (k, channels, n). pick: channels among the bench's."""
    begun: Begun = []
    shapes: list[Unknown] = []
    place = len(responses.nuisances)
    for variant in start.variants:
        coefficients = dict(zip(variant.columns, start.coefficients[place : place + len(variant.columns)], strict=True))
        place += len(variant.columns)
        if variant.effect in POLAR:
            found, axis = _polar(bench, responses, variant, coefficients)
            shapes += axis
        else:
            found = _straight(bench, responses, variant, coefficients)
        begun += found
        shapes += [_shape(variant.effect, name, value) for name, value in variant.shapes.items()]
    unknowns, rows = [unknown for unknown, _ in begun], [row[pick] for _, row in begun]
    if shapes:
        rows += _shape_rows(bench, pick, unknowns, shapes)
    return [*unknowns, *shapes], np.array(rows)


def _parameter(effect: str, name: str) -> effects.Parameter:
    return next(p for p in effects.find(effect).parameters if p.name == name)


def _straight(bench: Bench, responses: Responses, variant: Variant, coefficients: dict[int, float]) -> Begun:
    found = []
    for column in variant.columns:
        probe = responses.columns[column].probe
        assert probe is not None
        record = _parameter(variant.effect, responses.columns[column].name)
        unit = probe.values[record.name]
        whole = responses.columns[column].scale != REACH
        value = unit * coefficients[column] * responses.columns[column].scale
        if whole:
            value = min(max(value, 0.2 * unit), 5.0 * unit)
        spread = abs(unit) if whole else REACH * abs(record.typical)
        if variant.effect == STAIRS and bench.stairs is not None:  # stairs of another height are no smaller stairs
            value, spread = unit, SEEN * unit
        value = min(max(value, record.low), record.high)
        unknown = Unknown(variant.effect, record.name, "form" if record.form else "strength", value, unit if whole else 0.0, spread, record.low, record.high)
        found.append((unknown, responses.values[column] / unit))
    return found


class _Planes:
    """What the linear pass has of an effect with an axis: every number twice, along 0 and along 45 deg of the axis. names: of its numbers, the size first."""

    def __init__(self, bench: Bench, responses: Responses, variant: Variant, coefficients: dict[int, float]):
        self.effect = variant.effect
        self.names = list(dict.fromkeys(responses.columns[c].name for c in variant.columns))
        self.records = {name: _parameter(variant.effect, name) for name in self.names}
        place = {(responses.columns[c].name, responses.columns[c].probe.values["axis_deg"]): c for c in variant.columns}  # type: ignore[union-attr]
        self.both = {name: np.array([coefficients[place[name, axis]] for axis in AXES_DEG]) * REACH * self.records[name].typical for name in self.names}
        self.rows = {name: np.array([responses.values[place[name, axis]] for axis in AXES_DEG]) / self.records[name].typical for name in self.names}
        self._bench = bench

    @property
    def size(self) -> str:
        return self.names[0]

    @property
    def over_time(self) -> np.ndarray:
        """(2, n): all of it, as the shell's temperature goes."""
        return sum(np.outer(self.both[name], self._weight(name)) for name in self.names)  # type: ignore[return-value]

    def _weight(self, name: str) -> np.ndarray:
        degc = self._bench.shell_degc
        if name == self.size:
            return np.ones_like(degc)
        if curves.is_point(name):
            return curves.weight(degc, name)
        return degc - self._bench.driven.run.device.resonator.reference_temperature_degc

    def along(self, name: str, direction: np.ndarray) -> tuple[Unknown, np.ndarray]:
        record = self.records[name]
        value = min(max(float(self.both[name] @ direction), record.low), record.high)
        unknown = Unknown(self.effect, name, "form" if record.form else "strength", value, 0.0, REACH * record.typical, record.low, record.high)
        return unknown, np.tensordot(direction, self.rows[name], 1)


def _polar(bench: Bench, responses: Responses, variant: Variant, coefficients: dict[int, float]) -> tuple[Begun, list[Unknown]]:
    """Where a constant dominates, it is fitted as its two components, and everything else follows its axis. Where it does not, the axis is a shape of its own,
    because nothing has no axis. Also the shapes."""
    planes = _Planes(bench, responses, variant, coefficients)
    constant, whole = planes.both[planes.size], planes.over_time
    length = float(np.hypot(*constant))
    straight = not any(curves.is_point(name) for name in planes.names)
    if straight and length >= DOMINATES * float(np.sqrt(np.mean(np.sum(whole**2, axis=0)))):
        record = planes.records[planes.size]
        components = [(Unknown(planes.effect, planes.size, role, float(constant[i]), 0.0, REACH * record.typical, record.low, record.high), planes.rows[planes.size][i])
                      for i, role in enumerate(("cosine", "sine"))]
        direction = constant / max(length, 1e-3 * record.typical)
        return [*components, *(planes.along(name, direction) for name in planes.names[1:])], []
    direction = np.linalg.svd(whole, full_matrices=False)[0][:, 0]
    direction = direction if direction @ constant >= 0.0 else -direction
    axis_deg = float(np.degrees(0.5 * np.arctan2(direction[1], direction[0])))
    axis = Unknown(planes.effect, AXIS, "shape", axis_deg, axis_deg, AXIS_SPREAD_DEG, -AXIS_BOUND_DEG, AXIS_BOUND_DEG)
    return [planes.along(name, direction) for name in planes.names], [axis]


def _shape(effect: str, name: str, value: float) -> Unknown:
    record = _parameter(effect, name)
    spread = KNOWN.get(name) or max(abs(value), 0.1 * abs(record.typical), 1e-6)
    return Unknown(effect, name, "shape", value, value, spread, record.low, record.high)


def _shape_rows(bench: Bench, pick: list[int], strengths: list[Unknown], shapes: list[Unknown]) -> list[np.ndarray]:
    """Nothing, where the twin refuses the first values: closing starts from smaller ones, and looks for itself."""
    unknowns = [*strengths, *shapes]
    values = np.array([u.start for u in unknowns])
    try:
        at = respond(bench, pick, unknowns, values)
    except BadInput:
        return [np.zeros((len(pick), bench.grid.count)) for _ in shapes]
    return list(differences(bench, pick, unknowns, values, at, len(strengths)))
