"""A scenario through the twin into a recording: the device's telemetry by the one decoder, and the bench's references beside it.

simulate() writes the file; in_memory() keeps the slow channels alone, for who only looks at them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wineglass.calibration_block import from_binary, to_json
from wineglass.commands_wire import CommandEncoder, Reason
from wineglass.effects import Setting
from wineglass.interrupt import interrupt_noted
from wineglass.recording import RecordingMeta, RecordingWriter, TapFormat, float_format
from wineglass.recording.memory import MemoryRecording
from wineglass.scenario import Burst, Run
from wineglass.schedule import Command, SyncPulse
from wineglass.telemetry import Decoder, Frames, Identity
from wineglass.telemetry_recording import TelemetryRecorder
from wineglass.twin import Block, Twin
from wineglass.wire import Status

REFERENCE_CHANNELS = ("true_rate", "chamber_temperature", "shell_temperature")
_PIECE = 1 << 20  # bytes of telemetry decoded together: many small pieces take much longer


@dataclass(frozen=True)
class Done:
    """What a simulation did. locked_at_end: None when no status was recorded"""

    path: str
    scenario: str
    device: str
    seed: int
    simulated_s: float
    elapsed_s: float
    samples_per_s: float
    locked_at_end: bool | None
    interrupted: bool
    warnings: list[str]


class _Listener(Decoder):
    """The decoder, remembering answers and the latest status."""

    def __init__(self) -> None:
        super().__init__()
        self.refused: list[str] = []
        self.status: int | None = None

    def feed(self, data: bytes) -> Frames:
        frames = super().feed(data)
        self.refused += [Reason(int(ack["reason"])).name.lower() for ack in frames.ack if ack["reason"] != Reason.OK]
        for records in (frames.baseband, frames.output):
            if len(records):
                self.status = int(records["status_and"][-1])
        return frames


def simulate(run: Run, path: Path, progress: Callable[[int], None] | None = None, *, calibration_block: bytes | None = None,
             effects: Sequence[Setting] = ()) -> Done:
    """Run a scenario and write the recording; memory does not grow with its length. progress(blocks done since the last call).
    effects: switched on beside what the scenario says; the recording does not name them.

    Ctrl-C ends the run early and leaves a valid recording of what was done; any other trouble leaves no file.
    """
    begin = time.monotonic()
    listener = _Listener()
    with Twin(run, calibration_block=calibration_block, effects=effects) as twin:
        first = start(twin)
        with RecordingWriter(path, _meta(run, twin, first)) as writer, interrupt_noted() as interrupted:
            recorder, references = _Gathered(TelemetryRecorder(writer, listener)), _References(run, writer)
            recorder.feed(first)
            _note_events(run, writer)
            for block in _stretches(twin):
                recorder.feed(twin.telemetry())
                references.add(block)
                if progress is not None:
                    progress(len(block.shell_degc))
                if interrupted():
                    writer.event("interrupted", "by the user", sample=twin.samples_done)
                    break
            recorder.flush()
        truth = twin.truth()
    elapsed = time.monotonic() - begin
    locked = None if listener.status is None else bool(listener.status & Status.LOCKED)
    return Done(str(path), run.scenario.name, run.device.name, run.scenario.seed, truth.time_s, elapsed, truth.samples / elapsed, locked,
                interrupted(), _warnings(run, listener, locked, truth.adc_saturations))


def in_memory(run: Run, *, calibration_block: bytes | None = None, effects: Sequence[Setting] = ()) -> MemoryRecording:
    """Baseband and output as simulate() would write them, bit for bit, without a file."""
    held = MemoryRecording(run.device.electronics.sample_rate_hz)
    with Twin(run, calibration_block=calibration_block, effects=effects) as twin:
        recorder = _Gathered(TelemetryRecorder(held))
        recorder.feed(start(twin))
        for _ in _stretches(twin):
            recorder.feed(twin.telemetry())
        recorder.flush()
    return held


class _Gathered:
    """Feeds a recorder with large pieces."""

    def __init__(self, recorder: TelemetryRecorder):
        self._recorder = recorder
        self._waiting: list[bytes] = []
        self._bytes = 0

    def feed(self, data: bytes) -> None:
        self._waiting.append(data)
        self._bytes += len(data)
        if self._bytes >= _PIECE:
            self.flush()

    def flush(self) -> None:
        self._recorder.feed(b"".join(self._waiting))
        self._waiting.clear()
        self._bytes = 0


def start(twin: Twin) -> bytes:
    """Frame rates set before the first sample; returns the first telemetry, with the device's identity."""
    recording, encoder = twin.run.scenario.recording, CommandEncoder()
    twin.command(encoder.divisors(twin.run.divisor(recording.baseband_hz), twin.run.divisor(recording.output_hz)))
    twin.poll()
    return twin.telemetry()


def _meta(run: Run, twin: Twin, first: bytes) -> RecordingMeta:
    identity = Identity.of(Decoder().feed(first).identity[0])
    block = twin.calibration_block
    scenario = run.scenario
    return RecordingMeta(
        counter_rate_hz=run.device.electronics.sample_rate_hz,
        device_toml=run.device.to_toml(),
        calibration_json=to_json(from_binary(block)) if block else "",
        calibration_block=block,
        firmware_version=identity.firmware_version,
        calibration_crc=identity.calibration_crc if block else None,
        source=f"simulated: scenario {scenario.name or '(unnamed)'}, device {run.device.name}, seed {scenario.seed}",
    )


def _note_events(run: Run, writer: RecordingWriter) -> None:
    rate_hz = run.device.electronics.sample_rate_hz
    scenario = run.scenario
    segments = [(segment.begin_s, "segment", segment.name) for segment in scenario.segment if segment.begin_s < scenario.duration_s]
    if not segments:
        segments = [(time_s, "segment", what) for what, profile in (("temperature", scenario.temperature), ("rate", scenario.rate))
                    for time_s in profile.boundaries_s if 0 < time_s < scenario.duration_s]
    commands = [(command.at_s, "command", command.note()) for command in scenario.command]
    writer.event("scenario", scenario.model_dump_json(exclude_none=True), sample=0)
    for time_s, kind, what in sorted([*segments, *commands], key=lambda event: event[0]):
        writer.event(kind, what, sample=round(time_s * rate_hz))


def _stretches(twin: Twin) -> Iterator[Block]:
    """The whole run in pieces, asking for each raw burst and each command at its time, commands first."""
    run, encoder = twin.run, CommandEncoder(first_sequence=1)
    scenario = run.scenario
    for item in sorted([*scenario.command, *scenario.recording.bursts], key=_time_of):
        yield from twin.chunks(max(0, round(_time_of(item) * run.device.slow_rate_hz) - twin.blocks_done))
        if isinstance(item, SyncPulse):
            twin.sync(item.since_sample)
        elif isinstance(item, Burst):
            twin.command(encoder.raw_burst(item.samples))
        else:
            twin.command(item.encode(encoder, run.device))
        twin.poll()
    yield from twin.chunks()


def _time_of(item: Burst | Command) -> float:
    return item.time_s if isinstance(item, Burst) else item.at_s


class _References:
    """True rate and temperatures, means over the reference interval, each standing at the middle of its interval."""

    def __init__(self, run: Run, writer: RecordingWriter):
        self._writer = writer
        self._block_samples, self._slow_rate_hz = run.device.block_samples, run.device.slow_rate_hz
        self._rate = run.scenario.rate
        self._divisor = run.divisor(run.scenario.recording.reference_hz)
        self._last = np.array([run.initial_degc, run.initial_degc])  # chamber, shell at the end of the block before
        self._waiting = np.empty((3, 0))
        self._intervals = 0
        if self._divisor:
            form = {name: float_format() for name in REFERENCE_CHANNELS}
            writer.add_tap("reference", TapFormat(run.device.slow_rate_hz / self._divisor, form))

    def add(self, block: Block) -> None:
        if not self._divisor:
            return
        self._waiting = np.concatenate([self._waiting, self._middles(block)], axis=1)
        count = self._waiting.shape[1] // self._divisor
        if count == 0:
            return
        whole, self._waiting = np.split(self._waiting, [count * self._divisor], axis=1)
        means = whole.reshape(3, count, self._divisor).mean(axis=2)
        samples = self._divisor * self._block_samples
        self._writer.append("reference", dict(zip(REFERENCE_CHANNELS, means, strict=True)), self._intervals * samples + samples // 2)
        self._intervals += count

    def _middles(self, block: Block) -> np.ndarray:
        """Rate, chamber and shell around the middle of each block's slow period, (3, n)."""
        middles_s = (block.first_block + np.arange(len(block.shell_degc)) + 0.5) / self._slow_rate_hz
        ends = np.stack([block.chamber_degc, block.shell_degc])
        before = np.concatenate([self._last[:, None], ends[:, :-1]], axis=1)
        self._last = ends[:, -1]
        return np.concatenate([self._rate.at(middles_s)[None], 0.5 * (before + ends)])


def _warnings(run: Run, listener: _Listener, locked: bool | None, adc_saturations: int) -> list[str]:
    warnings = [f"the firmware refused a command: {reason}" for reason in listener.refused]
    if locked is False:
        warnings.append("the drive loop is not locked at the end")
    if adc_saturations:
        warnings.append(f"{adc_saturations} ADC codes were clipped")
    statistics = listener.statistics
    damaged = statistics.bad_packets + statistics.bad_crc + statistics.unknown + statistics.lost_frames
    if damaged:
        warnings.append(f"{damaged} telemetry frames were lost or damaged")
    return warnings
