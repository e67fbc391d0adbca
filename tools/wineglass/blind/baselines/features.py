"""A recording as one row of numbers: per channel, how it depends on what drove it, and how it is noisy."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from wineglass.recording import Recording

CHANNELS = ("secondary_in_phase", "secondary_quadrature", "drive_frequency", "drive_level", "rebalance_in_phase", "rebalance_quadrature",
            "temperature_measured", "rate", "rate_uncompensated", "quadrature")
SETTLED_PART = 0.1  # of the recording: the amplitude grows
FRAMES = 2000
COLUMNS = ("mean", "shift", "shift2", "shift3", "slope", "rate", "rate2", "rate3", "rate_shift", "time", "residual", "slow", "noise", "tails")
NAMES = tuple(f"{channel}.{column}" for channel in CHANNELS for column in COLUMNS)


def of_bytes(recording: bytes) -> np.ndarray:
    """(len(NAMES),) for a recording given as bytes."""
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "case.h5"
        path.write_bytes(recording)
        return of_file(path)


def of_file(path: Path) -> np.ndarray:
    """(len(NAMES),); channels that are missing give zeros."""
    with Recording.open(path, tolerant=True) as recording:
        times = np.linspace(0.0, 1.0, FRAMES)
        taps = {name: tap for key in ("reference", "baseband", "output") if key in recording for tap in [recording.tap(key)] for name in tap.channels}
        last = max(float(tap.time_s[-1]) for tap in taps.values())
        at = last * (SETTLED_PART + (1.0 - SETTLED_PART) * times)
        drivers = [_means(taps, name, at) for name in ("chamber_temperature", "shell_temperature", "true_rate")]
        temperature = drivers[1] if np.any(drivers[1]) else drivers[0]
        regressors = _regressors(times, temperature, drivers[2])
        return np.concatenate([_channel(taps, name, at, regressors) for name in CHANNELS])


def _regressors(times: np.ndarray, temperature: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """(FRAMES, 10), as the first columns of COLUMNS say, each of size one."""
    shift = _unit(temperature - temperature[0])
    slope, rate = _unit(np.gradient(temperature)), _unit(rate)
    return np.column_stack([np.ones_like(times), shift, shift**2, shift**3, slope, rate, rate**2, rate**3, rate * shift, times - 0.5])


def _unit(values: np.ndarray) -> np.ndarray:
    size = float(np.max(np.abs(values)))
    return values / size if size > 0 else values


def _channel(taps: dict, name: str, at: np.ndarray, regressors: np.ndarray) -> np.ndarray:
    """(14,): coefficients, then logarithms of rms left, of its slow part, of white noise, and kurtosis."""
    if name not in taps:
        return np.zeros(len(COLUMNS))
    values = _means(taps, name, at)
    coefficients = np.linalg.lstsq(regressors, values, rcond=1e-6)[0]
    left = values - regressors @ coefficients
    slow = left.reshape(-1, 50).mean(axis=1)
    raw = np.asarray(taps[name][name], float)
    second = np.diff(raw[np.isfinite(raw)], 2)
    tails = float(np.mean(left**4) / max(np.mean(left**2) ** 2, 1e-300))
    return np.array([*coefficients, _log(np.std(left)), _log(np.std(slow)), _log(np.median(np.abs(second))), np.log(max(tails, 1e-3))])


def _log(value: float) -> float:
    return float(np.log(max(float(value), 1e-15)))


def _means(taps: dict, name: str, at: np.ndarray) -> np.ndarray:
    """(FRAMES,) straight in between, lost samples left out; zeros where the channel is missing."""
    if name not in taps:
        return np.zeros(len(at))
    tap = taps[name]
    values = np.asarray(tap[name], float)
    sound = np.isfinite(values)
    return np.interp(at, tap.time_s[sound], values[sound]) if np.any(sound) else np.zeros(len(at))
