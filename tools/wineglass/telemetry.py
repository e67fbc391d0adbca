"""The one decoder of telemetry: bytes, in pieces of any size, damaged or not -> typed frames as numpy records.

    decoder = Decoder()
    frames = decoder.feed(data)          # whatever has become complete
    rate = frames.output["rate"]         # integers of the device; conversions() and si() make SI values
    print(decoder.statistics)

All frames of a feed are decoded together, so feed it large pieces where there are any.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wineglass import wire
from wineglass.wire import DTYPES, OPEN_ENDED, FrameType

_BATCH = 1 << 22  # bytes decoded at a time: bounds the memory


@dataclass
class Statistics:
    """What the decoder has seen since it was made."""

    frames: int = 0
    bad_packets: int = 0
    """packets that were no frame: too long, no COBS, too short"""
    bad_crc: int = 0
    unknown: int = 0
    """sound frames of another version, of an unknown type or of a wrong length"""
    lost_frames: int = 0
    """by the gaps in the device's numbering, modulo 65536"""
    restarts: int = 0


@dataclass(frozen=True)
class Gap:
    """`count` frames are missing before the frame number `frame` (counting the sound frames of this decoder)."""

    frame: int
    count: int


@dataclass(frozen=True)
class Chunk:
    """A frame with an open end: its record and the bytes behind it."""

    record: np.void
    data: bytes


@dataclass
class Frames:
    """Frames by type, each in the order of arrival; records of wire.DTYPES."""

    identity: np.ndarray
    status: np.ndarray
    baseband: np.ndarray
    output: np.ndarray
    ack: np.ndarray
    self_test: np.ndarray
    sync: np.ndarray
    phases: np.ndarray
    raw: list[Chunk] = field(default_factory=list)
    snapshot: list[Chunk] = field(default_factory=list)
    calibration: list[Chunk] = field(default_factory=list)

    @staticmethod
    def none() -> Frames:
        return Frames(*(np.empty(0, DTYPES[kind]) for kind in _CLOSED))

    def __len__(self) -> int:
        return sum(len(getattr(self, name)) for name in self.__dataclass_fields__)


_CLOSED = (FrameType.IDENTITY, FrameType.STATUS, FrameType.BASEBAND, FrameType.OUTPUT, FrameType.ACK,
           FrameType.SELF_TEST, FrameType.SYNC, FrameType.PHASES)


class Decoder:
    """Keeps what is incomplete from feed to feed; finds its way again after any damage."""

    def __init__(self) -> None:
        self.statistics = Statistics()
        self.gaps: list[Gap] = []
        self._rest = b""
        self._skipping = False
        self._last_sequence: int | None = None

    def feed(self, data: bytes) -> Frames:
        """Frames that became complete with these bytes."""
        if len(data) <= _BATCH:
            return self._feed(data)
        return merge([self._feed(data[at:at + _BATCH]) for at in range(0, len(data), _BATCH)])

    def _feed(self, data: bytes) -> Frames:
        end = data.rfind(b"\0")
        if end < 0:
            self._keep(self._rest + data)
            return Frames.none()
        packets = self._rest + data[:end + 1]
        if self._skipping:
            packets = packets[packets.index(b"\0") + 1:]
            self._skipping = False
        self._rest = b""
        self._keep(data[end + 1:])
        return self._decode(np.frombuffer(packets, np.uint8)) if packets else Frames.none()

    def _keep(self, rest: bytes) -> None:
        """What may become a frame; endless noise without a delimiter is dropped, not collected."""
        if len(rest) > wire.MAX_ENCODED and not self._skipping:
            self.statistics.bad_packets += 1
            self._skipping = True
        self._rest = b"" if self._skipping else rest

    def _decode(self, packets: np.ndarray) -> Frames:
        ends = np.flatnonzero(packets == 0)
        starts = np.concatenate(([0], ends[:-1] + 1)).astype(np.int64) if len(ends) else ends
        lengths = ends - starts
        present = lengths > 0
        fits = present & (lengths <= wire.MAX_ENCODED)
        plain, begin, size, sound = _unstuff(packets, starts[fits], ends[fits])
        sound &= size >= wire.HEADER.size + wire.CRC_BYTES
        self.statistics.bad_packets += int(np.count_nonzero(present)) - int(np.count_nonzero(sound))
        begin, size = begin[sound], size[sound]
        checked = _check(plain, begin, size)
        self.statistics.bad_crc += int(np.count_nonzero(~checked))
        return self._collect(plain, begin[checked], size[checked] - wire.CRC_BYTES)

    def _collect(self, plain: np.ndarray, begin: np.ndarray, size: np.ndarray) -> Frames:
        frames = Frames.none()
        if len(begin) == 0:
            return frames
        self._count_gaps(_records(plain, begin, _HEADER))
        known = np.zeros(len(begin), bool)
        version, kind = plain[begin], plain[begin + 1]
        for frame_type, dtype in DTYPES.items():
            long_enough = size >= dtype.itemsize if frame_type in OPEN_ENDED else size == dtype.itemsize
            chosen = (version == wire.VERSION) & (kind == frame_type) & long_enough
            known |= chosen
            records = _records(plain, begin[chosen], dtype)
            name = frame_type.name.lower()
            if frame_type in OPEN_ENDED:
                first, last = begin[chosen] + dtype.itemsize, begin[chosen] + size[chosen]
                setattr(frames, name, [Chunk(record, plain[a:b].tobytes()) for record, a, b in zip(records, first, last, strict=True)])
            else:
                setattr(frames, name, records)
        self.statistics.unknown += int(np.count_nonzero(~known))
        return frames

    def _count_gaps(self, headers: np.ndarray) -> None:
        sequence = headers["sequence"].astype(np.int64)
        before = np.concatenate(([sequence[0] - 1 if self._last_sequence is None else self._last_sequence], sequence[:-1]))
        missing = (sequence - before - 1) & 0xFFFF
        restarted = (headers["type"] == FrameType.IDENTITY) & (sequence == 0) & (headers["sample_counter"] == 0) & (missing != 0)
        missing[restarted] = 0
        self.statistics.restarts += int(np.count_nonzero(restarted))
        self.gaps += [Gap(self.statistics.frames + int(i), int(missing[i])) for i in np.flatnonzero(missing)]
        self.statistics.lost_frames += int(missing.sum())
        self.statistics.frames += len(headers)
        self._last_sequence = int(sequence[-1])


_HEADER = np.dtype([("version", "u1"), ("type", "u1"), ("sequence", "<u2"), ("sample_counter", "<u8")])


def _unstuff(packets: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """COBS of all packets at once, one block of every packet per round.

    Returns the decoded bytes of all packets in a row, where each begins in it, its size, and whether it was sound.
    """
    plain = packets.copy()
    dropped = np.ones(len(packets), bool)  # delimiters and packets that do not count
    for_packets = np.zeros(len(packets) + 1, np.int64)
    np.add.at(for_packets, starts, 1)
    np.add.at(for_packets, ends, -1)
    dropped[np.cumsum(for_packets[:-1]) > 0] = False
    dropped[starts] = True
    sound = np.ones(len(starts), bool)
    active, at = np.arange(len(starts)), starts.copy()
    while len(active):
        code = packets[at]
        following = at + code
        sound[active[following > ends[active]]] = False
        going_on = following < ends[active]
        zero, full = going_on & (code < 255), going_on & (code == 255)
        plain[following[zero]] = 0
        dropped[following[full]] = True
        active, at = active[going_on], following[going_on]
    position = np.concatenate(([0], np.cumsum(~dropped)))
    return plain[~dropped], position[starts], position[ends] - position[starts], sound


def _check(plain: np.ndarray, begin: np.ndarray, size: np.ndarray) -> np.ndarray:
    """CRC-32 of every frame; the check over a frame and its own CRC is a constant."""
    view = memoryview(plain)
    crc = zlib.crc32
    residue = 0x2144DF1C
    pairs = zip(begin.tolist(), (begin + size).tolist(), strict=True)
    return np.fromiter((crc(view[a:b]) == residue for a, b in pairs), bool, len(begin))


def _records(plain: np.ndarray, begin: np.ndarray, dtype: np.dtype) -> np.ndarray:
    rows = plain[begin[:, None] + np.arange(dtype.itemsize)]
    return np.ascontiguousarray(rows).view(dtype).reshape(len(begin))


def merge(parts: list[Frames]) -> Frames:
    """Frames of several feeds, one after the other."""
    joined: dict[str, Any] = {}
    for name in Frames.__dataclass_fields__:
        values = [getattr(part, name) for part in parts]
        joined[name] = np.concatenate(values) if isinstance(values[0], np.ndarray) else [chunk for value in values for chunk in value]
    return Frames(**joined)


# ---- raw bursts ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RawSamples:
    """Consecutive raw samples: codes (n, 4) int32 of ADC primary, ADC secondary, DAC drive, DAC rebalance."""

    first_sample: int
    codes: np.ndarray
    thermometer_raw: int
    first: bool
    last: bool
    cut: bool


def raw_samples(chunk: Chunk) -> RawSamples | None:
    """Codes of a raw frame; None when its length contradicts its record."""
    record = chunk.record
    width, count = int(record["code_bytes"]), int(record["count"])
    if width not in (2, 4) or len(chunk.data) != 4 * width * count:
        return None
    codes = np.frombuffer(chunk.data, f"<i{width}").reshape(count, 4).astype(np.int32)
    flags = int(record["flags"])
    return RawSamples(int(record["first_sample"]), codes, int(record["thermometer_raw"]), bool(flags & wire.FLAG_FIRST),
                      bool(flags & wire.FLAG_LAST), bool(flags & wire.FLAG_CUT))


class SnapshotAssembler:
    """Puts the chunks of state snapshots together. `take` hands out the whole snapshot before that sample, once, or None."""

    def __init__(self) -> None:
        self._parts: dict[int, dict[int, bytes]] = {}
        self._totals: dict[int, int] = {}

    def feed(self, chunks: list[Chunk]) -> None:
        for chunk in chunks:
            sample = int(chunk.record["burst_sample"])
            self._totals[sample] = int(chunk.record["total"])
            self._parts.setdefault(sample, {})[int(chunk.record["offset"])] = chunk.data

    def take(self, sample: int) -> bytes | None:
        parts = self._parts.pop(sample, {})
        whole = b""
        for offset in sorted(parts):
            if offset != len(whole):
                return None
            whole += parts[offset]
        return whole if whole and len(whole) == self._totals.pop(sample, 0) else None


# ---- units ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Conversion:
    """value = code scale + offset, in `unit`; `field` is the integer's name in the frame's record."""

    field: str
    unit: str
    scale: float
    offset: float = 0.0


@dataclass(frozen=True)
class Identity:
    """Facts about a device, in SI, from its identity frame."""

    firmware_version: str
    build_id: int
    unique_id: int
    sample_rate_hz: float
    adc_bits: int
    dac_bits: int
    decimation: int
    loops_per_slow: int
    reference_temperature_degc: float
    calibration_serial: int
    calibration_sequence: int
    calibration_crc: int
    calibration_source: int
    calibration_valid: bool
    device_name: str

    @property
    def slow_period_samples(self) -> int:
        return self.decimation * self.loops_per_slow

    @staticmethod
    def of(record: np.void) -> Identity:
        return Identity(
            firmware_version=".".join(str(record[f"firmware_{part}"]) for part in ("major", "minor", "patch")),
            build_id=int(record["build_id"]), unique_id=int(record["unique_id"]),
            sample_rate_hz=int(record["sample_rate_millihz"]) / 1000.0, adc_bits=int(record["adc_bits"]),
            dac_bits=int(record["dac_bits"]), decimation=int(record["decimation"]), loops_per_slow=int(record["loops_per_slow"]),
            reference_temperature_degc=int(record["reference_temperature_mdegc"]) / 1000.0,
            calibration_serial=int(record["calibration_serial"]), calibration_sequence=int(record["calibration_sequence"]),
            calibration_crc=int(record["calibration_crc"]), calibration_source=int(record["calibration_source"]),
            calibration_valid=bool(record["calibration_valid"]), device_name=bytes(record["device_name"]).decode("ascii", "replace"),
        )


def conversions(identity: Identity) -> dict[str, dict[str, Conversion]]:
    """From the device's integers to the recording's channels: tap -> channel -> conversion. The only such table."""
    q30, q31 = 2.0**-30, 2.0**-31
    adc, dac = 2.0 ** (1 - identity.adc_bits), 2.0 ** (1 - identity.dac_bits)
    return {
        "raw": {
            "primary_adc_raw": Conversion("primary_adc", "FS", adc), "secondary_adc_raw": Conversion("secondary_adc", "FS", adc),
            "drive_dac_raw": Conversion("drive_dac", "FS", dac), "rebalance_dac_raw": Conversion("rebalance_dac", "FS", dac),
            "thermometer_raw": Conversion("thermometer", "LSB", 1.0),
        },
        "baseband": {
            "primary_in_phase": Conversion("primary_i", "FS", q30), "primary_quadrature": Conversion("primary_q", "FS", q30),
            "secondary_in_phase": Conversion("secondary_i", "FS", q30), "secondary_quadrature": Conversion("secondary_q", "FS", q30),
            "drive_frequency": Conversion("freq", "Hz", identity.sample_rate_hz * 2.0**-64),
            "drive_level": Conversion("drive_level", "FS", q31),
            "amplitude_set_point": Conversion("amplitude_set_point", "FS", q30),
            "rebalance_in_phase": Conversion("rebalance_in_phase", "FS", q31),
            "rebalance_quadrature": Conversion("rebalance_quadrature", "FS", q31),
            "status": Conversion("status", "bits", 1.0),
        },
        "output": {
            "temperature_measured": Conversion("temperature_shift", "degC", 2.0**-20, identity.reference_temperature_degc),
            "rate": Conversion("rate", "rad/s", 2.0**-28),
            "rate_uncompensated": Conversion("rate_uncompensated", "rad/s", 2.0**-28),
            "quadrature": Conversion("quadrature", "rad/s", 2.0**-28),
            "angle": Conversion("angle", "rad", 2.0**-28 * identity.slow_period_samples / identity.sample_rate_hz),
        },
    }


def worst_status(records: np.ndarray) -> np.ndarray:
    """One status word per interval: good bits only if set all the time, the others if set at any time; (n,) uint32."""
    good = np.uint32(wire.GOOD_STATUS)
    return (records["status_and"] & good) | (records["status_or"] & ~good)


def si(records: np.ndarray, conversion: Conversion) -> np.ndarray:
    """A field of records in its unit, (n,) float64."""
    return records[conversion.field].astype(np.float64) * conversion.scale + conversion.offset
