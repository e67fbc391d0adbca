"""Telemetry of a device into a recording while it comes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from wineglass.bench_script import Script
from wineglass.calibration_block import from_binary, to_json
from wineglass.device import Device
from wineglass.errors import BadInput
from wineglass.interrupt import interrupt_noted
from wineglass.link.ports import FilePort, Port, PortClosed
from wineglass.link.player import Player
from wineglass.link.session import Refused, Session
from wineglass.recording import Recording, RecordingMeta, RecordingWriter
from wineglass.telemetry import Decoder, Identity
from wineglass.telemetry_recording import TelemetryRecorder

_READ_S = 0.1


@dataclass(frozen=True)
class LiveOptions:
    """seconds: of device time, None until Ctrl-C. Rates in Hz, 0 = off, None = as the device has them. burst_samples: asked for at the start"""

    seconds: float | None = None
    baseband_hz: float | None = None
    output_hz: float | None = None
    burst_samples: int = 0
    device_toml: str = ""
    script: Script | None = None
    """played by the device's clock from the first sample on; needs `device`, and its frame rates and length count"""
    device: Device | None = None


@dataclass(frozen=True)
class Recorded:
    """What a recording run did. taps: name -> samples, lost among them"""

    path: str
    device_name: str
    unique_id: int
    duration_s: float
    taps: dict[str, dict[str, int]]
    frames: int
    lost_frames: int
    damaged_packets: int
    ignored_frames: int
    ended: str
    warnings: list[str] = field(default_factory=list)


def record(port: Port, path: Path, options: LiveOptions, progress: Callable[[float, Decoder], None] | None = None) -> Recorded:
    """Until the time is over, the port closes, the device starts anew, or Ctrl-C: in every case the file is a valid recording.

    progress(seconds recorded, decoder) is called with every piece."""
    prelude: list[bytes] = []
    identity, block, intervals = _listen(port, prelude) if isinstance(port, FilePort) else _introduce(port, options, prelude)
    with RecordingWriter(path, _meta(port, identity, block, options)) as writer, interrupt_noted() as interrupted:
        player = Player(options.script, options.device, port, writer, identity) if options.script and options.device else None
        recorder = TelemetryRecorder(writer, player, intervals=intervals)
        recorder.feed(b"".join(prelude))
        ended = _run(port, recorder, player, options, interrupted, progress)
        if recorder.end_sample == 0:
            raise BadInput("the device sent no measurements", port.name, "set its frame rates: --baseband-hz 100 --output-hz 100")
        writer.event("recording_ended", ended, sample=recorder.end_sample)
    return _summary(path, identity, recorder, ended, player)


def divisor(identity: Identity, rate_hz: float, what: str) -> int:
    """Slow ticks per frame."""
    slow_hz = identity.sample_rate_hz / identity.slow_period_samples
    if rate_hz == 0:
        return 0
    ticks = slow_hz / rate_hz
    if abs(ticks - round(ticks)) > 1e-6 * ticks or not 1 <= round(ticks) <= 65535:
        raise BadInput(f"{rate_hz:g} Hz is impossible", what, f"choose a whole fraction of the device's {slow_hz:g} Hz")
    return round(ticks)


def set_frame_rates(session: Session, identity: Identity, baseband_hz: float | None, output_hz: float | None) -> None:
    """None leaves a rate as it is."""
    if baseband_hz is None and output_hz is None:
        return
    status = session.status()
    present = (int(status["baseband_divisor"]), int(status["output_divisor"]))
    baseband = present[0] if baseband_hz is None else divisor(identity, baseband_hz, "--baseband-hz")
    output = present[1] if output_hz is None else divisor(identity, output_hz, "--output-hz")
    session.command("frame rates", session.encoder.divisors, baseband, output)


def _introduce(port: Port, options: LiveOptions, prelude: list[bytes]) -> tuple[Identity, bytes, dict[str, int]]:
    """Who is there, with what calibration, and the samples per frame of each tap; what was sent meanwhile is kept."""
    session = Session(port, prelude.append)
    identity = session.identity()
    try:
        block = session.calibration()
    except Refused:
        block = b""
    set_frame_rates(session, identity, options.baseband_hz, options.output_hz)
    status = session.status()
    intervals = {tap: int(status[f"{tap}_divisor"]) * identity.slow_period_samples for tap in ("baseband", "output")}
    if options.burst_samples:
        session.command("raw burst", session.encoder.raw_burst, options.burst_samples)
    return identity, block, intervals


def _listen(port: Port, prelude: list[bytes]) -> tuple[Identity, bytes, dict[str, int]]:
    """The first identity in a file, and the calibration if it comes before that."""
    decoder = Decoder()
    block = b""
    while True:
        try:
            prelude.append(port.read(_READ_S))
        except PortClosed:
            raise BadInput("no identity frame in it", port.name, "give telemetry of a device from its start, or with a ping in it") from None
        frames = decoder.feed(prelude[-1])
        block = frames.calibration[-1].data if frames.calibration else block
        if len(frames.identity):
            return Identity.of(frames.identity[0]), block, {}


def _meta(port: Port, identity: Identity, block: bytes, options: LiveOptions) -> RecordingMeta:
    return RecordingMeta(
        counter_rate_hz=identity.sample_rate_hz, device_toml=options.device_toml, calibration_block=block,
        calibration_json=to_json(from_binary(block, port.name)) if block else "", firmware_version=identity.firmware_version,
        calibration_crc=identity.calibration_crc if block else None,
        source=f"recorded from {port.name}: device {identity.device_name or '(unnamed)'}, unique id {identity.unique_id:016x}",
    )


def _run(port: Port, recorder: TelemetryRecorder, player: Player | None, options: LiveOptions, interrupted: Callable[[], bool],
         progress: Callable[[float, Decoder], None] | None) -> str:
    """Why it ended."""
    rate_hz = recorder.identity.sample_rate_hz if recorder.identity else 1.0
    while True:
        seconds = (recorder.end_sample - recorder.begin_sample) / rate_hz
        if progress is not None:
            progress(seconds, recorder.decoder)
        if player is not None and recorder.end_sample > 0:
            player.play(recorder.begin_sample, recorder.end_sample)
        if recorder.ended:
            return recorder.ended
        if options.seconds is not None and seconds >= options.seconds:
            return "time is over"
        if interrupted():
            return "interrupted"
        try:
            recorder.feed(port.read(_READ_S))
        except PortClosed:
            return "end of the file" if isinstance(port, FilePort) else "the connection was closed"


def _summary(path: Path, identity: Identity, recorder: TelemetryRecorder, ended: str, player: Player | None) -> Recorded:
    recording = Recording.open(path)
    taps = {name: {"samples": recording.tap(name).length, "lost": int(recording.tap(name).lost.sum())} for name in recording.taps}
    if recording.bursts:
        taps["raw"] = {"samples": sum(burst.length for burst in recording.bursts), "lost": 0}
    duration = max((recording.tap(name).length / recording.tap(name).sample_rate_hz for name in recording.taps), default=0.0)
    statistics = recorder.decoder.statistics
    damaged = statistics.bad_packets + statistics.bad_crc
    warnings = [] if player is None else player.complaints()
    if damaged or statistics.lost_frames:
        warnings.append(f"{damaged} packets were damaged and {statistics.lost_frames} frames are missing: masked as lost")
    if recorder.ended:
        warnings.append(f"{recorder.ended}: the recording ends there")
    return Recorded(str(path), identity.device_name, identity.unique_id, duration, taps, statistics.frames, statistics.lost_frames, damaged,
                    recorder.ignored_frames, ended, warnings)
