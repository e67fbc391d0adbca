"""Two devices with the same inputs: equal to the last bit, or the first sample and the first module that differ."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from wineglass.emulation.device import THERMOMETER_SILENT, Device
from wineglass.emulation.fields import differing


@dataclass(frozen=True)
class Stretch:
    """Inputs for some samples: commands that arrive before them, the thermometer's code, (n, 2) int32 ADC codes."""

    adc: np.ndarray
    thermometer: int = THERMOMETER_SILENT
    commands: bytes = field(default=b"", repr=False)


@dataclass(frozen=True)
class Difference:
    """Where two devices part."""

    sample: int
    """first one after which something differs, counted from 0"""
    what: str
    """`DAC codes`, `telemetry` or the module that differs"""
    fields: tuple[str, ...]
    """everything that differs after that sample, in the order of the signal's way"""

    def __str__(self) -> str:
        return f"sample {self.sample}: {self.what} differs ({', '.join(self.fields[:8])}{', ...' if len(self.fields) > 8 else ''})"


@dataclass(frozen=True)
class Output:
    dac: np.ndarray
    telemetry: bytes
    snapshot: bytes


Make = Callable[[], Device]


def compare(make_first: Make, make_second: Make, stretches: Sequence[Stretch]) -> tuple[Difference | None, int]:
    """The first difference, if any, and the telemetry bytes compared. Both devices begin from power-up, twice if they differ."""
    first, second = make_first(), make_second()
    telemetry_bytes = 0
    try:
        for index, stretch in enumerate(stretches):
            one, other = _run(first, stretch), _run(second, stretch)
            telemetry_bytes += len(one.telemetry)
            if _differences(one, other):
                break
        else:
            return None, telemetry_bytes
    finally:
        first.close()
        second.close()
    return _locate(make_first, make_second, stretches[: index + 1]), telemetry_bytes


def _run(device: Device, stretch: Stretch) -> Output:
    if stretch.commands:
        device.command(stretch.commands)
    return Output(device.run(stretch.adc, stretch.thermometer), device.telemetry(), device.snapshot())


def _differences(one: Output, other: Output) -> list[tuple[str, str]]:
    """(module, field) in the order of the signal's way; the outputs stand last."""
    found = [(item.module, f"{item.part}.{item.name}") for item in differing(one.snapshot, other.snapshot)]
    if not np.array_equal(one.dac, other.dac):
        found.append(("DAC codes", "DAC codes"))
    if one.telemetry != other.telemetry:
        found.append(("telemetry", "telemetry"))
    return found


def _locate(make_first: Make, make_second: Make, stretches: Sequence[Stretch]) -> Difference:
    """Again up to the last stretch, then sample by sample."""
    first, second = make_first(), make_second()
    sample = sum(len(stretch.adc) for stretch in stretches[:-1])
    try:
        for stretch in stretches[:-1]:
            _run(first, stretch), _run(second, stretch)
        last = stretches[-1]
        for step, codes in enumerate(last.adc):
            single = Stretch(codes[None, :], last.thermometer, last.commands if step == 0 else b"")
            found = _differences(_run(first, single), _run(second, single))
            if found:
                return Difference(sample + step, found[0][0], tuple(name for _, name in found))
    finally:
        first.close()
        second.close()
    return Difference(sample, "nothing that repeats", ())
