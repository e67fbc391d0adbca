"""What is passed to the writer and handed out by the reader."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class ChannelFormat:
    """How a channel is stored: value = code * scale + offset, in the unit of the channel table."""

    dtype: str = "f8"
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class TapFormat:
    sample_rate_hz: float
    channels: dict[str, ChannelFormat]


@dataclass(frozen=True)
class RecordingMeta:
    """What describes a whole recording.

    counter_rate_hz: rate of the common sample counter (the ADC rate of a device; the row rate of an imported table)
    calibration_crc: of the calibration in force, as the device itself reports it; None: not known
    """

    counter_rate_hz: float
    device_toml: str = ""
    calibration_json: str = ""
    calibration_block: bytes = b""
    firmware_version: str = ""
    source: str = ""
    calibration_crc: int | None = None
    taps: dict[str, TapFormat] = field(default_factory=dict)


@dataclass(frozen=True)
class Event:
    """sample: on the common sample counter"""

    sample: int
    kind: str
    value: str = ""


def float_format() -> ChannelFormat:
    return ChannelFormat("f8", 1.0, 0.0)


def fraction_format(bits: int, dtype: str = "i4") -> ChannelFormat:
    """Codes of a converter with `bits` bits (two's complement) as a fraction of its full scale."""
    return ChannelFormat(dtype, float(np.ldexp(1.0, 1 - bits)), 0.0)
