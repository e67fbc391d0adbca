"""The bench day: commands in time, telemetry into a recording by the product's one decoder, and the bench's own instruments beside it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from wineglass.blind.generator.plant import Plant
from wineglass.blind.generator.world import World
from wineglass.calibration_block import from_binary, to_json
from wineglass.commands_wire import CommandEncoder
from wineglass.device import Device
from wineglass.recording import RecordingMeta, RecordingWriter, TapFormat, float_format
from wineglass.recording.memory import MemoryRecording
from wineglass.scenario import Burst, Plant as NoPlant
from wineglass.schedule import Command, SyncPulse
from wineglass.telemetry import Decoder, Identity
from wineglass.telemetry_recording import TelemetryRecorder
from wineglass.wire import FrameType

CHUNK_BLOCKS = 5000
REFERENCE_CHANNELS = ("true_rate", "chamber_temperature", "shell_temperature")


def record(world: World, plant: Plant, path: Path, calibration: bytes, described: Device, lost_fraction: float = 0.0,
           progress: Callable[[int], None] | None = None) -> float:
    """Runs the whole day and writes the recording. described: what the recording says of the device. Returns the seconds it took."""
    begin = time.monotonic()
    first = _powered_up(world, plant)
    with RecordingWriter(path, _meta(world, calibration, described, first)) as writer:
        _write_events(world, writer)
        _fill(writer, world, plant, first, lost_fraction, progress or (lambda done: None))
    return time.monotonic() - begin


def remember(world: World, plant: Plant) -> MemoryRecording:
    """The same day without a file: slow taps only, nothing lost."""
    first = _powered_up(world, plant)
    memory = MemoryRecording(world.described.electronics.sample_rate_hz)
    _fill(memory, world, plant, first, 0.0, lambda done: None)
    return memory


def _powered_up(world: World, plant: Plant) -> bytes:
    """What the device says first, once it is told how often to report."""
    scenario = world.scenario.recording
    plant.command(CommandEncoder().divisors(_divisor(world, scenario.baseband_hz), _divisor(world, scenario.output_hz)))
    plant.poll()
    return plant.telemetry()


def _fill(writer: RecordingWriter | MemoryRecording, world: World, plant: Plant, first: bytes, lost_fraction: float, progress: Callable[[int], None]) -> None:
    line, recorder = _Line(world, lost_fraction), TelemetryRecorder(_Patched(writer, world) if world.output_patches else writer)
    recorder.feed(first)
    for done in _stretches(world, plant):
        recorder.feed(line.carry(plant.telemetry()))
        progress(done)
    _write_reference(world, writer)


def _divisor(world: World, rate_hz: float) -> int:
    return round(world.described.slow_rate_hz / rate_hz) if rate_hz > 0 else 0


def _meta(world: World, calibration: bytes, described: Device, first: bytes) -> RecordingMeta:
    identity = Identity.of(Decoder().feed(first).identity[0])
    return RecordingMeta(
        counter_rate_hz=described.electronics.sample_rate_hz, device_toml=described.to_toml(),
        calibration_json=to_json(from_binary(calibration)), calibration_block=calibration, firmware_version=identity.firmware_version,
        source=f"bench: {world.scenario.name or 'unnamed'}, device {described.name}")


def _write_events(world: World, writer: RecordingWriter) -> None:
    """As a bench notes them: what was asked for, never what was wrong."""
    scenario, rate_hz = world.scenario, world.described.electronics.sample_rate_hz
    open_text = scenario.model_copy(update={"plant": NoPlant(), "seed": 0}).model_dump_json(exclude_none=True)
    writer.event("scenario", open_text, sample=0)
    segments = [(segment.begin_s, "segment", segment.name) for segment in scenario.segment if segment.begin_s < scenario.duration_s]
    if not segments:
        segments = [(at_s, "segment", what) for what, profile in (("temperature", scenario.temperature), ("rate", scenario.rate))
                    for at_s in profile.boundaries_s if 0 < at_s < scenario.duration_s]
    commands = [(command.at_s, "command", command.note()) for command in scenario.command]
    for time_s, kind, what in sorted([*segments, *commands], key=lambda event: event[0]):
        writer.event(kind, what, sample=round(time_s * rate_hz))


def _stretches(world: World, plant: Plant) -> Iterator[int]:
    """The whole day in pieces, each burst and command at its time, commands first; yields the blocks done since the last time."""
    scenario, encoder = world.scenario, CommandEncoder(first_sequence=1)
    for item in sorted([*scenario.command, *scenario.recording.bursts], key=_time_of):
        yield from _until(plant, round(_time_of(item) * world.described.slow_rate_hz))
        _ask(item, world, plant, encoder)
    yield from _until(plant, world.n_blocks)


def _until(plant: Plant, block: int) -> Iterator[int]:
    while (left := min(block, plant.world.n_blocks) - plant.blocks_done) > 0:
        count = min(left, CHUNK_BLOCKS)
        plant.run(count)
        yield count


def _time_of(item: Burst | Command) -> float:
    return item.time_s if isinstance(item, Burst) else item.at_s


def _ask(item: Burst | Command, world: World, plant: Plant, encoder: CommandEncoder) -> None:
    if isinstance(item, SyncPulse):
        plant.sync(item.since_sample)
    elif isinstance(item, Burst):
        plant.command(encoder.raw_burst(item.samples))
    else:
        plant.command(item.encode(encoder, world.described))
    plant.poll()


def _write_reference(world: World, writer: RecordingWriter | MemoryRecording) -> None:
    """Means over each interval, at its middle, as the bench's instruments have them."""
    divisor, bench = _divisor(world, world.scenario.recording.reference_hz), world.bench
    if divisor == 0 or world.n_blocks < divisor:
        return
    slow_hz = world.described.slow_rate_hz
    writer.add_tap("reference", TapFormat(slow_hz / divisor, {name: float_format() for name in REFERENCE_CHANNELS}))
    rate = np.interp(world.time_s - bench.delay_s, world.time_s, world.table_rate_rad_s) * bench.rate_gain + bench.rate_offset_rad_s
    noise, columns = world.noise("bench"), {}
    for name, values, size in zip(REFERENCE_CHANNELS, (rate, world.chamber_degc, world.base_degc),
                                  (bench.rate_noise_rad_s, *(bench.temperature_noise_degc,) * 2), strict=True):
        means = _means(values, divisor)
        columns[name] = means + size * noise.standard_normal(len(means))
    writer.append("reference", columns, divisor * world.described.block_samples // 2)


def _means(edges: np.ndarray, divisor: int) -> np.ndarray:
    """Means of values at block edges (n + 1,) over `divisor` blocks each."""
    middles = 0.5 * (edges[1:] + edges[:-1])
    count = len(middles) // divisor
    return middles[:count * divisor].reshape(count, divisor).mean(axis=1)


class _Line:
    """The wire to the recorder; loses a share of the frames of means, whole."""

    def __init__(self, world: World, lost_fraction: float):
        self._random, self._lost = world.noise("line"), lost_fraction
        self._rest = b""

    def carry(self, data: bytes) -> bytes:
        if self._lost == 0.0:
            return data
        *packets, self._rest = (self._rest + data).split(b"\0")
        kept = [packet for packet in packets if not (_is_mean(packet) and self._random.random() < self._lost)]
        return b"".join(packet + b"\0" for packet in kept)


def _is_mean(packet: bytes) -> bool:
    """Frame type of a packet whose first two bytes are not zero: a COBS code, then the version, then the type."""
    return len(packet) > 2 and packet[0] > 2 and packet[2] in (FrameType.BASEBAND, FrameType.OUTPUT)


class _Patched:
    """A writer that passes everything on, the output tap changed."""

    def __init__(self, writer: RecordingWriter | MemoryRecording, world: World):
        self._writer, self._world = writer, world

    def append(self, tap: str, data: dict[str, np.ndarray], first_sample: int, **more: Any) -> None:
        for patch in self._world.output_patches:
            data = patch(tap, data, first_sample)
        self._writer.append(tap, data, first_sample, **more)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._writer, name)
