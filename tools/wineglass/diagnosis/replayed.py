"""One raw burst through the firmware again: the recorded pickoff codes into a device that was set to the recorded state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wineglass.commands_wire import CommandEncoder
from wineglass.native import ffi, library, pointer
from wineglass.recording.reader import Tap
from wineglass.telemetry import Decoder, Frames, Identity

NO_READING = -(2**31)


class NotReplayable(Exception):
    """Why a burst cannot be replayed, in a few words."""


@dataclass(frozen=True)
class Replayed:
    """dac (n, 2) int32: drive and rebalance codes; ticks: telemetry of every slow tick, whose counter says the samples done before it"""

    first_sample: int
    dac: np.ndarray
    frames: Frames
    identity: Identity


@dataclass(frozen=True)
class Converters:
    """As the recording's scales state them."""

    sample_rate_hz: float
    adc_bits: int
    dac_bits: int

    @staticmethod
    def of(burst: Tap) -> Converters:
        return Converters(burst.sample_rate_hz, _bits(burst, "primary_adc_raw"), _bits(burst, "drive_dac_raw"))


def run(burst: Tap, block: bytes) -> Replayed:
    """The burst through a device with that calibration block in its store (which the state then replaces)."""
    adc = np.stack([_codes(burst, "primary_adc_raw"), _codes(burst, "secondary_adc_raw")], axis=1)
    with Device(Converters.of(burst), block) as device:
        device.count_every_tick()
        device.restore(burst.state_snapshot)
        dac = device.run(adc, _codes(burst, "thermometer_raw"))
        return Replayed(burst.first_sample, dac, *device.heard())


class Device:
    """The firmware behind the host port."""

    def __init__(self, converters: Converters, block: bytes):
        cfg = ffi.new("struct wg_device_cfg *", [round(converters.sample_rate_hz * 1000), converters.adc_bits, converters.dac_bits, 0, 1])
        self._handle = library().wg_device_create(cfg, ffi.from_buffer(block) if block else ffi.NULL, len(block))
        if self._handle == ffi.NULL:
            raise NotReplayable("the firmware refuses the recorded calibration or converters")

    def count_every_tick(self) -> None:
        message = CommandEncoder().divisors(1, 1)
        library().wg_device_command_write(self._handle, message, len(message))
        library().wg_device_poll(self._handle)

    def restore(self, snapshot: bytes) -> None:
        if not snapshot:
            raise NotReplayable("it has no snapshot of the firmware's state")
        if library().wg_device_restore(self._handle, snapshot, len(snapshot)) != 0:
            version, size = (int(value) for value in np.frombuffer(snapshot[:4].ljust(4, b"\0"), "<u2"))
            own = int(library().wg_device_snapshot_size())
            raise NotReplayable(f"its snapshot (version {version}, {size} bytes) is not one of this firmware ({own} bytes)")

    def snapshot(self) -> bytes:
        size = int(library().wg_device_snapshot_size())
        buffer = ffi.new("uint8_t[]", size)
        assert library().wg_device_snapshot(self._handle, buffer, size) == size
        return bytes(ffi.buffer(buffer, size))

    def run(self, adc: np.ndarray, thermometer: np.ndarray) -> np.ndarray:
        """adc (n, 2), thermometer (n,) codes -> dac (n, 2)."""
        adc = np.ascontiguousarray(adc, np.int32)
        dac = np.empty_like(adc)
        edges = [0, *(np.flatnonzero(np.diff(thermometer)) + 1), len(adc)]
        for begin, end in zip(edges, edges[1:]):
            if end > begin:
                self._set_thermometer(int(thermometer[begin]))
                library().wg_device_run(self._handle, end - begin, pointer(adc[begin:end], "int32_t"), pointer(dac[begin:end], "int32_t"))
        return dac

    def heard(self) -> tuple[Frames, Identity]:
        """Telemetry since the start."""
        library().wg_device_poll(self._handle)
        count = int(library().wg_device_telemetry_pending(self._handle))
        buffer = ffi.new("uint8_t[]", max(1, count))
        count = library().wg_device_telemetry_read(self._handle, buffer, count)
        frames = Decoder().feed(bytes(ffi.buffer(buffer, count)))
        return frames, Identity.of(frames.identity[0])

    def _set_thermometer(self, code: int) -> None:
        if code == NO_READING:
            library().wg_device_thermometer_fails(self._handle)
        else:
            library().wg_device_set_thermometer(self._handle, code)

    def __enter__(self) -> Device:
        return self

    def __exit__(self, *_: Any) -> None:
        library().wg_device_destroy(self._handle)


def _codes(burst: Tap, channel: str) -> np.ndarray:
    if channel not in burst:
        raise NotReplayable(f"channel {channel} is missing")
    codes = burst.codes(channel)
    if codes.dtype.kind not in "iu":
        raise NotReplayable(f"channel {channel} does not hold the device's own codes")
    if burst.lost.any():
        raise NotReplayable(f"{np.count_nonzero(burst.lost)} of its samples were lost")
    return codes.astype(np.int64)


def _bits(burst: Tap, channel: str) -> int:
    """A 16-bit code has scale 2^-15."""
    codes = _codes(burst, channel)
    at = int(np.argmax(np.abs(codes)))
    if codes[at] == 0:
        raise NotReplayable(f"channel {channel} is zero throughout")
    bits = 1.0 - np.log2(abs(burst[channel][at] / codes[at]))
    if abs(bits - round(bits)) > 1e-9 or not 8 <= bits <= 32:
        raise NotReplayable(f"the scale of channel {channel} is not that of a converter")
    return round(bits)
