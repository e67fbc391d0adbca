"""CSV table -> recording. Every column that is used must say its unit, in the header or by --unit."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wineglass import units
from wineglass.errors import BadInput
from wineglass.importers.table import Column, Table, read_table
from wineglass.recording import CHANNELS, RecordingMeta, RecordingWriter, TapFormat, float_format
from wineglass.recording.channels import TIME

_ROLES = {"temperature": "temperature_measured"}  # short names beside the channel names
_USUAL_NAMES = {
    "time": ("t", "time", "timestamp"),
    "temperature": ("temperature", "temp", "temperature_measured"),
    "rate": ("rate", "gyro", "gyro_rate", "angular_rate"),
}
_UNIFORM = 1e-3  # of a sample: times this close to an even grid are stored as a sample rate


@dataclass(frozen=True)
class ImportOptions:
    """columns: role or channel -> column; unit_of: column -> unit; drop_rows: data rows counted from 0; columns_flag: what the command calls `columns`"""

    columns: dict[str, str]
    unit_of: dict[str, str]
    drop_rows: frozenset[int] = frozenset()
    columns_flag: str = "--map"


@dataclass(frozen=True)
class ImportResult:
    rows: int
    duration_s: float
    sample_rate_hz: float
    uniform: bool
    channels: dict[str, str]
    """channel -> column it came from"""
    ignored: list[str]


@dataclass(frozen=True)
class CsvData:
    """time_s (n,), channels: name -> values (n,) in the channel table's unit"""

    time_s: np.ndarray
    channels: dict[str, np.ndarray]
    source: dict[str, str]
    ignored: list[str]


def import_csv(source: Path, target: Path, options: ImportOptions) -> ImportResult:
    data = read_csv(source, options)
    rate_hz, first_sample, uniform = _grid(data.time_s)
    by_tap: dict[str, dict[str, np.ndarray]] = {}
    for name, values in data.channels.items():
        by_tap.setdefault(CHANNELS[name].tap, {})[name] = values
    with RecordingWriter(target, RecordingMeta(counter_rate_hz=rate_hz, source=f"imported from {source.name}")) as writer:
        for tap, columns in by_tap.items():
            block = columns if uniform else {TIME.name: data.time_s, **columns}
            writer.add_tap(tap, TapFormat(rate_hz, {name: float_format() for name in block}))
            writer.append(tap, block, first_sample)
    span = float(data.time_s[-1] - data.time_s[0])
    return ImportResult(len(data.time_s), span, rate_hz, uniform, data.source, data.ignored)


def read_csv(source: Path, options: ImportOptions) -> CsvData:
    """The columns that are used, in SI, time checked."""
    table = read_table(source, options.drop_rows)
    _check_options(table, options)
    chosen = _choose_columns(table, options)
    si = {role: _to_si(table, column, role, options) for role, column in chosen.items()}
    time_s = si.pop("time")
    _check_time(time_s, table)
    _check_temperatures(si, table)
    used = {column.name for column in chosen.values()}
    return CsvData(
        time_s=time_s,
        channels={_channel(role): values for role, values in si.items()},
        source={_channel(role): column.name for role, column in chosen.items()},
        ignored=[column.name for column in table.columns if column.name not in used],
    )


def _channel(role: str) -> str:
    return _ROLES.get(role, role)


def _check_options(table: Table, options: ImportOptions) -> None:
    have, flag = ", ".join(column.name for column in table.columns), options.columns_flag
    for role, name in options.columns.items():
        if role != "time" and _channel(role) not in CHANNELS:
            raise BadInput(f"{flag} {role}: unknown channel", table.path, f"use time, temperature, rate, or one of {', '.join(CHANNELS)}")
        if role != "time" and CHANNELS[_channel(role)].tap == "raw":
            raise BadInput(f"{flag} {role}: raw codes do not come from a table", table.path, "map baseband, output or reference channels")
        if table.column(name) is None:
            raise BadInput(f"{flag} {role}={name}: no such column", table.path, f"the columns are: {have}")
    channels = [_channel(role) for role in options.columns]
    for channel in channels:
        if channels.count(channel) > 1:
            raise BadInput(f"{flag} names {channel} twice", table.path, "give one column per channel")
    for name in options.unit_of:
        if table.column(name) is None:
            raise BadInput(f"--unit {name}: no such column", table.path, f"the columns are: {have}")


def _choose_columns(table: Table, options: ImportOptions) -> dict[str, Column]:
    """Role or channel -> column: as told, else by usual names and by the channels' own names."""
    chosen = {role: table.column(name) for role, name in options.columns.items()}
    taken = {column.name for column in chosen.values()}
    channels = {_channel(role) for role in chosen}
    for column in table.columns:
        role = _usual_role(column.name)
        if role is None or column.name in taken or _channel(role) in channels:
            continue
        chosen[role] = column
        channels.add(_channel(role))
    _check_complete(table, chosen, options.columns_flag)
    return chosen


def _usual_role(name: str) -> str | None:
    stem, _, ending = name.rpartition("_")
    for role, usual in _USUAL_NAMES.items():
        if name.lower() in usual or (stem.lower() in usual and _is_unit_of(ending, role)):
            return role
    known = CHANNELS.get(name)
    return name if known is not None and known.tap != "raw" else None


def _is_unit_of(ending: str, role: str) -> bool:
    """t_s, temperature_degC: the ending says what the column is. It is no statement of the unit: that is asked for."""
    unit = units.find(ending)
    return unit is not None and unit.dimension == ("time" if role == "time" else units.find(CHANNELS[_channel(role)].unit).dimension)


def _check_complete(table: Table, chosen: dict[str, Column], flag: str) -> None:
    have = ", ".join(column.name for column in table.columns)
    if "time" not in chosen:
        raise BadInput("no column is known as time", table.path, f"add {flag} time=COLUMN (columns: {have})")
    if len(chosen) == 1:
        raise BadInput(
            "no column is known as a channel", table.path, f"add {flag} temperature=COLUMN {flag} rate=COLUMN (columns: {have})"
        )


def _to_si(table: Table, column: Column, role: str, options: ImportOptions) -> np.ndarray:
    name = options.unit_of.get(column.name, column.unit)
    flag = f"--unit {shlex.quote(column.name)}="
    dimension = "time" if role == "time" else units.find(CHANNELS[_channel(role)].unit).dimension
    choices = ", ".join(units.names(dimension))
    if column.unit and name != column.unit:
        raise BadInput(f"column {column.name}: the header says {column.unit}, --unit says {name}", f"{table.path}, line 1", "drop --unit")
    if not name:
        todo = f"add {flag}{_guess(column.name, dimension)} (or: {choices})"
        raise BadInput(f"column {column.name} has no unit", f"{table.path}, line 1", todo)
    unit = units.find(name)
    if unit is None:
        raise BadInput(f"column {column.name}: unknown unit {name!r}", f"{table.path}, line 1", f"add {flag}UNIT with one of: {choices}")
    if unit.dimension != dimension:
        raise BadInput(
            f"column {column.name}: {name} is a unit of {unit.dimension}, not of {dimension}",
            f"{table.path}, line 1",
            f"map another column, or add {flag}UNIT with one of: {choices}",
        )
    return np.asarray(units.to_base(column.values, unit), dtype=np.float64)


def _guess(name: str, dimension: str) -> str:
    """The unit a name's ending suggests (t_s, temperature_degC), else the base unit."""
    ending = units.find(name.rpartition("_")[2])
    return ending.name if ending is not None and ending.dimension == dimension else units.BASE_UNIT[dimension]


def _check_time(time_s: np.ndarray, table: Table) -> None:
    if len(time_s) < 2:
        raise BadInput("only one row", table.path, "a recording needs at least two samples")
    steps = np.diff(time_s)
    if (steps > 0).all():
        return
    at = int(np.argmin(steps > 0)) + 1
    what = "repeats the time before it" if steps[at - 1] == 0 else "goes back in time"
    raise BadInput(f"this row {what}", f"{table.path}, line {table.lines[at]}", "sort the rows by time and drop repeated ones")


def _check_temperatures(si: dict[str, np.ndarray], table: Table) -> None:
    for role, values in si.items():
        cold = values < -273.15
        if CHANNELS[_channel(role)].unit == "degC" and cold.any():
            at = int(np.argmax(cold))
            raise BadInput(f"{role} is {values[at]:g} degC", f"{table.path}, line {table.lines[at]}", "check the column's unit")


def _grid(time_s: np.ndarray) -> tuple[float, int, bool]:
    """(mean sample rate in Hz, counter of the first sample, whether these two alone give back every time)."""
    count = len(time_s) - 1
    rate_hz = count / float(time_s[-1] - time_s[0])
    first = round(float(time_s[0]) * rate_hz)
    ideal = (first + np.arange(count + 1)) / rate_hz
    uniform = first >= 0 and bool(np.all(np.abs(time_s - ideal) * rate_hz < _UNIFORM))
    return rate_hz, first if uniform else 0, uniform
