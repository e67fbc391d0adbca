"""The recorded inputs of a device as a run of the twins: same temperature, true rate, commands, calibration and telemetry rates.

    driven = from_recording(recording)
    simulate(driven.run, path, calibration_block=driven.calibration_block)
    Envelope(driven.run, calibration_block=driven.calibration_block)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError
from scipy.linalg import solve_banded

from wineglass import calibration_block as blocks
from wineglass import device as devices
from wineglass import scenario
from wineglass.calibration_block import OUTPUT_FILTERS
from wineglass.device import Device
from wineglass.errors import BadInput
from wineglass.profiles import TableTemperature
from wineglass.recording import Recording, Tap
from wineglass.schedule import AnyCommand, LoopCommand

SMOOTHED_OVER = 0.1  # of the shell's time constant: a recorded shell temperature is smoothed over this


@dataclass(frozen=True)
class Driven:
    """run: device as described, driven by what was recorded. temperature_from: which channel the temperature came from;
    rate_known: the true rate was recorded, else zero is assumed."""

    run: scenario.Run
    calibration_block: bytes
    temperature_from: str
    rate_known: bool
    notes: tuple[str, ...] = ()

    @property
    def shell_known(self) -> bool:
        return self.temperature_from == "shell_temperature"

    def warmer(self, by_degc: float) -> Driven:
        """The same with another zero of the thermometer that the temperature came from."""
        temperature = self.run.scenario.temperature
        if by_degc == 0.0 or not isinstance(temperature, TableTemperature):
            return self
        values = [value + by_degc for value in temperature.values_degc]
        moved = TableTemperature(times_s=temperature.times_s, values_degc=values, acts_on=temperature.acts_on)
        return replace(self, run=replace(self.run, scenario=self.run.scenario.model_copy(update={"temperature": moved})))


def from_recording(recording: Recording, described: Device | None = None) -> Driven:
    """described: the device description to compare with, None: the one that the recording holds."""
    device = described or described_device(recording)
    temperature, source = _temperature(recording, device)
    rate, rate_known = _rate(recording)
    block = recording.calibration_block or b""
    data: dict[str, Any] = {
        "name": "recorded", "device": device.name, "duration_s": _duration_s(recording), "temperature": temperature, "rate": rate,
        "mode": _mode(block, device), "recording": _rates(recording, device), "command": [c.model_dump() for c in commands(recording)],
    }
    described_scenario = scenario.Scenario.model_validate(data)
    notes = () if rate_known else ("no true rate was recorded: the device is taken to stand still",)
    run = scenario.Run(described_scenario, device, device)
    return Driven(run, block or _nominal_block(run), source, rate_known, notes)


def loop_at(driven: Driven, time_s: np.ndarray) -> np.ndarray:
    """(n,) bool: force-to-rebalance is on."""
    on = np.full(len(time_s), driven.run.scenario.mode.loop == "rebalance")
    for command in driven.run.scenario.command:
        if isinstance(command, LoopCommand):
            on[time_s >= command.at_s] = command.mode == "rebalance"
    return on


def described_device(recording: Recording) -> Device:
    if not recording.device_toml:
        raise BadInput("the recording has no device description", recording.path, "name the device with --device")
    return devices.loads(recording.device_toml, f"{recording.path}, device_toml")


def commands(recording: Recording) -> list[Any]:
    """What was asked of the device while it ran, from the recording's `command` events: "KIND name=value ..."."""
    adapter: TypeAdapter[Any] = TypeAdapter(AnyCommand)
    found = []
    for event in recording.events:
        if event.kind != "command":
            continue
        kind, *fields = event.value.split()
        values = {name: _value(text) for name, _, text in (item.partition("=") for item in fields)}
        try:
            found.append(adapter.validate_python({"kind": kind, "at_s": event.sample / recording.counter_rate_hz, **values}))
        except ValidationError as error:
            problem = error.errors()[0]["msg"]
            raise BadInput(f"the event 'command {event.value}' cannot be understood ({problem})", recording.path, "correct or remove it") from None
    return found


def _value(text: str) -> float | bool | str:
    if text in ("True", "False"):
        return text == "True"
    try:
        return float(text)
    except ValueError:
        return text


def _nominal_block(run: scenario.Run) -> bytes:
    from wineglass.twin import block_for

    return block_for(run)


def _duration_s(recording: Recording) -> float:
    ends = [tap.time_s[-1] + 0.5 / tap.sample_rate_hz for tap in (recording.tap(n) for n in ("baseband", "output") if n in recording) if tap.length]
    if not ends:
        raise BadInput("the recording has neither baseband nor output", recording.path, "record one of the two taps")
    return float(max(ends))


def _rates(recording: Recording, device: Device) -> dict[str, Any]:
    """Telemetry as it was recorded, where the device can send it so; bursts are left out."""
    rates = {}
    for name in ("baseband", "output"):
        divisor = round(device.slow_rate_hz / recording.tap(name).sample_rate_hz) if name in recording else 0
        rates[f"{name}_hz"] = device.slow_rate_hz / divisor if divisor else 0.0
    return {**rates, "reference_hz": 0.0, "bursts": []}


def _mode(block: bytes, device: Device) -> dict[str, Any]:
    if not block:
        return {}
    calibration = blocks.from_binary(block)
    return {"loop": calibration.loop, "compensation": calibration.compensation,
            "output_filter_hz": _filter_hz(calibration.output_filter, device)}


def _filter_hz(name: str, device: Device) -> float:
    assert name in OUTPUT_FILTERS
    return 0.0 if name == "none" else float(name) * device.slow_rate_hz


def _temperature(recording: Recording, device: Device) -> tuple[dict[str, Any], str]:
    for tap_name, name, acts_on in (("reference", "shell_temperature", "shell"), ("reference", "chamber_temperature", "chamber"),
                                    ("output", "temperature_measured", "shell")):
        if tap_name in recording and name in recording.tap(tap_name):
            time_s, values = _sound(recording.tap(tap_name), name)
            if len(values) < 2:
                continue
            if acts_on == "shell":
                values = _smooth(time_s, values, SMOOTHED_OVER * device.thermal.shell_time_constant_s)
            return _table(time_s, values, "values_degc") | {"acts_on": acts_on}, name
    middle = device.resonator.reference_temperature_degc
    return {"kind": "constant", "value_degc": middle}, ""


def _rate(recording: Recording) -> tuple[dict[str, Any], bool]:
    if "reference" not in recording or "true_rate" not in recording.tap("reference"):
        return {"kind": "constant", "value_deg_s": 0.0}, False
    time_s, values = _sound(recording.tap("reference"), "true_rate")
    if len(values) < 2:
        return {"kind": "constant", "value_deg_s": 0.0}, False
    return _table(time_s, np.degrees(_knots_from_means(time_s, values)), "values_deg_s"), True


def _sound(tap: Tap, name: str) -> tuple[np.ndarray, np.ndarray]:
    values = tap[name]
    there = np.isfinite(values)
    return tap.time_s[there], values[there]


def _table(time_s: np.ndarray, values: np.ndarray, key: str) -> dict[str, Any]:
    keep = _needed(values)
    return {"kind": "table", "times_s": time_s[keep].tolist(), key: values[keep].tolist()}


def _knots_from_means(time_s: np.ndarray, means: np.ndarray) -> np.ndarray:
    """Values at the middles of the intervals whose straight lines have the recorded means: (k- + 6 k + k+)/8 = mean."""
    step = np.diff(time_s)
    if len(means) < 4 or np.ptp(step) > 1e-3 * step.mean():
        return means
    bands = np.full((3, len(means)), 0.125)
    bands[1] = 0.75
    bands[1, [0, -1]] = 0.875
    return solve_banded((1, 1), bands, means)


def _needed(values: np.ndarray) -> np.ndarray:
    """Knots without those in the middle of a constant stretch."""
    same = np.diff(values) == 0.0
    keep = np.ones(len(values), bool)
    keep[1:-1] = ~(same[:-1] & same[1:])
    return keep


def _smooth(time_s: np.ndarray, values: np.ndarray, window_s: float) -> np.ndarray:
    """A parabola through each neighbourhood (Savitzky-Golay): follows a lagging shell, not the sensor's noise."""
    step = float(np.median(np.diff(time_s)))
    points = min(len(values) - 1, math.floor(window_s / step)) // 2 * 2 + 1
    if points < 5:
        return values
    half = points // 2
    offset = np.arange(-half, half + 1)
    weights = np.linalg.pinv(np.vander(offset, 3, increasing=True))[0]
    return np.convolve(np.pad(values, half, "reflect", reflect_type="odd"), weights[::-1], "valid")
