"""Scenarios: what happens to a device during a simulated run, in a readable TOML file, every field with unit, default and meaning."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from wineglass import device as devices
from wineglass import paths, toml_text, units
from wineglass.calibration_block import output_filter_at
from wineglass.device import Device
from wineglass.errors import BadInput
from wineglass.fields import Section, quantity, validate
from wineglass.importers.table import Table, read_table
from wineglass.profiles import ConstantRate, ConstantTemperature, CsvTemperature, Rate, TableTemperature, Temperature
from wineglass.schedule import AnyCommand

FOLDER = paths.repository_root() / "scenarios"


class Mode(Section):
    """How the firmware runs."""

    loop: Literal["open", "rebalance"] = quantity("open", "", "open: the secondary moves freely; rebalance: forces hold it at rest")
    compensation: Literal["none", "static", "g2"] = quantity("g2", "", "none; static: polynomial after demodulation; g2: decoupling before it")
    output_filter_hz: float = quantity(50.0, "Hz", "corner of the output filter; 0: none", ge=0)


class Burst(Section):
    """Raw codes of every sample for a short while."""

    time_s: float = quantity(..., "s", "when it is asked for", ge=0)
    samples: int = quantity(..., "sample", "length", ge=1, le=1_000_000)


class Recording(Section):
    """What is written down, and how often. Rates divide the slow rate; 0: not recorded."""

    baseband_hz: float = quantity(100.0, "Hz", "amplitudes, frequency, drive level, status", ge=0)
    output_hz: float = quantity(100.0, "Hz", "temperature and rate", ge=0)
    reference_hz: float = quantity(100.0, "Hz", "true rate, chamber and shell temperature", ge=0)
    bursts: list[Burst] = quantity([], "", "raw bursts")


class Plant(Section):
    """How the simulated device differs from its description, from which the nominal calibration is made."""

    cross_damping: bool = quantity(True, "", "false: the shell has none (the calibration still assumes it)")
    override: dict[str, Any] = quantity({}, "", "fields of the device that differ in truth only, by dotted name")


class Segment(Section):
    """A named stretch of the run, for the recording's events."""

    name: str = quantity(..., "", "what it is called", min_length=1)
    begin_s: float = quantity(..., "s", "when it begins", ge=0)
    end_s: float = quantity(..., "s", "when it ends", gt=0)
    what: str = quantity("", "", "what happens in it")


class Scenario(Section):
    """One run."""

    name: str = quantity("", "", "short name; the file's name if left out")
    description: str = quantity("", "", "what the run shows")
    device: str = quantity("metal", "", "name of a shipped device, or path of a description")
    override: dict[str, Any] = quantity({}, "", "fields of the device that differ, in description and truth, by dotted name")
    duration_s: float = quantity(10.0, "s", "simulated time", gt=0, le=1e6)
    seed: int = quantity(1, "", "of all noise", ge=0, lt=2**64)
    temperature: Temperature = Field(default_factory=ConstantTemperature, description="temperature profile")
    rate: Rate = Field(default_factory=ConstantRate, description="rate profile")
    mode: Mode = Field(default_factory=Mode)
    recording: Recording = Field(default_factory=Recording)
    segment: list[Segment] = quantity([], "", "named stretches; none: the profiles' knots are the boundaries in the recording")
    command: list[AnyCommand] = quantity([], "", "what is asked of the device while it runs: at_s, kind, and the kind's fields")
    calibration: str = quantity("nominal", "", "nominal: bias is the described cross damping; zero_rate: bias is the whole output at zero "
                                "rate, split included, as a sweep would find it; none: the firmware's default; or a path (.json, .bin)")
    plant: Plant = Field(default_factory=Plant)

    def to_toml(self) -> str:
        """The complete scenario, no default left out."""
        return toml_text.dumps(self.model_dump(mode="json", exclude_none=True))

    def changed(self, dotted: dict[str, Any], source: str = "--set") -> Scenario:
        """The same run with some fields changed: {"rate.value_deg_s": 5}."""
        if not dotted:
            return self
        return parse(toml_text.merge(self.model_dump(mode="json", exclude_none=True), toml_text.nested(dotted)), source)


@dataclass(frozen=True)
class Run:
    """A scenario with its device, checked against each other."""

    scenario: Scenario
    device: Device
    """as described: the nominal calibration is made from it"""
    truth: Device
    """as simulated"""

    @property
    def n_blocks(self) -> int:
        """Length in blocks (slow ticks)."""
        return max(1, round(self.scenario.duration_s * self.device.slow_rate_hz))

    def divisor(self, rate_hz: float) -> int:
        """Slow ticks per record at that rate; 0 = none."""
        return round(self.device.slow_rate_hz / rate_hz) if rate_hz > 0 else 0

    @property
    def output_filter(self) -> str:
        """The calibration's name of the chosen output filter."""
        return output_filter_at(self.scenario.mode.output_filter_hz, self.device.slow_rate_hz)

    def block_times_s(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Start and end [s] of `count` blocks from number `first` on, shape (count,) each. A sample ends the interval before it, and the first one is
        taken at 0: so blocks begin one sample early."""
        edges = np.arange(first, first + count + 1) / self.device.slow_rate_hz - 1.0 / self.device.electronics.sample_rate_hz
        return edges[:-1], edges[1:]

    def rate_rad_s(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Rate at the middle of each block [rad/s] and its slope [rad/s^2], shape (count,) each."""
        start, end = self.block_times_s(first, count)
        return self.scenario.rate.at(0.5 * (start + end)), self.scenario.rate.slope_over(start, end)

    def temperature_degc(self, first: int, count: int) -> np.ndarray:
        """Chamber (or imposed shell) temperature at the end of each block [degC], shape (count,)."""
        return self.scenario.temperature.at(self.block_times_s(first, count)[1])

    @property
    def initial_degc(self) -> float:
        return float(self.scenario.temperature.at(np.zeros(1))[0])


def names() -> list[str]:
    """Names of the scenarios that ship."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load(name_or_path: str | Path) -> Scenario:
    """A shipped scenario by its name, or one by its path."""
    path = _find(name_or_path)
    data = toml_text.read(path)
    data.setdefault("name", path.stem)
    return parse(data, str(path), path.parent)


def parse(data: dict[str, Any], source: str, folder: Path | None = None) -> Scenario:
    """A checked scenario. Profiles from CSV files (relative to `folder`) are read; device and calibration paths become absolute."""
    data = _with_default_kinds(data)
    scenario: Scenario = validate(Scenario, data, source)
    changes: dict[str, Any] = {}
    if isinstance(scenario.temperature, CsvTemperature):
        changes["temperature"] = _read_csv(scenario.temperature, folder or Path("."), source)
    if folder is not None and scenario.calibration not in ("nominal", "zero_rate", "none"):
        changes["calibration"] = str((folder / scenario.calibration).resolve())
    if folder is not None and scenario.device.endswith(".toml"):
        changes["device"] = str(devices.find(scenario.device, beside=folder))
    return scenario.model_copy(update=changes) if changes else scenario


def prepare(scenario: Scenario, device: Device | None = None) -> Run:
    """The scenario with its device (or another one), overrides applied, and all rates checked."""
    where = f"scenario {scenario.name or '(unnamed)'}"
    described = (devices.load(scenario.device) if device is None else device).override(scenario.override, f"{where}, override")
    truth = described.override(scenario.plant.override, f"{where}, plant.override")
    if not scenario.plant.cross_damping:
        truth = truth.override({"resonator.cross_damping_rad_s": [0.0]})
    run = Run(scenario, described, truth)
    _check_rates(run, where)
    _check_filter(run, where)
    late = [("burst", burst.time_s) for burst in scenario.recording.bursts] + [("command", command.at_s) for command in scenario.command]
    late = [(what, time_s) for what, time_s in late if time_s >= scenario.duration_s]
    if late:
        raise BadInput(f"a {late[0][0]} at {late[0][1]:g} s begins after the end at {scenario.duration_s:g} s", where, "ask for it earlier")
    return run


def split_settings(assignments: list[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """'key=value' texts -> (scenario fields, device fields), told apart by the first part of the key."""
    for_scenario: dict[str, Any] = {}
    for_device: dict[str, Any] = {}
    for text in assignments:
        key, value = toml_text.assignment(text)
        head = key.split(".")[0]
        if head in Scenario.model_fields:
            for_scenario[key] = value
        elif head in Device.model_fields:
            for_device[key] = value
        else:
            known = [name for name in (*Scenario.model_fields, *Device.model_fields) if name not in ("name", "description")]
            raise BadInput(f"'{key}' is a field of neither scenario nor device", "--set", f"begin with one of {', '.join(known)}")
    return for_scenario, for_device


def _find(name_or_path: str | Path) -> Path:
    text = str(name_or_path)
    path = Path(text) if text.endswith(".toml") else FOLDER / f"{text}.toml"
    if path.is_file():
        return path
    raise BadInput("no such scenario", text, f"choose one of {', '.join(names())}, or give the path of a .toml file")


def _with_default_kinds(data: dict[str, Any]) -> dict[str, Any]:
    """A profile without a kind is a constant one."""
    tables = {key: {"kind": "constant", **data[key]} for key in ("temperature", "rate") if isinstance(data.get(key), dict)}
    return {**data, **tables}


def _check_rates(run: Run, where: str) -> None:
    for name in ("baseband_hz", "output_hz", "reference_hz"):
        rate_hz = getattr(run.scenario.recording, name)
        ratio = run.device.slow_rate_hz / rate_hz if rate_hz > 0 else 1.0
        if abs(ratio - round(ratio)) > 1e-9 * ratio or ratio < 1 or ratio > 65535:
            raise BadInput(f"{rate_hz:g} Hz does not divide the slow rate {run.device.slow_rate_hz:g} Hz",
                           f"{where}, recording.{name}", "choose the slow rate over a whole number, or 0")


def _check_filter(run: Run, where: str) -> None:
    try:
        _ = run.output_filter
    except BadInput as error:
        raise BadInput(error.what, f"{where}, mode.output_filter_hz", error.todo) from None


def _read_csv(profile: CsvTemperature, folder: Path, source: str) -> TableTemperature:
    table = read_table(folder / profile.path)
    times = _column(table, profile.time_column, "time")
    values = _column(table, profile.temperature_column, "temperature")
    if np.any(np.diff(times) <= 0):
        line = int(table.lines[int(np.argmax(np.diff(times) <= 0)) + 1])
        raise BadInput("time does not increase", f"{table.path}, line {line}", "sort the rows and remove doubles")
    if values.min() < -100 or values.max() > 200:
        raise BadInput("temperature outside -100 to 200 degC", table.path, f"check column {profile.temperature_column} and its unit")
    return TableTemperature(acts_on=profile.acts_on, times_s=list(map(float, times - times[0])), values_degc=list(map(float, values)))


def _column(table: Table, name: str, dimension: str) -> np.ndarray:
    column = table.column(name)
    if column is None:
        raise BadInput(f"no column '{name}'", table.path, f"columns are {', '.join(item.name for item in table.columns)}")
    unit = units.find(column.unit or "")
    if unit is None or unit.dimension != dimension:
        raise BadInput(f"column '{name}' has no unit of {dimension}", f"{table.path}, line 1",
                       f"write {name}[{units.BASE_UNIT[dimension]}] (known: {', '.join(units.names(dimension))})")
    return units.to_base(column.values, unit)
