"""Streaming writer. The file grows as NAME.part and gets its name when it is closed, so a file of that name is always whole."""

from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType

import h5py
import numpy as np

from wineglass.errors import BadInput
from wineglass.recording import channels as table
from wineglass.recording import layout
from wineglass.recording.model import Event, RecordingMeta, TapFormat

_CHUNK = 4096
_BUFFERED = 4 * _CHUNK
MAX_GAP_SAMPLES = 100_000_000  # a longer jump of the counter is a corrupt counter, not a gap


class _Stream:
    """One growing group: channel datasets of equal length and their mask of lost samples."""

    def __init__(self, group: h5py.Group, tap: str, form: TapFormat, counter_rate_hz: float, first_sample: int):
        self._group = group
        self._counts_per_sample = counter_rate_hz / form.sample_rate_hz
        self.first_sample = first_sample
        self.length = 0
        self._pending: dict[str, list[np.ndarray]] = {name: [] for name in (*form.channels, layout.LOST)}
        self._pending_length = 0
        group.attrs[layout.SAMPLE_RATE] = float(form.sample_rate_hz)
        group.attrs[layout.FIRST_SAMPLE] = np.int64(first_sample)
        for name, channel in form.channels.items():
            data = self._create(name, channel.dtype)
            data.attrs[layout.UNIT] = _entry(tap, name).unit
            data.attrs[layout.SCALE] = float(channel.scale)
            data.attrs[layout.OFFSET] = float(channel.offset)
        self._create(layout.LOST, "u1")

    def _create(self, name: str, dtype: str) -> h5py.Dataset:
        return self._group.create_dataset(
            name, shape=(0,), maxshape=(None,), chunks=(_CHUNK,), dtype=dtype, compression="gzip", compression_opts=1, shuffle=True
        )

    def gap_before(self, first_sample: int) -> int:
        """Samples missing between what is held and `first_sample`; negative where they overlap."""
        gap = (first_sample - self.first_sample) / self._counts_per_sample - self.length
        if abs(gap - round(gap)) > 0.5 / self._counts_per_sample + 1e-6:
            raise ValueError(f"{self._group.name}: counter {first_sample} is not on this tap's sample grid")
        return round(gap)

    def fill_lost(self, count: int) -> None:
        for start in range(0, count, _BUFFERED):
            n = min(_BUFFERED, count - start)
            filler = {name: np.zeros(n, self._group[name].dtype) for name in self._pending if name != layout.LOST}
            self.extend(filler, np.ones(n, np.uint8))

    def extend(self, data: dict[str, np.ndarray], lost: np.ndarray) -> None:
        for name, values in data.items():
            self._pending[name].append(values)
        self._pending[layout.LOST].append(lost)
        self.length += len(lost)
        self._pending_length += len(lost)
        if self._pending_length >= _BUFFERED:
            self.flush()

    def flush(self) -> None:
        if self._pending_length == 0:
            return
        for name, blocks in self._pending.items():
            dataset = self._group[name]
            dataset.resize((self.length,))
            dataset[self.length - self._pending_length :] = np.concatenate(blocks)
            blocks.clear()
        self._pending_length = 0


class RecordingWriter:
    """Append samples tap by tap; missing counters become lost samples.

    Use it as a context manager: leaving it normally or by Ctrl-C (or SystemExit) finishes a valid file, any other exception removes the
    partial file. Codes are arrays (n,) per channel in the dtype the tap was declared with.
    """

    def __init__(self, path: str | os.PathLike[str], meta: RecordingMeta):
        self.path = Path(path)
        self._part = self.path.with_name(self.path.name + ".part")
        self._meta = meta
        self._formats: dict[str, TapFormat] = {}
        self._streams: dict[str, _Stream] = {}
        self._events: list[Event] = []
        self._bursts = 0
        if not meta.counter_rate_hz > 0:
            raise ValueError("counter_rate_hz must be positive")
        if not self.path.parent.is_dir():
            raise BadInput("the folder does not exist", self.path.parent, "create it or choose another output path")
        if self.path.is_dir():
            raise BadInput("is a folder", self.path, "give a file name")
        try:
            self._file: h5py.File | None = h5py.File(self._part, "w")
        except OSError as error:
            raise BadInput("cannot write the recording", str(self.path), f"check the folder ({_first_line(error)})") from error
        self._write_meta(self._file, meta)
        for tap, form in meta.taps.items():
            self.add_tap(tap, form)

    @staticmethod
    def _write_meta(file: h5py.File, meta: RecordingMeta) -> None:
        file.attrs[layout.FORMAT_ATTRIBUTE] = layout.FORMAT
        file.attrs[layout.VERSION_ATTRIBUTE] = np.int64(layout.VERSION)
        file.attrs[layout.COUNTER_RATE] = float(meta.counter_rate_hz)
        file.attrs[layout.FIRMWARE_VERSION] = meta.firmware_version
        file.attrs[layout.SOURCE] = meta.source
        if meta.calibration_crc is not None:
            file.attrs[layout.CALIBRATION_CRC] = np.uint32(meta.calibration_crc)
        file[layout.DEVICE] = meta.device_toml
        file[layout.CALIBRATION_JSON] = meta.calibration_json
        file[layout.CALIBRATION_BLOCK] = np.frombuffer(meta.calibration_block, np.uint8)

    def add_tap(self, tap: str, form: TapFormat) -> None:
        """Declare a tap before its first append. The raw tap's groups are made burst by burst."""
        if tap not in table.TAPS:
            raise ValueError(f"unknown tap {tap}")
        if tap in self._formats:
            raise ValueError(f"tap {tap} is declared already")
        if not form.sample_rate_hz > 0:
            raise ValueError(f"{tap}: sample_rate_hz must be positive")
        for name in form.channels:
            _entry(tap, name)
        self._formats[tap] = form

    def append(
        self,
        tap: str,
        data: dict[str, np.ndarray],
        first_sample: int,
        *,
        lost: np.ndarray | None = None,
        state_snapshot: bytes | None = None,
    ) -> None:
        """Add a block whose first sample stands at `first_sample` of the common counter.

        A jump forward is filled with lost samples (in `raw` it begins a new burst, as a `state_snapshot` does); a jump backward is refused.
        """
        block = self._checked(tap, data)
        count = len(next(iter(block.values())))
        mask = np.zeros(count, np.uint8) if lost is None else np.asarray(lost).astype(bool).astype(np.uint8)
        if mask.shape != (count,):
            raise ValueError(f"{tap}: the lost mask has another length than the data")
        stream = self._streams.get(tap)
        gap = 0 if stream is None else stream.gap_before(first_sample)
        if gap < 0 or (gap > MAX_GAP_SAMPLES and tap != layout.RAW):
            raise BadInput(
                f"{tap}: the sample counter jumps by {gap} samples", f"at counter {first_sample}", "check the source's sample counter"
            )
        if stream is None or (tap == layout.RAW and (gap > 0 or state_snapshot is not None)):
            stream = self._begin(tap, first_sample, state_snapshot)
            gap = 0
        stream.fill_lost(gap)
        stream.extend(block, mask)

    def event(self, kind: str, value: str = "", *, sample: int) -> None:
        """Note an event at a position of the common sample counter."""
        self._events.append(Event(int(sample), kind, value))

    def flush(self) -> None:
        for stream in self._streams.values():
            stream.flush()
        if self._file is not None:
            self._file.flush()

    def close(self) -> None:
        """Write what is pending, and give the file its name."""
        if self._file is None:
            return
        self.flush()
        rows = sorted(self._events, key=lambda event: event.sample)
        table_rows = np.array([(e.sample, e.kind, e.value) for e in rows], dtype=layout.event_dtype())
        self._file.create_dataset(layout.EVENTS, data=table_rows, maxshape=(None,))
        self._file.close()
        self._file = None
        os.replace(self._part, self.path)

    def abort(self) -> None:
        """Give up and leave nothing behind."""
        if self._file is None:
            return
        self._file.close()
        self._file = None
        self._part.unlink(missing_ok=True)

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is not None and issubclass(kind, Exception):
            self.abort()
            return
        if kind is not None:
            self.event("interrupted", kind.__name__, sample=self._end_sample())
        self.close()

    def _end_sample(self) -> int:
        ends = [s.first_sample + round(s.length * s._counts_per_sample) for s in self._streams.values()]
        return max(ends, default=0)

    def _begin(self, tap: str, first_sample: int, state_snapshot: bytes | None) -> _Stream:
        assert self._file is not None
        if first_sample < 0:
            raise ValueError("first_sample must not be negative")
        if tap == layout.RAW and (old := self._streams.get(tap)) is not None:
            old.flush()
        name = f"{tap}/{layout.BURST.format(self._bursts)}" if tap == layout.RAW else tap
        group = self._file.create_group(name)
        stream = _Stream(group, tap, self._formats[tap], self._meta.counter_rate_hz, first_sample)
        self._streams[tap] = stream
        if tap == layout.RAW:
            self._bursts += 1
            group[layout.SNAPSHOT] = np.frombuffer(state_snapshot or b"", np.uint8)
        return stream

    def _checked(self, tap: str, data: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The block as arrays in the declared types; integers must fit."""
        if self._file is None:
            raise ValueError("the recording is closed")
        form = self._formats.get(tap)
        if form is None:
            raise ValueError(f"tap {tap} is not declared")
        if data.keys() != form.channels.keys():
            raise ValueError(f"{tap}: expected exactly the channels {', '.join(form.channels)}")
        block = {name: _as_type(name, values, np.dtype(form.channels[name].dtype)) for name, values in data.items()}
        if len({values.shape for values in block.values()}) > 1:
            raise ValueError(f"{tap}: the channels differ in length")
        return block


def _as_type(name: str, values: np.ndarray, dtype: np.dtype) -> np.ndarray:
    array = np.atleast_1d(np.asarray(values))
    if array.ndim != 1:
        raise ValueError(f"{name}: one dimension expected")
    if dtype.kind in "iu":
        if array.dtype.kind not in "iub":
            raise ValueError(f"{name}: integer codes expected")
        limits = np.iinfo(dtype)
        if array.size and (array.min() < limits.min or array.max() > limits.max):
            raise ValueError(f"{name}: a code does not fit {dtype}")
    return np.array(array, dtype=dtype)


def _entry(tap: str, name: str) -> table.Channel:
    entry = table.find(tap, name)
    if entry is None:
        raise ValueError(f"tap {tap} has no channel {name}")
    return entry


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
