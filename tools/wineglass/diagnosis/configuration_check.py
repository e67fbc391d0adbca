"""Does the device compute with what its calibration block says? The configuration in a snapshot against that of a device that loads the block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wineglass.diagnosis import snapshot_fields
from wineglass.diagnosis.replayed import Converters, Device

_COMMANDABLE = (
    "compensation", "loop", "output_filter", "drive.amplitude_q30", "monitor.amplitude_limit_q30", "drive.pll_", "drive.agc_", "drive.phase_set_point",
    "rebalance.", "test_signal.", "demodulation_phase_rad_q31", "drive_phase_rad_q31", "drive.held", "drive.off",
)
"""what commands change for the time until the next start; docs/SPEC.md, commands"""


@dataclass(frozen=True)
class Deviation:
    """ratio: recorded over expected where all numbers of the field share one, else None"""

    name: str
    recorded: tuple[int, ...]
    expected: tuple[int, ...]
    ratio: float | None
    commandable: bool

    def says(self) -> str:
        if self.ratio is not None:
            return f"{self.name} is {self.ratio:.6g} times the block's"
        return f"{self.name} is {_list(self.recorded)}, the block says {_list(self.expected)}"


def deviations(snapshot: bytes, block: bytes, converters: Converters) -> list[Deviation]:
    """Fields of the configuration that differ."""
    with Device(converters, block) as device:
        expected = device.snapshot()
    found = []
    for field in snapshot_fields.fields():
        if field.part != "cfg" or field.offset + field.width * field.count > len(snapshot):
            continue
        recorded, nominal = field.of(snapshot), field.of(expected)
        if not np.array_equal(recorded, nominal):
            found.append(_deviation(field.name, recorded, nominal))
    return found


def _deviation(name: str, recorded: np.ndarray, expected: np.ndarray) -> Deviation:
    commandable = name.startswith(_COMMANDABLE)
    return Deviation(name, tuple(map(int, recorded)), tuple(map(int, expected)), _ratio(recorded, expected), commandable)


def _ratio(recorded: np.ndarray, expected: np.ndarray) -> float | None:
    """Least squares, if it explains all numbers to their rounding."""
    x, y = expected.astype(np.float64), recorded.astype(np.float64)
    if not np.any(x):
        return None
    ratio = float(x @ y / (x @ x))
    return ratio if np.all(np.abs(y - ratio * x) <= 1.0 + 1e-9 * np.abs(x)) else None


def _list(numbers: tuple[int, ...]) -> str:
    return str(numbers[0]) if len(numbers) == 1 else "[" + ", ".join(map(str, numbers)) + "]"
