"""Two recordings of the same thing: equal to the last code, or where they part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wineglass.recording.reader import Recording, Tap


@dataclass(frozen=True)
class Difference:
    """The first place at which two recordings differ."""

    tap: str
    channel: str
    """a channel, `length`, `lost`, or what else differs"""
    sample: int
    """on the common sample counter"""

    def __str__(self) -> str:
        return f"sample {self.sample}: {self.channel} of {self.tap} differs"


@dataclass(frozen=True)
class Comparison:
    difference: Difference | None
    samples: dict[str, int]
    """tap -> samples that were compared, all their channels"""


def compare(first: Recording, second: Recording, common: bool = False) -> Comparison:
    """Stored codes, masks and snapshots. `common`: only over the span that both recordings have; otherwise a missing end is a difference."""
    pairs = [(name, first.taps.get(name), second.taps.get(name)) for name in dict.fromkeys([*first.taps, *second.taps])]
    pairs += [(f"raw burst {number}", *burst) for number, burst in enumerate(zip(first.bursts, second.bursts))]
    found, samples = [], {}
    if len(first.bursts) != len(second.bursts) and not common:
        found.append(Difference("raw", "number of bursts", 0))
    for name, one, other in pairs:
        if one is None or other is None:
            found += [] if common else [Difference(name, "presence", 0)]
            continue
        difference, samples[name] = _compare_taps(name, one, other, common)
        found += [difference] if difference else []
    return Comparison(min(found, key=lambda item: item.sample, default=None), samples)


def _compare_taps(name: str, one: Tap, other: Tap, common: bool) -> tuple[Difference | None, int]:
    step = one.counter_rate_hz / one.sample_rate_hz
    if one.sample_rate_hz != other.sample_rate_hz or (other.first_sample - one.first_sample) % step:
        return Difference(name, "grid of samples", one.first_sample), 0
    begin = max(one.first_sample, other.first_sample)
    spans = [tap.first_sample + tap.length * step for tap in (one, other)]
    count = max(0, round((min(spans) - begin) / step))
    first, second = (slice(round((begin - tap.first_sample) / step), None) for tap in (one, other))
    if count == 0:
        return Difference(name, "span (nothing in common)", begin), 0
    found = []
    for channel in dict.fromkeys([*one.channels, *other.channels]):
        if channel not in one.channels or channel not in other.channels:
            found.append(Difference(name, f"presence of {channel}", begin))
            continue
        differs = one.codes(channel)[first][:count] != other.codes(channel)[second][:count]
        found += _first(name, channel, differs & ~one.lost[first][:count], begin, step)
    found += _first(name, "lost", one.lost[first][:count] != other.lost[second][:count], begin, step)
    if not common and (one.first_sample != other.first_sample or one.length != other.length):
        found.append(Difference(name, "length", int(min(spans)) if one.first_sample == other.first_sample else min(one.first_sample, other.first_sample)))
    if not common and one.state_snapshot != other.state_snapshot:
        found.append(Difference(name, "state snapshot", one.first_sample))
    return min(found, key=lambda item: item.sample, default=None), count


def _first(name: str, channel: str, differs: np.ndarray, begin: int, step: float) -> list[Difference]:
    at = np.flatnonzero(differs)
    return [Difference(name, channel, begin + round(int(at[0]) * step))] if len(at) else []
