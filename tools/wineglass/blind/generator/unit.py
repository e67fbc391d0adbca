"""Another unit of the same device: its uncertain fields drawn within the description's tolerances."""

from __future__ import annotations

from typing import Any

import numpy as np

from wineglass.device import Device

WITHIN = 2.0  # standard deviations: what lies outside would not have left the factory
POSITIVE = ("resonator.split_hz", "resonator.damping_mismatch")
AT_MOST = {"resonator.angular_gain": 2.0}  # no shell has more


def drawn(device: Device, random: np.random.Generator) -> dict[str, Any]:
    """Fields and values by dotted name."""
    return {path: _value(device, path, random) for path in sorted(device.tolerance)}


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
    nominal: Any = device
    for part in path.split("."):
        nominal = getattr(nominal, part)
    tolerance = device.tolerance[path]
    values = np.atleast_1d(np.asarray(nominal, float))
    sizes = np.abs(values) * tolerance.relative if tolerance.relative is not None else np.atleast_1d(np.asarray(tolerance.absolute, float))
    found = values.copy()
    found[: len(sizes)] += sizes[: len(values)] * _truncated(random, len(values))
    if path in POSITIVE:
        found = np.abs(found)
    if path in AT_MOST:
        found = AT_MOST[path] - np.abs(AT_MOST[path] - found)
    return [float(value) for value in found] if isinstance(nominal, list) else float(found[0])


def _truncated(random: np.random.Generator, count: int) -> np.ndarray:
    """Normal numbers within +-WITHIN."""
    numbers = random.standard_normal(count)
    while np.any(outside := np.abs(numbers) > WITHIN):
        numbers[outside] = random.standard_normal(int(outside.sum()))
    return numbers
