"""The device's own line: its mixers leave a little of twice the carrier wherever the resonance is not just what the decimator was made for. In telemetry
it folds to anywhere. Its frequency is known from the oscillator's, so it is fitted over a few seconds at a time and taken out."""

from __future__ import annotations

import numpy as np

from wineglass.recording import Tap

WINDOW_S = 4.0
TOO_SLOW_HZ = 3.0  # folded so near to zero the line cannot be told from what moves slowly
CLEAR = 1.0  # of what else moves in the window: below that it is no line, or something else moves too much to see it
CHANNELS = ("primary_in_phase", "primary_quadrature", "drive_frequency")


def phase(tap: Tap) -> np.ndarray | None:
    """Of twice the oscillator [turns], at the tap's samples (n,); None where its frequency was not recorded."""
    if "drive_frequency" not in tap or tap.length < 2:
        return None
    frequency = tap["drive_frequency"]
    sound = np.isfinite(frequency)
    if sound.sum() < 2:
        return None
    filled = np.interp(np.arange(tap.length), np.flatnonzero(sound), frequency[sound])
    step = 1.0 / tap.sample_rate_hz
    return np.concatenate([[0.0], np.cumsum((filled[1:] + filled[:-1]) * step)])


def removed(tap: Tap, values: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """values (n,) without the line; where it folds too near to zero it stays."""
    length = max(16, round(WINDOW_S * tap.sample_rate_hz))
    result = values.copy()
    for first in range(0, len(values), length):
        part = slice(max(0, min(first, len(values) - length)), first + length)
        here = slice(first, min(first + length, len(values)))
        result[here] = (values[part] - _line(values[part], turns[part], tap.sample_rate_hz))[here.start - part.start:]
    return result


def _line(values: np.ndarray, turns: np.ndarray, rate_hz: float) -> np.ndarray:
    """The line in one window, beside a parabola; nothing in a window in which it nearly stands still."""
    folded = np.diff(turns) - np.round(np.diff(turns))
    sound = np.isfinite(values)
    if np.min(np.abs(folded)) * rate_hz < TOO_SLOW_HZ or sound.sum() < 12:
        return np.zeros(len(values))
    angle = 2.0 * np.pi * turns
    slow = np.vander(np.linspace(-1.0, 1.0, len(values)), 3)
    design = np.column_stack([np.cos(angle), np.sin(angle), slow])
    fitted = np.linalg.lstsq(design[sound], values[sound], rcond=None)[0]
    line = design[:, :2] @ fitted[:2]
    left = values[sound] - design[sound] @ fitted
    return line if np.sum(line[sound] ** 2) > CLEAR * np.sum(left**2) else np.zeros(len(values))
