"""The unit that was recorded: a device within its tolerances, with every uncertain value where the recording puts it.

Numbers are in standard deviations of the description's tolerances. Effects are not known yet; what they do is taken for a wrong form, so that
the unit is a point to work from and no verdict: the tolerances' priors stay in force afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from wineglass.device import Device, Tolerance
from wineglass.errors import BadInput

FARTHEST = 3.0
PLANES = (("resonator.split_hz", "resonator.split_axis_deg"), ("resonator.damping_mismatch", "resonator.damping_axis_deg"))
"""Size and axis of something with two components: of double the angle."""


@dataclass(frozen=True)
class Uncertain:
    """One value of a description: path, place in a polynomial (None: a number), one standard deviation in its unit."""

    path: str
    place: int | None
    step: float

    @property
    def name(self) -> str:
        return self.path if self.place is None else f"{self.path}[{self.place}]"


@dataclass(frozen=True)
class Unit:
    """off (m,): how far each uncertain value is off, in standard deviations."""

    described: Device
    uncertain: tuple[Uncertain, ...]
    off: np.ndarray = field(default_factory=lambda: np.zeros(0))
    _nudged: dict[tuple[int, float], Device] = field(default_factory=dict, repr=False, compare=False)
    """devices that were asked for already: making one means checking all of it"""

    @staticmethod
    def of(described: Device) -> Unit:
        """The nominal unit, with the uncertain values that may be moved at all."""
        able = []
        for item in (i for path, tolerance in described.tolerance.items() for i in _items(described, path, tolerance)):
            if _possible(described, item, 0.1) or _possible(described, item, -0.1):
                able.append(item)
        return Unit(described, tuple(able), np.zeros(len(able)))

    @property
    def device(self) -> Device:
        return _moved(self.described, self.uncertain, self.off) if np.any(self.off) else self.described

    def at(self, off: np.ndarray) -> Unit:
        """The unit there, or as far on the way as the description allows."""
        wanted = np.clip(off, -FARTHEST, FARTHEST)
        wanted = np.array([by if _possible(self.described, item, by) else 0.0 for item, by in zip(self.uncertain, wanted, strict=True)])
        for _ in range(12):
            try:
                _moved(self.described, self.uncertain, wanted)
            except BadInput:
                wanted = 0.5 * (wanted + self.off)
                continue
            return Unit(self.described, self.uncertain, wanted)
        return self

    def toward(self, change: np.ndarray) -> Unit:
        """The unit after a small change (m,). A size and its axis move along straight lines of their plane: what couples the modes is linear there,
        and an axis alone turns in circles."""
        moved = self.off + change
        place = {item.path: i for i, item in enumerate(self.uncertain)}
        for size, axis in PLANES:
            if size in place and axis in place:
                moved[[place[size], place[axis]]] = self._along(place[size], place[axis], change)
        return self.at(moved)

    def _along(self, size: int, axis: int, change: np.ndarray) -> tuple[float, float]:
        steps = np.array([self.uncertain[i].step for i in (size, axis)])
        length, angle_deg = (float(_value(self.device, self.uncertain[i].path)) for i in (size, axis))  # type: ignore[arg-type]
        longer, turned_deg = steps * change[[size, axis]]
        point = complex(length + longer, 2.0 * length * np.radians(turned_deg))
        found = np.array([abs(point) - length, np.degrees(0.5 * np.angle(point))]) / steps
        return float(self.off[size] + found[0]), float(self.off[axis] + found[1])

    def nudged(self, index: int, by: float) -> Device:
        if (index, by) not in self._nudged:
            off = self.off.copy()
            off[index] += by
            self._nudged[index, by] = _moved(self.described, self.uncertain, off)
        return self._nudged[index, by]


def _possible(described: Device, item: Uncertain, by: float) -> bool:
    """Some values are uncertain to one side only: an angular gain is at most 2."""
    try:
        _moved(described, [item], np.array([by]))
    except BadInput:
        return False
    return True


def _items(device: Device, path: str, tolerance: Tolerance) -> list[Uncertain]:
    value = _value(device, path)
    if isinstance(value, list):
        steps = tolerance.absolute if isinstance(tolerance.absolute, list) else [abs(v) * float(tolerance.relative or 0.0) for v in value]
        return [Uncertain(path, i, step) for i, step in enumerate(steps) if step]
    assert isinstance(value, (int, float)) and not isinstance(tolerance.absolute, list)
    step = tolerance.absolute if tolerance.absolute is not None else abs(value) * float(tolerance.relative or 0.0)
    return [Uncertain(path, None, step)] if step else []


def _value(device: Device, path: str) -> object:
    value: object = device
    for part in path.split("."):
        value = getattr(value, part)
    return value


def _moved(described: Device, items: list[Uncertain] | tuple[Uncertain, ...], off: np.ndarray) -> Device:
    changes: dict[str, object] = {}
    for item, by in zip(items, off, strict=True):
        value = changes.get(item.path, _value(described, item.path))
        if item.place is None:
            changes[item.path] = value + float(by) * item.step  # type: ignore[operator]
            continue
        row = [*value, *[0.0] * (item.place + 1 - len(value))]  # type: ignore[misc, arg-type]
        row[item.place] += float(by) * item.step
        changes[item.path] = row
    return described.override(changes)
