"""Stretches of telemetry in which only noise should move, and their spectra.

A window counts when the drive was locked, nothing was commanded and the table stood still, in it and for a while before. What moves slowly is taken
out as a polynomial; a quarter of the windows, those with the most power, is left out of each mean, so that what was missed does not count."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.special import gammainc, gammaincinv

from wineglass.calibration_block import Calibration
from wineglass.diagnosis.recorded_modes import foreign_spans, settling_s
from wineglass.recording.reader import Recording, Tap
from wineglass.wire import Status

LENGTH_S, ORDER = 5.12, 4
LENGTHS = 64, 4096
TAPERS = 2
KEPT = 0.75
LEAST_WINDOWS = 4
IMAGE_FROM_HZ = 3.0
SMOOTH_S = 0.2
_BAD = int(Status.TEST_ACTIVE | Status.OVERFLOW | Status.REBALANCE_SATURATED | Status.ACQUIRING | Status.DRIVE_SATURATED)


@dataclass(frozen=True)
class Windows:
    """first: sample numbers (n,) of the windows' starts in the tap; amplitude_fs: set-point in each, (n,), NaN where it was not recorded"""

    tap: Tap
    first: np.ndarray
    amplitude_fs: np.ndarray
    length: int
    order: int = ORDER
    """of the polynomial that is taken out of each"""

    def __len__(self) -> int:
        return len(self.first)

    @property
    def frequency_hz(self) -> np.ndarray:
        """Bins (length // 2,), zero left out."""
        return np.arange(1, self.length // 2 + 1) * self.tap.sample_rate_hz / self.length

    @property
    def time_s(self) -> np.ndarray:
        """Middles (n,)."""
        return np.asarray(self.tap.time_s[self.first] + 0.5 * self.length / self.tap.sample_rate_hz)

    def of(self, values: np.ndarray) -> np.ndarray:
        """The windows of a channel, each less its polynomial, (n, length); real or complex."""
        cut = values[self.first[:, None] + np.arange(self.length)]
        return cut - cut @ _polynomials(self.length, self.order)

    def transforms(self, values: np.ndarray, turn: np.ndarray | None = None) -> np.ndarray:
        """Tapered Fourier transforms (n, TAPERS, length), scaled so that |.|^2 is a two-sided density. turn: factor for every sample of the tap, applied
        when the slow content is out."""
        cut = self.of(values)
        if turn is not None:
            cut = cut * turn[self.first[:, None] + np.arange(self.length)]
        tapered = cut[:, None, :] * _sine_tapers(self.length)
        return np.asarray(np.fft.fft(tapered, axis=2) / np.sqrt(self.tap.sample_rate_hz))

    def densities(self, values: np.ndarray) -> np.ndarray:
        """One-sided density of each window, (n, length // 2), mean over the tapers."""
        power = np.abs(self.transforms(values)[:, :, 1:self.length // 2 + 1]) ** 2
        return 2.0 * power.mean(axis=1)

    def leaked(self, density: np.ndarray) -> np.ndarray:
        """What `densities` expects of a one-sided density (length // 2,) at the bins: the tapers spread steep spectra."""
        fine, bins = 4 * self.length, self.frequency_hz
        grid = np.arange(1, fine // 2 + 1) * self.tap.sample_rate_hz / fine
        half = np.exp(np.interp(np.log(grid), np.log(bins), np.log(np.maximum(density, 1e-300))))
        low = grid < bins[0]  # the interpolation stops there: go on with the slope of the first two bins
        slope = np.log(max(density[1], 1e-300) / max(density[0], 1e-300)) / np.log(bins[1] / bins[0])
        half[low] = density[0] * (grid[low] / bins[0]) ** max(slope, 0.0)
        whole = np.concatenate([half[:1] if slope <= 0 else [0.0], half, half[-2::-1]])
        kernel = np.mean(np.abs(np.fft.fft(_sine_tapers(self.length), fine, axis=1)) ** 2, axis=0) / fine
        spread = np.fft.ifft(np.fft.fft(whole) * np.fft.fft(kernel)).real
        return np.asarray(spread[4:fine // 2 + 1:4])

    def only(self, chosen: np.ndarray) -> Windows:
        return replace(self, first=self.first[chosen], amplitude_fs=self.amplitude_fs[chosen])


def quiet(recording: Recording, tap: Tap, calibration: Calibration | None, length_s: float = LENGTH_S, skip_s: np.ndarray | None = None,
          order: int = ORDER) -> Windows:
    """Windows of a tap in which only noise should move. skip_s: instants of single events, which no window may hold, (k,)"""
    length = int(np.clip(2 ** round(np.log2(length_s * tap.sample_rate_hz)), *LENGTHS))
    usable = _usable(recording, tap, calibration)
    for instant in np.empty(0) if skip_s is None else skip_s:
        usable &= ~((tap.time_s > instant - 0.2) & (tap.time_s < instant + settling_s(calibration)))
    first, at = [], 0
    blocked = np.concatenate([[0], np.cumsum(~usable)])
    while at + length <= len(tap):
        bad = blocked[at + length] - blocked[at]
        if bad == 0:
            first.append(at)
            at += length
        else:
            at += int(np.flatnonzero(~usable[at:at + length])[-1]) + 1
    starts = np.array(first, dtype=np.int64)
    return Windows(tap, starts, _amplitudes(recording, tap, starts), length, order)


def has_image(windows: Windows, calibration: Calibration) -> np.ndarray:
    """Windows (n,) bool in which the image of the doubled carrier may stand beside zero: the decimator's null is as far off as the carrier is from a
    multiple of half the loop rate."""
    return np.asarray(np.max(np.abs(_image_hz(windows, calibration)), axis=1, initial=0.0) > IMAGE_FROM_HZ)


def image_bins(windows: Windows, calibration: Calibration, reach: int = 2) -> np.ndarray:
    """Bins (n, length // 2) of each window on which that image stands, folded at the telemetry's rate, and so many beside them."""
    found = np.zeros((len(windows), windows.length // 2), bool)
    rate = windows.tap.sample_rate_hz
    away = _image_hz(windows, calibration)
    folded = np.abs(away / rate - np.round(away / rate)) * rate
    for number in np.flatnonzero(has_image(windows, calibration)):
        places = np.unique(np.round(folded[number] * windows.length / rate).astype(int))
        found[number, np.clip(places[:, None] + np.arange(-reach, reach + 1), 1, found.shape[1]) - 1] = True
    return found


def _image_hz(windows: Windows, calibration: Calibration) -> np.ndarray:
    """Frequency of that image at each sample of each window, (n, length)."""
    if len(windows) == 0 or "drive_frequency" not in windows.tap:
        return np.zeros((len(windows), windows.length))
    drive = 2.0 * windows.tap["drive_frequency"][windows.first[:, None] + np.arange(windows.length)]
    return np.asarray(drive - np.round(drive / calibration.loop_rate_hz) * calibration.loop_rate_hz)


def trimmed(power: np.ndarray, shape: float, share: float = KEPT) -> np.ndarray:
    """Mean (m,) over windows of powers (n, m) that are gamma distributed with that shape, from the lesser of them."""
    count = len(power)
    kept = max(1, round(share * count))
    part = kept / count
    if part >= 1.0:
        return np.asarray(power.mean(axis=0))
    edge = gammaincinv(shape, part)
    bias = gammainc(shape + 1.0, edge) / part
    return np.asarray(np.sort(power, axis=0)[:kept].mean(axis=0) / bias)


def _usable(recording: Recording, tap: Tap, calibration: Calibration | None) -> np.ndarray:
    """Samples of the tap at which the device was well and left alone, (n,) bool."""
    usable = tap.valid.copy()
    settle_s = settling_s(calibration)
    if "baseband" in recording and "status" in recording.tap("baseband"):
        base = recording.tap("baseband")
        bits = np.where(base.lost, 0, np.nan_to_num(base["status"])).astype(np.int64)
        wrong = (bits & int(Status.LOCKED) == 0) | (bits & _BAD != 0)
        usable &= ~_after(tap.time_s, base.time_s[wrong], 1.0 / base.sample_rate_hz, settle_s)
    moments = np.array([event.sample / recording.counter_rate_hz for event in recording.events if event.kind in ("command", "segment")])
    usable &= ~_after(tap.time_s, moments, 1.0 / tap.sample_rate_hz, settle_s)
    for begin, end in foreign_spans(recording, calibration) if calibration is not None else []:
        usable &= (tap.time_s < begin) | (tap.time_s > end)
    if knows_rate(recording):
        reference = recording.tap("reference")
        usable &= ~_after(tap.time_s, _moving_s(reference, reference["true_rate"]), 1.0 / reference.sample_rate_hz, settle_s)
    elif "output" in recording and "rate" in recording.tap("output"):
        output = recording.tap("output")
        usable &= ~_after(tap.time_s, _moving_s(output, _smooth(output["rate"], output.sample_rate_hz)), SMOOTH_S, settle_s)
    return usable


def knows_rate(recording: Recording) -> bool:
    return "reference" in recording and "true_rate" in recording.tap("reference")


def _smooth(values: np.ndarray, rate_hz: float) -> np.ndarray:
    """Means (n,) over SMOOTH_S, where the noise of single samples would hide a slow turn."""
    length = max(1, round(SMOOTH_S * rate_hz))
    sound = np.isfinite(values)
    filled = np.interp(np.arange(len(values)), np.flatnonzero(sound), values[sound]) if sound.any() else np.zeros(len(values))
    return np.convolve(filled, np.full(length, 1.0 / length), "same")


def _after(time_s: np.ndarray, moments_s: np.ndarray, before_s: float, after_s: float) -> np.ndarray:
    """Whether a time lies up to before_s before or after_s after one of the moments, (n,) bool."""
    if len(moments_s) == 0:
        return np.zeros(len(time_s), bool)
    moments = np.sort(moments_s)
    last = np.searchsorted(moments, time_s + before_s, side="right") - 1
    return np.asarray((last >= 0) & (time_s - moments[np.maximum(last, 0)] <= after_s))


def _moving_s(tap: Tap, rate: np.ndarray) -> np.ndarray:
    """Instants at which the table moves: its rate (n,) leaves the noise that it has most of the time."""
    rate = np.where(tap.lost, np.nan, rate)
    steps = np.abs(np.diff(rate, prepend=rate[0]))
    noise = np.nanmedian(steps)
    largest = np.nanmax(np.abs(rate), initial=0.0)
    return np.asarray(tap.time_s[np.nan_to_num(steps, nan=np.inf) > 8.0 * noise + 1e-6 * largest])


def _amplitudes(recording: Recording, tap: Tap, starts: np.ndarray) -> np.ndarray:
    if "baseband" not in recording or "amplitude_set_point" not in recording.tap("baseband") or len(starts) == 0:
        return np.full(len(starts), np.nan)
    base = recording.tap("baseband")
    at = np.clip(np.searchsorted(base.time_s, tap.time_s[starts]), 0, len(base) - 1)
    return np.asarray(base["amplitude_set_point"][at])


@cache
def _polynomials(length: int, order: int) -> np.ndarray:
    """Projection (length, length) onto polynomials."""
    basis = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, length), order)
    orthonormal, _ = np.linalg.qr(basis)
    return orthonormal @ orthonormal.T


def _sine_tapers(length: int) -> np.ndarray:
    """Riedel and Sidorenko's tapers of least bias, (TAPERS, length), each of unit energy."""
    order = np.arange(1, TAPERS + 1)[:, None]
    return np.sqrt(2.0 / (length + 1)) * np.sin(np.pi * order * np.arange(1, length + 1) / (length + 1))
