"""What the bench knew, put into a recording that was made live: the table's rate and the chamber's temperature as the tap `reference`.

From the bench's own log, or, where there is none, from the plan that chamber and table followed. The recording is not changed; a new one is made."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from wineglass.atomic import atomic_path
from wineglass.errors import BadInput
from wineglass.importers.csv import CsvData
from wineglass.recording import CHANNELS, Recording
from wineglass.recording import layout
from wineglass.scenario import Scenario

TAP = "reference"
PARTS = 10  # points of a frame, whose mean stands for it
Law = Callable[[np.ndarray], np.ndarray]
"""Times [s] since the bench's start, any shape -> values"""


@dataclass(frozen=True)
class Source:
    """laws: channel of the reference tap -> its course; from_s, to_s: where they are known"""

    what: str
    laws: dict[str, Law]
    from_s: float
    to_s: float


@dataclass(frozen=True)
class Added:
    channels: list[str]
    samples: int
    unknown: int
    """frames outside the source's time"""


def from_log(data: CsvData, name: str, offset_s: float) -> Source:
    """A log whose time plus `offset_s` counts from the bench's start; straight lines between its rows."""
    times = data.time_s + offset_s
    channels = {channel: values for channel, values in data.channels.items() if CHANNELS[channel].tap == TAP}
    if not channels:
        known = ", ".join(channel for channel, entry in CHANNELS.items() if entry.tap == TAP)
        raise BadInput("no column is a reference", name, f"name one, e.g. --column true_rate=COLUMN (known: {known})")
    laws: dict[str, Law] = {channel: _interpolation(times, values) for channel, values in channels.items()}
    return Source(f"log {name}", laws, float(times[0]), float(times[-1]))


def from_plan(plan: Scenario, offset_s: float) -> Source:
    """Rate and chamber temperature as they were planned, from `offset_s` on."""
    laws: dict[str, Law] = {"true_rate": lambda t: plan.rate.at(t - offset_s), "chamber_temperature": lambda t: plan.temperature.at(t - offset_s)}
    return Source(f"as planned: {plan.name or 'scenario'}", laws, offset_s, offset_s + plan.duration_s)


def add(recording: Path, target: Path, source: Source) -> Added:
    """Frame for frame beside what was recorded: means of the source over the same intervals."""
    with Recording.open(recording) as found:
        if TAP in found:
            raise BadInput("it has a reference already", str(recording), "take the recording as it was made")
        tap = next((found.tap(name) for name in ("output", "baseband") if name in found), None)
        if tap is None:
            raise BadInput("it has neither baseband nor output", str(recording), "record frames, not only bursts")
        start_s = _start_s(found, tap.first_sample / found.counter_rate_hz - 0.5 / tap.sample_rate_hz)
        first_sample, rate_hz, middles = tap.first_sample, tap.sample_rate_hz, np.asarray(tap.time_s) - start_s
        counter_rate_hz = found.counter_rate_hz
    known = (middles - 0.5 / rate_hz >= source.from_s) & (middles + 0.5 / rate_hz <= source.to_s)
    if not known.any():
        raise BadInput(f"{source.what} and the recording have no time in common", str(recording), "check --offset")
    points = middles[:, None] + ((np.arange(PARTS) + 0.5) / PARTS - 0.5) / rate_hz
    values = {name: np.where(known, law(points).mean(axis=1), 0.0) for name, law in source.laws.items()}
    with atomic_path(target) as temporary:
        shutil.copyfile(recording, temporary)
        with h5py.File(temporary, "r+") as file:
            _write(file, values, ~known, rate_hz, first_sample)
            _note(file, round(start_s * counter_rate_hz), source.what)
        with Recording.open(temporary):
            pass  # what is written reads back, or nothing is
    return Added(list(values), len(middles), int(np.sum(~known)))


def _interpolation(times_s: np.ndarray, values: np.ndarray) -> Law:
    return lambda t: np.interp(t, times_s, values)


def _start_s(recording: Recording, otherwise_s: float) -> float:
    """When the script began, else when the first frame did; s on the device's counter."""
    began = [event.sample for event in recording.events if event.kind == "script"]
    return began[0] / recording.counter_rate_hz if began else otherwise_s


def _write(file: h5py.File, values: dict[str, np.ndarray], lost: np.ndarray, rate_hz: float, first_sample: int) -> None:
    group = file.create_group(TAP)
    group.attrs[layout.SAMPLE_RATE], group.attrs[layout.FIRST_SAMPLE] = rate_hz, np.int64(first_sample)
    for name, column in values.items():
        data = group.create_dataset(name, data=column.astype(np.float64), compression="gzip", compression_opts=1, shuffle=True)
        data.attrs[layout.UNIT], data.attrs[layout.SCALE], data.attrs[layout.OFFSET] = CHANNELS[name].unit, 1.0, 0.0
    group.create_dataset(layout.LOST, data=lost.astype(np.uint8), compression="gzip", compression_opts=1)


def _note(file: h5py.File, sample: int, what: str) -> None:
    """One event more, in its place."""
    old = file[layout.EVENTS][:] if layout.EVENTS in file else np.empty(0, layout.event_dtype())
    rows = np.concatenate([old, np.array([(max(0, sample), "reference", what)], dtype=layout.event_dtype())])
    if layout.EVENTS in file:
        del file[layout.EVENTS]
    file.create_dataset(layout.EVENTS, data=rows[np.argsort(rows["sample"], kind="stable")], maxshape=(None,), dtype=layout.event_dtype())
