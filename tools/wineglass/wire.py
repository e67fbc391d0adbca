"""Frames on the wire: header, CRC-32, COBS, zero delimiter; the record of every frame type. docs/SPEC.md describes the bytes."""

from __future__ import annotations

import struct
import zlib
from enum import IntEnum

import numpy as np

VERSION = 1
HEADER = struct.Struct("<BBHQ")
CRC_BYTES = 4
MAX_PAYLOAD = 480
MAX_ENCODED = 500  # without delimiter; anything longer is no frame


class FrameType(IntEnum):
    IDENTITY = 1
    STATUS = 2
    BASEBAND = 3
    OUTPUT = 4
    RAW = 5
    SNAPSHOT = 6
    ACK = 7
    CALIBRATION = 8
    SELF_TEST = 9
    SYNC = 10
    PHASES = 11


class Status(IntEnum):
    """Bits of every status word."""

    LOCKED = 1 << 0
    AMPLITUDE_IN_RANGE = 1 << 1
    ADC_SATURATED = 1 << 2
    DRIVE_SATURATED = 1 << 3
    OVERFLOW = 1 << 4
    CALIBRATION_VALID = 1 << 5
    TEMPERATURE_VALID = 1 << 6
    RETUNE_VALID = 1 << 7
    RATE_VALID = 1 << 8
    ACQUIRING = 1 << 9
    REBALANCE_ACTIVE = 1 << 10
    REBALANCE_SATURATED = 1 << 11
    TEST_ACTIVE = 1 << 12
    DRIVE_OFF = 1 << 13


class Part(IntEnum):
    """Bits of `checked` and `failed` in the self-test: parts of a board, hal/hal.h."""

    CRYSTAL = 1 << 0
    CORE_CLOCK = 1 << 1
    SAMPLE_CLOCK = 1 << 2
    CONVERTERS = 1 << 3
    PICKOFFS = 1 << 4
    THERMOMETER = 1 << 5
    STORE = 1 << 6
    IMAGE = 1 << 7
    MEMORY = 1 << 8
    WATCHDOG = 1 << 9
    UNIQUE_ID = 1 << 10
    LAST_RUN = 1 << 11


GOOD_STATUS = (Status.LOCKED | Status.AMPLITUDE_IN_RANGE | Status.CALIBRATION_VALID | Status.TEMPERATURE_VALID
               | Status.RETUNE_VALID | Status.RATE_VALID | Status.REBALANCE_ACTIVE)
"""Bits that say that something is well; the others say that something happened."""

_HEADER_FIELDS = [("version", "u1"), ("type", "u1"), ("sequence", "<u2"), ("sample_counter", "<u8")]
_INTERVAL_STATUS = [("status_or", "<u4"), ("status_and", "<u4")]

_PAYLOADS: dict[FrameType, list[tuple[str, str]]] = {
    FrameType.IDENTITY: [
        ("firmware_major", "<u2"), ("firmware_minor", "<u2"), ("firmware_patch", "<u2"), ("snapshot_version", "<u2"),
        ("build_id", "<u4"), ("calibration_version", "<u2"), ("unique_id", "<u8"), ("sample_rate_millihz", "<u4"),
        ("adc_bits", "u1"), ("dac_bits", "u1"), ("decimation", "<u2"), ("loops_per_slow", "<u2"),
        ("reference_temperature_mdegc", "<i4"), ("calibration_serial", "<u4"), ("calibration_sequence", "<u4"),
        ("calibration_crc", "<u4"), ("calibration_source", "u1"), ("calibration_valid", "u1"), ("device_name", "S16"),
    ],
    FrameType.STATUS: [
        ("time_us", "<u8"), ("status", "<u4"), *_INTERVAL_STATUS, ("acquisition_attempt", "<u4"), ("loop", "u1"),
        ("compensation", "u1"), ("output_filter", "u1"), ("baseband_divisor", "<u2"), ("output_divisor", "<u2"),
        ("calibration_unlocked", "u1"), ("burst_active", "u1"), ("reserved", "u1"), ("frames_lost", "<u4"),
        ("records_lost", "<u4"), ("bursts_cut", "<u4"), ("commands_accepted", "<u4"), ("commands_refused", "<u4"),
        ("receive_errors", "<u4"), ("store_errors", "<u4"),
    ],
    FrameType.BASEBAND: [
        ("interval_samples", "<u4"), ("primary_i", "<i4"), ("primary_q", "<i4"), ("secondary_i", "<i4"), ("secondary_q", "<i4"),
        ("freq", "<u8"), ("drive_level", "<i4"), ("amplitude_set_point", "<i4"), ("rebalance_in_phase", "<i4"),
        ("rebalance_quadrature", "<i4"), *_INTERVAL_STATUS,
    ],
    FrameType.OUTPUT: [
        ("interval_samples", "<u4"), ("thermometer_raw", "<i4"), ("temperature_shift", "<i4"), ("bias", "<i4"), ("rate", "<i4"),
        ("rate_uncompensated", "<i4"), ("quadrature", "<i4"), ("angle", "<u8"), *_INTERVAL_STATUS,
    ],
    FrameType.RAW: [
        ("first_sample", "<u8"), ("thermometer_raw", "<i4"), ("count", "<u2"), ("code_bytes", "u1"), ("flags", "u1"),
    ],
    FrameType.SNAPSHOT: [("burst_sample", "<u8"), ("offset", "<u2"), ("total", "<u2")],
    FrameType.ACK: [("command", "u1"), ("reason", "u1"), ("command_sequence", "<u2")],
    FrameType.CALIBRATION: [],
    FrameType.SYNC: [("since_sample_q16", "<u4"), ("number", "<u4")],
    FrameType.PHASES: [
        ("outcome", "<u2"), ("parts", "<u2"), ("temperature_shift", "<i4"), ("drive_correction", "<i4"), ("drive_uncertainty", "<i4"),
        ("drive_phase", "<i4"), ("demodulation_correction", "<i4"), ("demodulation_uncertainty", "<i4"), ("demodulation_phase", "<i4"),
    ],
    FrameType.SELF_TEST: [
        ("checked", "<u4"), ("failed", "<u4"), ("core_clock_hz", "<u4"), ("fault_address", "<u4"), ("samples_lost", "<u4"),
    ],
}

DTYPES = {kind: np.dtype(_HEADER_FIELDS + fields) for kind, fields in _PAYLOADS.items()}
"""Record of a frame: its header and the fixed part of its payload."""

OPEN_ENDED = (FrameType.RAW, FrameType.SNAPSHOT, FrameType.CALIBRATION)
"""Frame types whose payload goes on after the fixed part."""

FLAG_FIRST, FLAG_LAST, FLAG_CUT = 1, 2, 4
"""Flags of raw frames: first chunk of a burst, last chunk, burst ended early."""


def encode(kind: int, sequence: int, payload: bytes = b"", sample_counter: int = 0, version: int = VERSION) -> bytes:
    """One frame, with its delimiter."""
    plain = HEADER.pack(version, kind, sequence & 0xFFFF, sample_counter) + payload
    return cobs_encode(plain + struct.pack("<I", zlib.crc32(plain))) + b"\0"


def cobs_encode(plain: bytes) -> bytes:
    """Consistent overhead byte stuffing of one packet, without delimiter."""
    encoded = bytearray()
    pieces = plain.split(b"\0")
    for number, piece in enumerate(pieces):
        while len(piece) > 254 or (len(piece) == 254 and number < len(pieces) - 1):
            encoded += b"\xff" + piece[:254]
            piece = piece[254:]
        encoded += bytes([len(piece) + 1]) + piece
    return bytes(encoded)
