"""One complete device, here (HostDevice, the library's own) or behind a stream of bytes (StreamDevice, on any machine). Same calls."""

from __future__ import annotations

import struct
import subprocess
import tempfile
from dataclasses import dataclass
from enum import IntEnum
from types import TracebackType
from typing import Protocol

import numpy as np

from wineglass.errors import WineglassError
from wineglass.emulation.machines import Machine
from wineglass.native import ffi, library, pointer

THERMOMETER_SILENT = -(2**31)
LOOP_DELAY_Q16 = 3 << 15  # as the host port: one sample of latency, half a sample of hold
PROGRAM_UNIT_BYTES = 4
MAX_PAIRS = 32_000  # per request; hal/stream/server.h has the limit in bytes
_PATIENCE_S = 5


@dataclass(frozen=True)
class Board:
    """What a device is told about the electronics around it."""

    sample_rate_millihz: int = 50_000_000
    adc_bits: int = 16
    dac_bits: int = 16
    serial: int = 1
    loop_delay_q16: int = LOOP_DELAY_Q16
    """samples, used with the compiled-in calibration only"""


class Device(Protocol):
    def run(self, adc: np.ndarray, thermometer: int = THERMOMETER_SILENT) -> np.ndarray:
        """adc: (n, 2) int32, primary and secondary code. Returns the DAC codes, (n, 2) int32, drive and rebalance."""

    def command(self, message: bytes) -> None: ...

    def telemetry(self) -> bytes: ...

    def snapshot(self) -> bytes: ...

    def close(self) -> None: ...


class HostDevice:
    """The device in the library that the twin and the tools use."""

    def __init__(self, board: Board, block: bytes = b""):
        cfg = ffi.new("struct wg_device_cfg *", [board.sample_rate_millihz, board.adc_bits, board.dac_bits, 0, board.serial,
                                                board.loop_delay_q16])
        self._device = library().wg_device_create(cfg, ffi.from_buffer(block) if block else ffi.NULL, len(block))
        if self._device == ffi.NULL:
            raise WineglassError("the host's device refused its configuration or calibration block")

    def run(self, adc: np.ndarray, thermometer: int = THERMOMETER_SILENT) -> np.ndarray:
        adc = np.ascontiguousarray(adc, np.int32)
        dac = np.empty_like(adc)
        library().wg_device_set_thermometer(self._device, thermometer)
        library().wg_device_run(self._device, len(adc), pointer(adc, "int32_t"), pointer(dac, "int32_t"))
        return dac

    def command(self, message: bytes) -> None:
        library().wg_device_command_write(self._device, message, len(message))

    def telemetry(self) -> bytes:
        count = int(library().wg_device_telemetry_pending(self._device))
        buffer = ffi.new("uint8_t[]", max(count, 1))
        library().wg_device_telemetry_read(self._device, buffer, count)
        return bytes(ffi.buffer(buffer, count))

    def snapshot(self) -> bytes:
        size = int(library().wg_device_snapshot_size())
        buffer = ffi.new("uint8_t[]", size)
        library().wg_device_snapshot(self._device, buffer, size)
        return bytes(ffi.buffer(buffer))

    def close(self) -> None:
        if self._device != ffi.NULL:
            library().wg_device_destroy(self._device)
            self._device = ffi.NULL


class Request(IntEnum):
    """hal/stream/server.h."""

    START = 1
    RUN = 2
    COMMAND = 3
    POLL = 4
    DRAIN = 5
    SNAPSHOT = 6


class StreamDevice:
    """A device on another machine: its emulator is a child process, its standard input and output are the stream."""

    def __init__(self, machine: Machine, board: Board, block: bytes = b"", emulator_options: tuple[str, ...] = ()):
        self._name = machine.preset
        self._errors = tempfile.TemporaryFile()
        self._process = subprocess.Popen(machine.command(options=emulator_options), stdin=subprocess.PIPE,
                                         stdout=subprocess.PIPE, stderr=self._errors)
        status = self._status(Request.START, struct.pack("<QIIIIII", board.serial, board.sample_rate_millihz, board.adc_bits,
                                                         board.dac_bits, board.loop_delay_q16, PROGRAM_UNIT_BYTES, 0) + block)
        if status != 0:
            self.close()
            raise WineglassError(f"{self._name}: the device refused its configuration or calibration block ({status})")

    def run(self, adc: np.ndarray, thermometer: int = THERMOMETER_SILENT) -> np.ndarray:
        parts = [self._run(adc[first : first + MAX_PAIRS], thermometer) for first in range(0, len(adc), MAX_PAIRS)]
        return np.concatenate(parts) if parts else np.empty((0, 2), np.int32)

    def command(self, message: bytes) -> None:
        if self._status(Request.COMMAND, message) != 0:
            raise WineglassError(f"{self._name}: no room for the command")

    def telemetry(self) -> bytes:
        parts = []
        while part := self._ask(Request.DRAIN):
            parts.append(part)
        return b"".join(parts)

    def snapshot(self) -> bytes:
        return self._ask(Request.SNAPSHOT)

    def close(self) -> None:
        """Ends the emulation: the end of its input is its end."""
        process = self._process
        if process.stdin and not process.stdin.closed:
            process.stdin.close()
        try:
            process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdout:
            process.stdout.close()
        self._errors.close()

    def __enter__(self) -> StreamDevice:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _run(self, adc: np.ndarray, thermometer: int) -> np.ndarray:
        answer = self._ask(Request.RUN, struct.pack("<i", thermometer) + adc.astype("<i4").tobytes())
        return np.frombuffer(answer, "<i4").astype(np.int32).reshape(-1, 2)

    def _status(self, kind: Request, payload: bytes = b"") -> int:
        return struct.unpack("<i", self._ask(kind, payload))[0]

    def _ask(self, kind: Request, payload: bytes = b"") -> bytes:
        assert self._process.stdin and self._process.stdout
        try:
            self._process.stdin.write(struct.pack("<II", kind, len(payload)) + payload)
            self._process.stdin.flush()
        except BrokenPipeError:
            raise self._ended() from None
        return self._take(struct.unpack("<I", self._take(4))[0])

    def _take(self, count: int) -> bytes:
        assert self._process.stdout
        answer = self._process.stdout.read(count)
        if len(answer) != count:
            raise self._ended()
        return answer

    def _ended(self) -> WineglassError:
        status = self._process.wait(_PATIENCE_S)
        self._errors.seek(0)
        said = self._errors.read().decode(errors="replace").strip()
        return WineglassError(f"{self._name}: the emulation ended with status {status} {said[-400:]}")
