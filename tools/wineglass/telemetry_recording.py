"""Telemetry -> recording: the integers of the device as they are, with the scales and units of telemetry.conversions().

    with RecordingWriter(path, meta) as writer:
        telemetry_to_recording(data, writer)

or, while the data arrive, TelemetryRecorder(writer).feed(data). Taps are declared when their first frame arrives.
A baseband or output sample stands at the middle of the interval it is the mean of.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wineglass.recording import ChannelFormat, RecordingWriter, TapFormat
from wineglass.recording.memory import MemoryRecording
from wineglass.recording.writer import MAX_GAP_SAMPLES
from wineglass.telemetry import Chunk, Conversion, Decoder, Identity, RawSamples, SnapshotAssembler, conversions, raw_samples, worst_status

_DTYPES = {"freq": "u8", "status": "u4", "angle": "i8"}


class TelemetryRecorder:
    """Feeds a RecordingWriter, or a recording in memory. Frames before the first identity frame wait for it.

    A recording has one sample counter and one calibration: `ended` says why nothing after it belongs to this recording."""

    def __init__(self, writer: RecordingWriter | MemoryRecording, decoder: Decoder | None = None, intervals: dict[str, int] | None = None):
        """intervals: tap -> samples per frame, where they are known; otherwise the first frames' most frequent one"""
        self.decoder = decoder or Decoder()
        self.identity: Identity | None = None
        self.ignored_frames = 0
        """means over another interval than the tap's first one, over time before the device started, or out of place"""
        self.ended = ""
        self.begin_sample = self.end_sample = 0
        """on the common counter: what has been recorded; equal while there is nothing"""
        self._writer = writer
        self._intervals: dict[str, int] = {}
        self._expected = intervals or {}
        self._origins: dict[str, int] = {}
        self._ends: dict[str, int] = {}
        self._snapshots = SnapshotAssembler()
        self._waiting: list = []

    def feed(self, data: bytes) -> None:
        over = bool(self.ended)
        frames = self.decoder.feed(data)
        for record in frames.identity:
            self._meet(Identity.of(record))
        if over:
            self.ignored_frames += len(frames)
            return
        self._waiting.append(frames)
        if self.identity is None:
            return
        for waiting in self._waiting:
            self._means("baseband", waiting.baseband)
            self._means("output", waiting.output)
            self._snapshots.feed(waiting.snapshot)
            self._raw(waiting.raw)
        self._waiting.clear()

    def _meet(self, identity: Identity) -> None:
        if self.identity is None:
            self.identity = identity
            self._conversions = conversions(identity)
        elif identity.calibration_crc != self.identity.calibration_crc or identity.unique_id != self.identity.unique_id:
            self.ended = self.ended or "the device or its calibration was exchanged"
        if self.decoder.statistics.restarts:
            self.ended = self.ended or "the device was started anew"

    def _means(self, tap: str, records: np.ndarray) -> None:
        interval = self._intervals.get(tap) or self._first_interval(tap, records["interval_samples"])
        if interval == 0:
            self.ignored_frames += len(records)
            return
        first = records["sample_counter"].astype(np.int64) - interval // 2
        offered = len(records)
        usable = (records["interval_samples"] == interval) & (first >= 0)
        records, first = records[usable], first[usable]
        kept = self._in_place(tap, first, interval)
        records, first = records[kept], first[kept]
        self.ignored_frames += offered - len(records)
        breaks = np.flatnonzero(np.diff(first) != interval) + 1
        columns = {name: _column(records, conversion) for name, conversion in self._conversions[tap].items()}
        for begin, end in zip([0, *breaks], [*breaks, len(records)], strict=True):
            if end > begin:
                self._writer.append(tap, {name: column[begin:end] for name, column in columns.items()}, int(first[begin]))
        if len(records):
            self._note_span(tap, int(first[0]), int(first[-1]) + interval)

    def _first_interval(self, tap: str, found: np.ndarray) -> int:
        """Declares the tap as soon as there is a frame of its interval; 0: not yet. found: samples per frame, (n,)"""
        if len(found) == 0:
            return 0
        values, counts = np.unique(found, return_counts=True)
        interval = self._expected.get(tap, int(values[np.argmax(counts)]))
        return self._declare(tap, interval) if interval > 0 and interval in values else 0

    def _in_place(self, tap: str, first: np.ndarray, interval: int) -> np.ndarray:
        """Which intervals stand on the tap's grid, behind all others and not absurdly far ahead; (n,) bool. A counter that goes back is
        that of a device that was started anew."""
        if len(first) == 0:
            return np.empty(0, bool)
        origin = self._origins.setdefault(tap, int(first[0]))
        before = np.maximum.accumulate(np.concatenate(([self._ends.get(tap, origin)], first[:-1] + interval)))
        back = np.flatnonzero(first < before)
        if len(back):
            self.ended = self.ended or "the device was started anew"
            before[back[0]:] = np.iinfo(np.int64).max
        return ((first - origin) % interval == 0) & (first >= before) & (first - before <= MAX_GAP_SAMPLES * interval)

    def _note_span(self, tap: str, begin: int, end: int) -> None:
        self._ends[tap] = end
        self.begin_sample = min(begin, self.begin_sample) if self.end_sample else begin
        self.end_sample = max(self.end_sample, end)

    def _declare(self, tap: str, interval_samples: int) -> int:
        assert self.identity is not None
        form = {name: ChannelFormat(_DTYPES.get(conversion.field, "i4"), conversion.scale, conversion.offset)
                for name, conversion in self._conversions[tap].items()}
        self._writer.add_tap(tap, TapFormat(self.identity.sample_rate_hz / interval_samples, form))
        self._intervals[tap] = interval_samples
        return interval_samples

    def _raw(self, chunks: list[Chunk]) -> None:
        for chunk in chunks:
            samples = raw_samples(chunk)
            if samples is None or len(samples.codes) == 0 or not self._ends.get("raw", 0) <= samples.first_sample < 2**62:
                self.ignored_frames += 1
                continue
            if "raw" not in self._intervals:
                self._declare("raw", 1)
            self._append_raw(samples)

    def _append_raw(self, samples: RawSamples) -> None:
        names = ("primary_adc_raw", "secondary_adc_raw", "drive_dac_raw", "rebalance_dac_raw")
        columns = {name: samples.codes[:, i] for i, name in enumerate(names)}
        columns["thermometer_raw"] = np.full(len(samples.codes), samples.thermometer_raw, np.int32)
        snapshot = (self._snapshots.take(samples.first_sample) or b"") if samples.first else None
        self._writer.append("raw", columns, samples.first_sample, state_snapshot=snapshot)
        self._note_span("raw", samples.first_sample, samples.first_sample + len(samples.codes))
        if samples.cut:
            self._writer.event("raw_burst_cut", "the link was too slow", sample=samples.first_sample + len(samples.codes))


def _column(records: np.ndarray, conversion: Conversion) -> np.ndarray:
    if conversion.field == "angle":
        return records["angle"].view(np.int64)  # modulo 2^64, so as well signed
    return worst_status(records) if conversion.field == "status" else records[conversion.field]


def telemetry_to_recording(data: bytes, writer: RecordingWriter, progress: Callable[[int], None] | None = None) -> TelemetryRecorder:
    """Whole telemetry at once. progress(bytes done) is called now and then; the recorder's statistics come back."""
    recorder = TelemetryRecorder(writer)
    step = 1 << 22
    for at in range(0, len(data), step):
        recorder.feed(data[at:at + step])
        if progress is not None:
            progress(min(at + step, len(data)))
    return recorder
