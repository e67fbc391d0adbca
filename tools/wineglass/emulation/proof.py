"""The proof that the target runs what was simulated: images booted in emulation, recorded over a socket, held against the host.

    lock_step   the firmware on an emulated processor, driven by the codes of a run of the twin: everything it does must be what the device in the
                twin did, and since that includes every force, the twin's loop is closed around the emulated processor as well
    board       the file that is flashed, booted as it is; without converters it runs on silence, and so does the host beside it
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from wineglass.commands_wire import CommandEncoder
from wineglass.emulation import codes
from wineglass.emulation.boot import Boot
from wineglass.emulation.compare import compare as compare_devices
from wineglass.emulation.device import Board, Device, HostDevice, StreamDevice
from wineglass.emulation.fields import differing, fields
from wineglass.emulation.machines import Machine
from wineglass.emulation.wire import Heard, play, play_to
from wineglass.link.live import LiveOptions, record
from wineglass.link.ports import open_port
from wineglass.link.serve import listen_unix
from wineglass.recording import Recording
from wineglass.recording.difference import compare as compare_recordings

SCENARIO = "cold-start"
BURST_SAMPLES = 500
BOARD_WHAT = "the STM32F405's image, on a board without converters"
BOARD_RATE_HZ, BOARD_BITS = 50e3, 24
BOARD_SAMPLES = 4000
"""one a millisecond"""
OWN_OF_THE_BOARD = "thermometer"
"""module whose constants stand in the board's compiled-in calibration and not in the host's"""

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Proof:
    """What was compared. difference: empty when everything is equal, else the first sample and the module that differ."""

    what: str
    recording: str
    host_recording: str
    difference: str = ""
    compared: dict[str, int] = field(default_factory=dict)
    """of what -> how many"""


# ---- the processor, in lock step ---------------------------------------------------------------------------------------------


def lock_step(machine: Machine, seconds: float, folder: Path, progress: Progress = lambda done: None) -> Proof:
    """A cold start with a raw burst near its end; progress(fraction done)."""
    recorded = _codes(seconds)
    rate_hz = recorded.board.sample_rate_millihz / 1000.0
    emulated, hosted = folder / f"{machine.preset}.h5", folder / f"{machine.preset}-host.h5"

    def device() -> Device:
        return StreamDevice(machine, recorded.board, recorded.block)

    def host() -> Device:
        return HostDevice(recorded.board, recorded.block)

    heard = _over_a_socket(device, recorded, rate_hz, emulated, progress)
    expected = _play_here(host, heard, rate_hz)
    _record_bytes(expected.telemetry, hosted)
    compared = {"DAC codes": heard.dac.size, "telemetry bytes": len(heard.telemetry)}
    difference, samples = _recordings_differ(emulated, hosted)
    if heard.telemetry != expected.telemetry or not (np.array_equal(heard.dac, expected.dac) and np.array_equal(heard.dac, recorded.dac)):
        found, _ = compare_devices(host, device, heard.stretches)
        difference = str(found) if found else "what the device did once it does not do again"
    return Proof(f"{machine.what}, {seconds:g} s of {SCENARIO} in lock step with the twin", str(emulated), str(hosted), difference, compared | samples)


def _codes(seconds: float) -> codes.Codes:
    """With every frame, the rebalance loop closed for the last quarter, and a burst in it."""
    send, blocks = CommandEncoder(), round(1000 * seconds)
    commands = {0: send.divisors(1, 1), 3 * blocks // 4: send.loop("rebalance"), blocks - blocks // 8: send.raw_burst(BURST_SAMPLES)}
    return codes.record(SCENARIO, blocks, commands, rebalance=True)


def _over_a_socket(make: Callable[[], Device], recorded: codes.Codes, rate_hz: float, path: Path, progress: Progress) -> Heard:
    """The emulated device serves its wire in a thread, the recorder records from it as from any device."""
    done: dict[str, Any] = {}
    samples, gone = 0, threading.Event()

    def note(count: int) -> None:
        nonlocal samples
        samples += count
        progress(samples / len(recorded.dac))

    def serve(listener: Any) -> None:
        try:
            device = make()
            try:
                done["heard"] = play_to(listener, device, recorded.stretches, rate_hz, note, gone.is_set)
            finally:
                device.close()
        except Exception as error:
            done["error"] = error
            listener.close()

    socket_path = path.with_suffix(".sock")
    with listen_unix(socket_path) as listener:
        thread = threading.Thread(target=serve, args=(listener,), daemon=True)
        thread.start()
        try:
            with open_port(str(socket_path)) as port:
                record(port, path, LiveOptions())
        finally:
            gone.set()
            thread.join()
            if "error" in done:
                raise done["error"]
    return done["heard"]


def _play_here(make: Callable[[], Device], heard: Heard, rate_hz: float) -> Heard:
    device = make()
    try:
        return play(device, heard.stretches, rate_hz)
    finally:
        device.close()


def _record_bytes(telemetry: bytes, path: Path) -> None:
    """The same recorder over bytes that are already there."""
    source = path.with_suffix(".telemetry")
    source.write_bytes(telemetry)
    with open_port(str(source)) as port:
        record(port, path, LiveOptions())
    source.unlink()


def _recordings_differ(one: Path, other: Path, common: bool = False) -> tuple[str, dict[str, int]]:
    with Recording.open(one) as first, Recording.open(other) as second:
        comparison = compare_recordings(first, second, common)
    difference = f"{comparison.difference} (the recordings)" if comparison.difference else ""
    return difference, {f"samples of {name}": count for name, count in comparison.samples.items()}


# ---- the board's image -------------------------------------------------------------------------------------------------------


def board(program: Path, folder: Path, progress: Progress = lambda done: None) -> Proof:
    """The image, from its reset on; a fault, a lost frame or a different number is a difference."""
    recording, hosted = folder / "stm32f405.h5", folder / "stm32f405-host.h5"
    seconds = BOARD_SAMPLES / BOARD_RATE_HZ
    with Boot(program) as emulated, emulated.port() as port:
        done = record(port, recording, LiveOptions(seconds, 1000.0, 1000.0, BURST_SAMPLES), lambda now, _: progress(now / seconds))
    burst = _burst(recording)
    if burst is None:
        return Proof(BOARD_WHAT, str(recording), "", "no raw burst came")
    describing = Board(round(1000 * BOARD_RATE_HZ), BOARD_BITS, BOARD_BITS, serial=0, loop_delay_q16=_number(burst.snapshot, "loop_delay_samples_q16"))
    difference, compared = _burst_differs(burst, HostDevice(describing))
    _record_bytes(_silence(HostDevice(describing), _end_sample(recording)), hosted)
    differs, samples = _recordings_differ(recording, hosted, common=True)
    lost = f"{done.lost_frames} frames lost, {done.damaged_packets} packets damaged" if done.lost_frames or done.damaged_packets else ""
    return Proof(BOARD_WHAT, str(recording), str(hosted), difference or differs or lost, compared | samples)


@dataclass(frozen=True)
class _Burst:
    """snapshot: the whole state before first_sample; dac: (n, 2) codes from there on"""

    first_sample: int
    snapshot: bytes
    dac: np.ndarray


def _burst(recording: Path) -> _Burst | None:
    with Recording.open(recording) as opened:
        if not opened.bursts:
            return None
        burst = opened.bursts[0]
        return _Burst(burst.first_sample, burst.state_snapshot, np.stack([burst.codes("drive_dac_raw"), burst.codes("rebalance_dac_raw")], axis=1))


def _end_sample(recording: Path) -> int:
    """On the common counter: the host goes a little further."""
    with Recording.open(recording) as opened:
        return max(tap.first_sample + round(tap.length / tap.sample_rate_hz * tap.counter_rate_hz) for tap in opened.taps.values()) + 200


def _number(snapshot: bytes, name: str) -> int:
    where = next(item for item in fields() if item.name == name)
    return int.from_bytes(snapshot[where.offset : where.offset + where.size], "little")


def _burst_differs(burst: _Burst, host: HostDevice) -> tuple[str, dict[str, int]]:
    """The host runs to the burst from power-up on its own: the same state there, and the same forces from there on."""
    try:
        host.run(_quiet(burst.first_sample))
        own = host.snapshot()
        dac = host.run(_quiet(len(burst.dac)))
    finally:
        host.close()
    found = [item for item in differing(own, burst.snapshot) if item.module != OWN_OF_THE_BOARD]
    if found:
        return f"sample {burst.first_sample}: {found[0].module} differs ({', '.join(f'{item.part}.{item.name}' for item in found[:8])})", {}
    at = np.flatnonzero(np.any(dac != burst.dac, axis=1))
    return (f"sample {burst.first_sample + int(at[0])}: DAC codes differ" if len(at) else ""), {"bytes of state": len(own), "DAC codes": dac.size}


def _quiet(samples: int) -> np.ndarray:
    return np.zeros((samples, 2), np.int32)


def _silence(device: HostDevice, samples: int) -> bytes:
    """Telemetry of a device without signals, every frame of it."""
    try:
        device.command(CommandEncoder().divisors(1, 1))
        device.run(_quiet(samples))
        return device.telemetry()
    finally:
        device.close()
