"""Another unit of the same device: its uncertain fields drawn within the description's tolerances, or one of them moved by a part of its tolerance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wineglass.device import Device
from wineglass.errors import BadInput

WITHIN = 2.0  # standard deviations: what lies outside would not have left the factory
FARTHEST = 3.0
POSITIVE = ("resonator.split_hz", "resonator.damping_mismatch")
AT_MOST = {"resonator.angular_gain": 2.0}  # no shell has more


def drawn(device: Device, random: np.random.Generator) -> dict[str, Any]:
    """Fields and values by dotted name."""
    return {path: _value(device, path, random) for path in sorted(device.tolerance)}


@dataclass(frozen=True)
class Nudge:
    """One uncertain number moved away from the described one; by: in standard deviations of its tolerance."""

    name: str
    fields: dict[str, Any]
    by: float


def nudges(device: Device, by: float) -> list[Nudge]:
    """One for each uncertain number, to the side that a device may lie on."""
    found = []
    for path in sorted(device.tolerance):
        nominal, sizes = _spread(device, path)
        for place in np.flatnonzero(sizes):
            for side in (by, -by):
                values = nominal.copy()
                values[place] += side * sizes[place]
                fields = {path: _plain(device, path, values)}
                if _is_possible(device, fields):
                    found.append(Nudge(path if len(sizes) == 1 else f"{path}[{place}]", fields, side))
                    break
    return found


def at(device: Device, off: dict[str, float]) -> dict[str, Any]:
    """Fields of the unit that lies so many standard deviations off; off: by the names of `nudges`. As far as a device may lie."""
    found = {}
    for path in sorted(device.tolerance):
        values, sizes = _spread(device, path)
        names = [path] if len(sizes) == 1 else [f"{path}[{place}]" for place in range(len(sizes))]
        moved = values + sizes * np.clip([off.get(name, 0.0) for name in names], -FARTHEST, FARTHEST)
        if np.any(moved != values):
            moved = np.maximum(moved, 0.0) if path in POSITIVE else moved
            found[path] = _plain(device, path, np.minimum(moved, AT_MOST.get(path, np.inf)))
    return found


def _is_possible(device: Device, fields: dict[str, Any]) -> bool:
    try:
        another(device, fields)
    except BadInput:
        return False
    return all(values <= AT_MOST.get(path, np.inf) for path, values in fields.items() if not isinstance(values, list))


def another(device: Device, fields: dict[str, Any]) -> Device:
    return device.override(fields, "another unit")


def noisier(device: Device, factor: float) -> Device:
    """The description of a device whose converters and thermometer are noisier by a factor."""
    if factor == 1.0:
        return device
    adc, thermometer, floor = device.electronics.adc, device.electronics.thermometer, device.noise_floor
    return device.override({
        "electronics.adc.snr_db": adc.snr_db - 20.0 * float(np.log10(factor)) if adc.snr_db else 0.0,
        "electronics.thermometer.noise_degc": thermometer.noise_degc * factor,
        "noise_floor.temperature_degc": floor.temperature_degc * factor,
    }, "noisier device")


def _value(device: Device, path: str, random: np.random.Generator) -> Any:
    values, sizes = _spread(device, path)
    found = values + sizes * _truncated(random, len(values))
    if path in POSITIVE:
        found = np.abs(found)
    if path in AT_MOST:
        found = AT_MOST[path] - np.abs(AT_MOST[path] - found)
    return _plain(device, path, found)


def _spread(device: Device, path: str) -> tuple[np.ndarray, np.ndarray]:
    """(n,) described values, and (n,) their standard deviations: n is 1 but for lists."""
    tolerance = device.tolerance[path]
    values = np.atleast_1d(np.asarray(_nominal(device, path), float))
    sizes = np.abs(values) * tolerance.relative if tolerance.relative is not None else np.atleast_1d(np.asarray(tolerance.absolute, float))
    return values, np.pad(sizes, (0, max(0, len(values) - len(sizes))))[: len(values)]


def _nominal(device: Device, path: str) -> Any:
    value: Any = device
    for part in path.split("."):
        value = getattr(value, part)
    return value


def _plain(device: Device, path: str, values: np.ndarray) -> Any:
    return [float(value) for value in values] if isinstance(_nominal(device, path), list) else float(values[0])


def _truncated(random: np.random.Generator, count: int) -> np.ndarray:
    """Normal numbers within +-WITHIN."""
    numbers = random.standard_normal(count)
    while np.any(outside := np.abs(numbers) > WITHIN):
        numbers[outside] = random.standard_normal(int(outside.sum()))
    return numbers
