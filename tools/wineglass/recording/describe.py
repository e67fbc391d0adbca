"""What a recording holds, as plain values."""

from __future__ import annotations

import numpy as np

from wineglass.recording.channels import CHANNELS, TIME
from wineglass.recording.reader import Recording, Tap


def summary(recording: Recording) -> dict:
    return {
        "file": recording.path,
        "format_version": recording.format_version,
        "source": recording.source,
        "firmware_version": recording.firmware_version,
        "counter_rate_hz": recording.counter_rate_hz,
        "device_toml_bytes": len(recording.device_toml.encode()),
        "calibration_json_bytes": len(recording.calibration_json.encode()),
        "calibration_block_bytes": len(recording.calibration_block),
        "events": [{"sample": e.sample, "kind": e.kind, "value": e.value} for e in recording.events],
        "taps": {tap.name: _tap_facts(tap) for tap in all_taps(recording)},
    }


def all_taps(recording: Recording) -> list[Tap]:
    return [*recording.bursts, *recording.taps.values()]


def channel_rows(recording: Recording) -> list[dict]:
    """One row per tap and channel: unit, minimum, mean and maximum over the samples that were not lost."""
    return [
        {"tap": tap.name, "channel": name, "unit": unit, **_range_of(tap[name]),
         "meaning": (CHANNELS.get(name) or TIME).meaning}
        for tap in all_taps(recording)
        for name, unit in tap.channels.items()
    ]


def _tap_facts(tap: Tap) -> dict:
    return {
        "samples": tap.length,
        "sample_rate_hz": tap.sample_rate_hz,
        "first_sample": tap.first_sample,
        "duration_s": tap.duration_s,
        "lost": int(tap.lost.sum()),
        "state_snapshot_bytes": len(tap.state_snapshot),
        "ignored": tap.ignored,
    }


def _range_of(values: np.ndarray) -> dict[str, float]:
    there = values[~np.isnan(values)]
    if there.size == 0:
        return {"minimum": np.nan, "mean": np.nan, "maximum": np.nan}
    return {"minimum": float(there.min()), "mean": float(there.mean()), "maximum": float(there.max())}
