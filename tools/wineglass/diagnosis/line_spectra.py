"""Spectra of a complex channel, window by window, in frames that turn with the oscillator or stand still, and how far bins rise above their
neighbours."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from wineglass.diagnosis.noise_windows import KEPT, TAPERS, Windows

LEAST_BIN, FAR_BIN, FIRST_SOUND_BIN = 8, 12, 3
"""counted from the carrier: below, what moves slowly leaves no level to compare with, the less so where frames move; the polynomial takes the first
bins' power"""
REACH_BINS, GAP_BINS = 10, 2


@dataclass(frozen=True)
class Spectra:
    """values: complex (samples,); form (length,): of the floor; transforms: tapered (n, TAPERS, length) of the windows, brought to one level of noise, since
    noise that changes would make lines where only some windows count; masked: bins (n, length) that do not count, in the turning frame; level (n, 1, 1): what the
    transforms were divided by"""

    windows: Windows
    values: np.ndarray
    carrier_hz: np.ndarray
    form: np.ndarray
    transforms: np.ndarray
    masked: np.ndarray
    level: np.ndarray

    @staticmethod
    def of(windows: Windows, values: np.ndarray, carrier_hz: np.ndarray, white: np.ndarray, images: np.ndarray) -> Spectra:
        """white (length // 2,): the floor's form; images: bins (n, length // 2) that do not count."""
        transforms = windows.transforms(values)
        form = np.concatenate([white[:1], white, white[-2::-1]])[:windows.length]
        level = np.median(np.mean(np.abs(transforms) ** 2, axis=1) / form, axis=1)
        usual = np.sqrt(level / np.median(level))[:, None, None]
        found = Spectra(windows, values, carrier_hz, form, transforms / usual, np.zeros((len(windows), windows.length), bool), usual)
        found.masked[:, _signed(windows.length) < FIRST_SOUND_BIN] = True
        return found.without(images)

    def without(self, bins: np.ndarray) -> Spectra:
        """bins (n, length // 2): on both sides of the carrier."""
        both = np.zeros_like(self.masked)
        both[:, 1:bins.shape[1] + 1] = bins
        both[:, :-bins.shape[1] - 1:-1] |= bins
        return replace(self, masked=self.masked | both)

    def parts(self) -> tuple[np.ndarray, np.ndarray]:
        """Spectra (n, length // 2 - 1) of real and imaginary part of every window, NaN where a bin does not count."""
        length = self.windows.length
        up, down = self.transforms[:, :, 1:length // 2], np.conj(self.transforms[:, :, :length // 2:-1])
        masked = self.masked[:, 1:length // 2]
        real, imaginary = (np.mean(np.abs(0.5 * part) ** 2, axis=1) for part in (up + down, up - down))
        return np.where(masked, np.nan, real), np.where(masked, np.nan, imaginary)

    def folded(self) -> np.ndarray:
        """Powers (n, length // 2 - 1) of both sides of the carrier together over the floor's form, NaN where a bin does not count."""
        half = self.windows.length // 2
        both = self._relative[:, 1:half] + self._relative[:, :half:-1]
        return np.where(self.masked[:, 1:half], np.nan, both)

    def in_frame(self, frame_hz: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places [Hz], mean powers and numbers of terms (length,) in a frame whose frequency, against the oscillator's, is -frame_hz (samples,)."""
        rate, length = self.windows.tap.sample_rate_hz, self.windows.length
        turn = np.exp(2j * np.pi * np.cumsum(frame_hz) / rate)
        power = np.mean(np.abs(self.windows.transforms(self.values, turn) / self.level) ** 2, axis=1)
        shift = np.array([frame_hz[first:first + length].mean() for first in self.windows.first])
        whole = np.round(shift * length / rate).astype(int)
        masked = self._shifted(self._far, whole)
        order = np.fft.fftshift(np.arange(length))
        mean, count = usual(np.where(masked, np.nan, power)[:, order])
        return np.fft.fftfreq(length, 1.0 / rate)[order], mean, count

    def top_of_shifted(self, shift_hz: np.ndarray) -> float:
        """The best line's score when each window is shifted by so much (n,), in whole bins."""
        whole = np.round(shift_hz * self.windows.length / self.windows.tap.sample_rate_hz).astype(int)
        power = np.where(self._shifted(self._far, whole), np.nan, self._shifted(self._relative, whole))
        return float(np.max(score(*usual(np.fft.fftshift(power, axes=1)), round=True)[1]))

    def powers_at(self, offset_hz: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Per window (n,): power within two bins of an offset from the carrier, the noise's there, and the power as far on the carrier's other side. NaN
        where it does not count."""
        length, rate = self.windows.length, self.windows.tap.sample_rate_hz
        at = np.round(offset_hz * length / rate).astype(int)
        power = np.mean(np.abs(self.transforms) ** 2, axis=1)
        rows = np.arange(len(self.windows))[:, None]
        line, aside = (at[:, None] + np.arange(-2, 3)) % length, (at[:, None] + np.concatenate([np.arange(-12, -4), np.arange(5, 13)])) % length
        found = np.where(self._far[rows, line].any(axis=1), np.nan, power[rows, line].sum(axis=1))
        return found, 5.0 * np.median(power[rows, aside], axis=1), power[rows, -line % length].sum(axis=1)

    @property
    def _far(self) -> np.ndarray:
        """Bins (n, length) that do not count in a frame in which the carrier moves: its surroundings, too."""
        return np.asarray(self.masked | (_signed(self.windows.length) < FAR_BIN))

    @cached_property
    def _relative(self) -> np.ndarray:
        """Powers (n, length) over the floor's form."""
        power = np.mean(np.abs(self.transforms) ** 2, axis=1)
        return np.asarray(power / self.form)

    def _shifted(self, values: np.ndarray, bins: np.ndarray) -> np.ndarray:
        """Rows (n, length), each turned to higher frequencies by so many bins."""
        length = values.shape[1]
        return np.asarray(np.take_along_axis(values, (np.arange(length) - bins[:, None]) % length, axis=1))


def usual(powers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean power (m,) of the windows (n, m) in which a bin is sound, without the quarter that has most there, since a single jolt is no line; and how
    many terms it has. NaN where too few are sound."""
    number = np.count_nonzero(np.isfinite(powers), axis=0)
    kept = np.maximum(np.round(KEPT * number), 1)
    ordered = np.sort(powers, axis=0)  # NaN last
    chosen = np.arange(len(powers))[:, None] < kept
    mean = np.sum(np.where(chosen, ordered, 0.0), axis=0) / kept
    return np.where(number > 0.2 * len(powers), mean, np.nan), 0.8 * TAPERS * kept


def _signed(length: int) -> np.ndarray:
    """Distance of each bin of a transform from zero, (length,)."""
    bins = np.arange(length)
    return np.minimum(bins, length - bins)


def score(power: np.ndarray, count: np.ndarray, first: int = 0, *, round: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Of every bin: power over the higher of the levels on both sides, so that a slope is no line, and the log likelihood ratio of a line there, both
    (m,); power: means of `count` terms, NaN where a bin does not count; first: no lines below; round: the last bin is a neighbour of the first one,
    else the spectrum is mirrored at its upper end."""
    size, margin = len(power), REACH_BINS + GAP_BINS
    below = power[-margin:] if round else np.full(margin, np.nan)
    above = power[:margin] if round else power[-2:-margin - 2:-1]
    pieces = sliding_window_view(np.concatenate([below, power, above]), REACH_BINS)
    left, right = _median(pieces[:size]), _median(pieces[margin + GAP_BINS + 1:margin + GAP_BINS + 1 + size])
    sound = np.isfinite(power) & np.isfinite(left) & np.isfinite(right)
    ratio = np.where(sound, power, 0.0) / np.where(sound, np.maximum(left, right), 1.0)
    over = np.maximum(ratio, 1.0)
    found = count * (over - 1.0 - np.log(over))
    found[:first] = 0.0
    return ratio, found


def _median(pieces: np.ndarray) -> np.ndarray:
    """Of the rows (m, k), of what is sound; NaN with fewer than three."""
    ordered = np.sort(pieces, axis=1)  # NaN last
    number = np.count_nonzero(np.isfinite(pieces), axis=1)
    at = np.maximum(number - 1, 0) // 2
    middle = 0.5 * (ordered[np.arange(len(ordered)), at] + ordered[np.arange(len(ordered)), np.maximum(number, 1) // 2 - (number == 0)])
    return np.where(number >= 3, middle, np.nan)
