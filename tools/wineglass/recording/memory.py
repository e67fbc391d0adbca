"""A recording that is never a file: takes what a RecordingWriter takes, and hands it out as an open Recording does.

Append everything before the first look at a tap.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from wineglass import units
from wineglass.recording import channels as table
from wineglass.recording.model import ChannelFormat, TapFormat


class Samples(Protocol):
    """What a tap of a file and one in memory have in common; see reader.Tap."""

    @property
    def sample_rate_hz(self) -> float: ...
    @property
    def length(self) -> int: ...
    @property
    def valid(self) -> np.ndarray: ...
    @property
    def time_s(self) -> np.ndarray: ...
    def codes(self, channel: str) -> np.ndarray: ...
    def __contains__(self, channel: object) -> bool: ...
    def __getitem__(self, channel: str) -> np.ndarray: ...


class Source(Protocol):
    """What a recording and one in memory have in common."""

    def tap(self, name: str) -> Samples: ...
    def __contains__(self, tap: object) -> bool: ...


@dataclass
class MemoryTap:
    """One group of channels with a common sample rate; the samples between its pieces were lost."""

    name: str
    form: TapFormat
    counter_rate_hz: float
    first_sample: int
    pieces: list[tuple[int, dict[str, np.ndarray]]] = field(default_factory=list)
    """place of the first sample in the tap, and codes (n,) by channel"""

    @property
    def sample_rate_hz(self) -> float:
        return self.form.sample_rate_hz

    @property
    def channels(self) -> list[str]:
        """Their names."""
        return list(self.form.channels)

    @property
    def length(self) -> int:
        place, columns = self.pieces[-1]
        return place + len(next(iter(columns.values())))

    @cached_property
    def valid(self) -> np.ndarray:
        """Mask (n,) bool."""
        valid = np.zeros(self.length, bool)
        for place, columns in self.pieces:
            valid[place : place + len(next(iter(columns.values())))] = True
        return valid

    @cached_property
    def time_s(self) -> np.ndarray:
        """Time (n,) in s since counter zero."""
        return self.first_sample / self.counter_rate_hz + np.arange(self.length) / self.sample_rate_hz

    def codes(self, channel: str) -> np.ndarray:
        """Codes (n,); zero at lost samples."""
        codes = np.zeros(self.length, self.form.channels[channel].dtype)
        for place, columns in self.pieces:
            codes[place : place + len(columns[channel])] = columns[channel]
        return codes

    def __contains__(self, channel: object) -> bool:
        return channel in self.form.channels

    def __getitem__(self, channel: str) -> np.ndarray:
        """Values (n,) float64 in the base unit of the channel; NaN where the sample was lost."""
        values = _values(self.name, channel, self.form.channels[channel], self.codes(channel))
        values[~self.valid] = np.nan
        return values


class MemoryRecording:
    """Slow taps only: raw bursts and events are dropped."""

    def __init__(self, counter_rate_hz: float):
        self.counter_rate_hz = counter_rate_hz
        self._formats: dict[str, TapFormat] = {}
        self._taps: dict[str, MemoryTap] = {}

    def add_tap(self, tap: str, form: TapFormat) -> None:
        """Declare a tap before its first append."""
        self._formats[tap] = form

    def append(self, tap: str, data: Mapping[str, np.ndarray], first_sample: int, *, state_snapshot: bytes | None = None) -> None:
        """Add samples of which the first stands at `first_sample` of the common counter, behind all others."""
        if tap == "raw":
            return
        form = self._formats[tap]
        held = self._taps.setdefault(tap, MemoryTap(tap, form, self.counter_rate_hz, first_sample))
        place = round((first_sample - held.first_sample) * form.sample_rate_hz / self.counter_rate_hz)
        held.pieces.append((place, dict(data)))

    def event(self, kind: str, value: str = "", *, sample: int) -> None:
        """As a RecordingWriter; not kept."""

    def tap(self, name: str) -> MemoryTap:
        return self._taps[name]

    def __contains__(self, tap: object) -> bool:
        return tap in self._taps

    def __iter__(self) -> Iterator[str]:
        return iter(self._taps)


def _values(tap: str, channel: str, form: ChannelFormat, codes: np.ndarray) -> np.ndarray:
    entry = table.find(tap, channel)
    assert entry is not None
    unit = units.find(entry.unit)
    assert unit is not None
    return np.asarray(units.to_base(codes.astype(np.float64) * form.scale + form.offset, unit), dtype=np.float64)
