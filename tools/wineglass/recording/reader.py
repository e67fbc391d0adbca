"""Reader. A file is checked when it is opened: strict about meaning, tolerant of what it does not know."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np

from wineglass import units
from wineglass.errors import BadInput
from wineglass.recording import channels as table
from wineglass.recording import layout
from wineglass.recording.attributes import integer, number, text, whole_text
from wineglass.recording.model import Event

_PIECE = 1 << 20
_LARGEST_PACKING = 2000  # bytes of values per byte of file; gzip reaches 1032


@dataclass
class Tap:
    """One group of channels with a common sample rate; a burst of the raw tap is one, too.

    channels: name -> unit of the values handed out (base unit of its dimension: rad/s, degC, s, Hz, FS, bits)
    ignored: datasets of the group that are not in the channel table
    """

    name: str
    sample_rate_hz: float
    first_sample: int
    counter_rate_hz: float
    length: int
    channels: dict[str, str]
    ignored: list[str]
    state_snapshot: bytes
    _group: h5py.Group
    _path: str
    tolerant: bool = False
    """pieces of the file that cannot be read count as lost samples instead of being refused"""
    _cache: dict[str, np.ndarray] = field(default_factory=dict)

    def __len__(self) -> int:
        return self.length

    def __contains__(self, channel: object) -> bool:
        return channel in self.channels

    def __getitem__(self, channel: str) -> np.ndarray:
        """Values (n,) float64 in `channels[channel]`; NaN where the sample was lost."""
        if channel not in self._cache:
            values = self._values(channel)
            values[self.lost] = np.nan
            self._cache[channel] = values
        return self._cache[channel]

    def codes(self, channel: str) -> np.ndarray:
        """Codes (n,) as stored; at lost samples they mean nothing."""
        self._require(channel)
        return _read(self._group[channel], self._path, self.tolerant)

    @cached_property
    def lost(self) -> np.ndarray:
        """Mask (n,) bool, true where the sample was lost, or where the file is damaged."""
        if layout.LOST not in self._group:
            return self.damaged
        return _read(self._group[layout.LOST], self._path, self.tolerant).astype(bool) | self.damaged

    @cached_property
    def damaged(self) -> np.ndarray:
        """Mask (n,) bool, true where the file cannot be read; all false in a recording that was not opened as `tolerant`."""
        mask = np.zeros(self.length, bool)
        for name in (*self.channels, layout.LOST) if self.tolerant else ():
            if name in self._group:
                mask |= _unreadable(self._group[name])
        return mask

    @cached_property
    def valid(self) -> np.ndarray:
        return ~self.lost

    @cached_property
    def time_s(self) -> np.ndarray:
        """Time (n,) in s since counter zero; the `time` channel where there is one."""
        if table.TIME.name in self.channels:
            return self._values(table.TIME.name)
        return self.first_sample / self.counter_rate_hz + np.arange(self.length) / self.sample_rate_hz

    @property
    def duration_s(self) -> float:
        if table.TIME.name in self.channels and self.length > 1:
            return float(self.time_s[-1] - self.time_s[0])
        return self.length / self.sample_rate_hz

    def _values(self, channel: str) -> np.ndarray:
        self._require(channel)
        return _to_values(self._group[channel], _read(self._group[channel], self._path, self.tolerant))

    def _require(self, channel: str) -> None:
        if channel not in self.channels:
            have = ", ".join(self.channels) or "none"
            raise BadInput(f"tap {self.name} has no channel {channel}", self._path, f"it holds: {have}")


@dataclass
class Recording:
    """An open recording. `tap(name)` for baseband, output, reference; `bursts` for raw."""

    path: str
    counter_rate_hz: float
    format_version: int
    firmware_version: str
    source: str
    device_toml: str
    calibration_json: str
    calibration_block: bytes
    calibration_crc: int | None
    """of the calibration in force, as the device reported it"""
    events: list[Event]
    taps: dict[str, Tap]
    bursts: list[Tap]
    _file: h5py.File

    @staticmethod
    def open(path: str | os.PathLike[str], *, tolerant: bool = False) -> Recording:
        """Open and check; whatever is wrong raises BadInput. tolerant: pieces of the file that cannot be read become lost samples."""
        return _open(Path(path), tolerant)

    def tap(self, name: str) -> Tap:
        if name not in self.taps:
            have = ", ".join([*self.taps, *(["raw"] if self.bursts else [])]) or "none"
            raise BadInput(f"the recording has no tap {name}", self.path, f"it holds: {have}")
        return self.taps[name]

    def __contains__(self, tap: object) -> bool:
        return bool(self.bursts) if tap == layout.RAW else tap in self.taps

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _open(path: Path, tolerant: bool) -> Recording:
    where = str(path)
    file = _open_file(path)
    try:
        _check_sizes(file, path.stat().st_size, where)
        return _read_root(file, where, tolerant)
    except BadInput:
        file.close()
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, MemoryError) as error:
        file.close()
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BadInput("the recording is damaged", where, f"record or copy it again ({reason})") from error


def _open_file(path: Path) -> h5py.File:
    if not path.exists():
        raise BadInput("no such file", str(path), "check the name")
    if path.is_dir():
        raise BadInput("this is a folder, not a recording", str(path), "name the file")
    if not os.access(path, os.R_OK):
        raise BadInput("the file cannot be read", str(path), "check its permissions")
    try:
        return h5py.File(path, "r")
    except OSError as error:
        if "truncated" in str(error):
            raise BadInput("the recording is truncated", str(path), "record or copy it again") from error
        raise BadInput("not an HDF5 file", str(path), "give a recording, or import a table: wineglass import FILE.csv") from error


def _check_sizes(file: h5py.File, file_bytes: int, where: str) -> None:
    """Before anything of it is asked for: a damaged length may speak of terabytes."""
    def check(name: str, entry: h5py.Dataset | h5py.Group) -> None:
        if isinstance(entry, h5py.Dataset) and entry.size is not None and entry.size * entry.dtype.itemsize > _LARGEST_PACKING * file_bytes:
            raise BadInput(f"/{name} claims more values than the file can hold", where, "the recording is damaged: record or copy it again")

    file.visititems(check)


def _read_root(file: h5py.File, where: str, tolerant: bool) -> Recording:
    if text(file.attrs, layout.FORMAT_ATTRIBUTE, where, default="") != layout.FORMAT:
        raise BadInput("HDF5, but not a wineglass recording", where, f"its attribute {layout.FORMAT_ATTRIBUTE} must be {layout.FORMAT}")
    version = integer(file.attrs, layout.VERSION_ATTRIBUTE, where)
    if not 1 <= version <= layout.VERSION:
        raise BadInput(f"recording format version {version} is unknown", where, f"this program reads version {layout.VERSION}")
    counter_rate_hz = _counter_rate(file, where)
    taps = {
        name: _read_tap(file[name], name, name, counter_rate_hz, where, tolerant)
        for name in table.TAPS
        if name != layout.RAW and isinstance(file.get(name), h5py.Group)
    }
    bursts = _read_bursts(file, counter_rate_hz, where, tolerant)
    if not taps and not bursts:
        raise BadInput("the recording holds no tap", where, f"one of the groups {', '.join(table.TAPS)} is needed")
    return Recording(
        path=where,
        counter_rate_hz=counter_rate_hz,
        format_version=version,
        firmware_version=text(file.attrs, layout.FIRMWARE_VERSION, where, default=""),
        source=text(file.attrs, layout.SOURCE, where, default=""),
        device_toml=whole_text(file, layout.DEVICE, where),
        calibration_json=whole_text(file, layout.CALIBRATION_JSON, where),
        calibration_block=_bytes(file, layout.CALIBRATION_BLOCK),
        calibration_crc=integer(file.attrs, layout.CALIBRATION_CRC, where) if layout.CALIBRATION_CRC in file.attrs else None,
        events=_read_events(file, where),
        taps=taps,
        bursts=bursts,
        _file=file,
    )


def _counter_rate(file: h5py.File, where: str) -> float:
    """The attribute; where it is missing, the raw tap's rate, or any rate while no tap needs it (all begin at counter zero)."""
    if layout.COUNTER_RATE not in file.attrs:
        groups = [file[name] for name in table.TAPS if name != layout.RAW and isinstance(file.get(name), h5py.Group)]
        bursts = list(file[layout.RAW].values()) if isinstance(file.get(layout.RAW), h5py.Group) else []
        rates = [number(g.attrs, layout.SAMPLE_RATE, where) for g in bursts or groups if layout.SAMPLE_RATE in g.attrs]
        if rates and (bursts or all(integer(g.attrs, layout.FIRST_SAMPLE, where) == 0 for g in groups)):
            return max(rates)
    rate = number(file.attrs, layout.COUNTER_RATE, where)
    if not rate > 0:
        raise BadInput(f"{layout.COUNTER_RATE} is {rate:g}", where, "it must be positive")
    return rate


def _read_bursts(file: h5py.File, counter_rate_hz: float, where: str, tolerant: bool) -> list[Tap]:
    raw = file.get(layout.RAW)
    if not isinstance(raw, h5py.Group):
        return []
    names = sorted(name for name in raw if name.startswith(layout.BURST_PREFIX) and isinstance(raw[name], h5py.Group))
    bursts = [_read_tap(raw[name], layout.RAW, f"{layout.RAW}/{name}", counter_rate_hz, where, tolerant) for name in names]
    for before, after in zip(bursts, bursts[1:]):
        end = before.first_sample + before.length * counter_rate_hz / before.sample_rate_hz
        if after.first_sample < end - 0.5:
            what = f"{after.name} begins at counter {after.first_sample}, before {before.name} ends"
            raise BadInput(what, where, "the sample counter must not go back")
    return bursts


def _read_tap(group: h5py.Group, tap: str, name: str, counter_rate_hz: float, where: str, tolerant: bool) -> Tap:
    place = f"{where}, group {name}"
    rate = number(group.attrs, layout.SAMPLE_RATE, place)
    if not rate > 0:
        raise BadInput(f"{layout.SAMPLE_RATE} is {rate:g}", place, "it must be positive")
    first_sample = integer(group.attrs, layout.FIRST_SAMPLE, place)
    if first_sample < 0:
        raise BadInput(f"{layout.FIRST_SAMPLE} is negative", place, "it counts on the common sample counter")
    known = [entry.name for entry in (*table.channels_of(tap), table.TIME) if table.find(tap, entry.name) and entry.name in group]
    if not known:
        raise BadInput("no known channel", place, "docs/recording.md lists the channel names")
    length = _common_length(group, known, place)
    units_of = {key: _check_channel(group[key], table.find(tap, key), place) for key in known}
    lost = _check_lost(group, length, place)
    for key in known:
        _check_values(group[key], key, lost, place, tolerant)
    ignored = [key for key in group if key not in known and key not in (layout.LOST, layout.SNAPSHOT)]
    return Tap(
        name=name,
        sample_rate_hz=rate,
        first_sample=first_sample,
        counter_rate_hz=counter_rate_hz,
        length=length,
        channels=units_of,
        ignored=ignored,
        state_snapshot=_bytes(group, layout.SNAPSHOT),
        _group=group,
        _path=place,
        tolerant=tolerant,
    )


def _common_length(group: h5py.Group, known: list[str], place: str) -> int:
    lengths = {}
    for key in known:
        dataset = group[key]
        if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in "iuf" or dataset.size is None:
            raise BadInput(f"channel {key} is not a numeric dataset", place, "store one number per sample")
        if max(dataset.shape, default=0) != dataset.size:
            raise BadInput(f"channel {key} has shape {dataset.shape}", place, "store one number per sample")
        lengths[key] = dataset.size
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"{key} {count}" for key, count in lengths.items())
        raise BadInput(f"the channels differ in length ({found})", place, "all channels of a tap have the same samples")
    return lengths[known[0]]


def _check_channel(dataset: h5py.Dataset, entry: table.Channel, place: str) -> str:
    """Check unit, scale and offset; returns the unit of the values handed out."""
    if layout.UNIT not in dataset.attrs:
        raise BadInput(f"channel {entry.name} has no unit", place, f"write the attribute {layout.UNIT}, e.g. {entry.unit}")
    name = text(dataset.attrs, layout.UNIT, place)
    unit = units.find(name)
    dimension = units.find(entry.unit).dimension
    if unit is None or unit.dimension != dimension:
        wrong = "is unknown" if unit is None else f"is no unit of {dimension}"
        raise BadInput(f"channel {entry.name}: unit {name!r} {wrong}", place, f"use one of: {', '.join(units.names(dimension))}")
    default = None if dataset.dtype.kind in "iu" and dimension != "bits" else 1.0
    scale = number(dataset.attrs, layout.SCALE, f"{place}/{entry.name}", default=default)
    offset = number(dataset.attrs, layout.OFFSET, f"{place}/{entry.name}", default=0.0)
    if scale == 0.0 or not np.isfinite([scale, offset]).all():
        raise BadInput(f"channel {entry.name}: scale {scale:g}, offset {offset:g}", place, "both must be finite and the scale not zero")
    return units.BASE_UNIT[dimension]


def _check_lost(group: h5py.Group, length: int, place: str) -> h5py.Dataset | None:
    if layout.LOST not in group:
        return None
    lost = group[layout.LOST]
    if not isinstance(lost, h5py.Dataset) or lost.dtype.kind not in "iufb" or lost.size != length:
        raise BadInput(f"the mask {layout.LOST} does not fit its {length} samples", place, "store one number per sample, 1 where lost")
    return lost


def _check_values(dataset: h5py.Dataset, name: str, lost: h5py.Dataset | None, place: str, tolerant: bool) -> None:
    """No NaN or infinity outside lost samples, no temperature below absolute zero, time strictly rising. Piece by piece."""
    is_temperature = units.find(whole_unit(dataset)).dimension == "temperature"
    if dataset.dtype.kind in "iu" and not is_temperature and name != table.TIME.name:
        return
    flat_lost = None if lost is None else _read(lost, place, tolerant).astype(bool)
    if tolerant and name != table.TIME.name and (damaged := _unreadable(dataset)).any():
        flat_lost = damaged if flat_lost is None else flat_lost | damaged
    last = -np.inf
    flat = _read(dataset, place, tolerant and name != table.TIME.name)
    for start in range(0, len(flat), _PIECE):
        values = _to_values(dataset, flat[start : start + _PIECE])
        wrong = ~np.isfinite(values)
        if is_temperature:
            wrong |= values < table.ABSOLUTE_ZERO_DEGC
        if flat_lost is not None and name != table.TIME.name:
            wrong &= ~flat_lost[start : start + _PIECE]
        if wrong.any():
            at = int(np.argmax(wrong))
            raise BadInput(f"channel {name} is {values[at]:g} at sample {start + at}", place, f"mark such samples in {layout.LOST}")
        if name == table.TIME.name and len(values):
            steps = np.diff(np.concatenate(([last], values)))
            if not (steps > 0).all():
                raise BadInput(f"time does not rise at sample {start + int(np.argmin(steps > 0))}", place, "sort the samples by time")
            last = values[-1]


def _read_events(file: h5py.File, where: str) -> list[Event]:
    if layout.EVENTS not in file:
        return []
    place = f"{where}, events"
    rows = file[layout.EVENTS]
    if not isinstance(rows, h5py.Dataset) or not {"sample", "kind", "value"} <= set(rows.dtype.names or ()):
        raise BadInput("the events table has other columns", place, "it needs: sample, kind, value")
    found = [Event(int(row["sample"]), _decoded(row["kind"]), _decoded(row["value"])) for row in np.ravel(rows[()])]
    for before, after in zip(found, found[1:]):
        if after.sample < before.sample:
            raise BadInput(f"event {after.kind!r} at counter {after.sample} goes back", place, "sort the events by their sample counter")
    return found


def _decoded(value: object) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _bytes(group: h5py.Group, name: str) -> bytes:
    if name not in group:
        return b""
    value = group[name][()]
    if isinstance(value, h5py.Empty):
        return b""
    return value if isinstance(value, bytes) else np.asarray(value, np.uint8).tobytes()


def _read(dataset: h5py.Dataset, place: str, tolerant: bool = False) -> np.ndarray:
    """All values as one row (n,), whatever way round the writer stored them. tolerant: zeros where the file is damaged."""
    try:
        return np.ravel(dataset[()])
    except OSError as error:
        if tolerant and dataset.chunks is not None and not _unreadable(dataset).all():
            return _readable(dataset)[0]
        raise BadInput(f"{dataset.name} cannot be read", place, "the recording is damaged: record or copy it again") from error


def _unreadable(dataset: h5py.Dataset) -> np.ndarray:
    """Mask (n,) of the values that the file no longer gives."""
    try:
        dataset[()]
        return np.zeros(dataset.size, bool)
    except OSError:
        return np.ones(dataset.size, bool) if dataset.chunks is None else _readable(dataset)[1]


def _readable(dataset: h5py.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Chunk by chunk: values, zero where they cannot be read, and the mask of those."""
    values, damaged = np.zeros(dataset.shape, dataset.dtype), np.zeros(dataset.shape, bool)
    for piece in dataset.iter_chunks():
        try:
            values[piece] = dataset[piece]
        except OSError:
            damaged[piece] = True
    return values.ravel(), damaged.ravel()


def _to_values(dataset: h5py.Dataset, codes: np.ndarray) -> np.ndarray:
    scale = float(np.ravel(dataset.attrs.get(layout.SCALE, 1.0))[0])
    offset = float(np.ravel(dataset.attrs.get(layout.OFFSET, 0.0))[0])
    unit = units.find(whole_unit(dataset))
    assert unit is not None
    values = codes.astype(np.float64) * scale + offset
    return np.asarray(units.to_base(values, unit), dtype=np.float64)


def whole_unit(dataset: h5py.Dataset) -> str:
    return text(dataset.attrs, layout.UNIT, dataset.name)
