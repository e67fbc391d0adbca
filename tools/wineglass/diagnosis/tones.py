"""A named line in a channel of means: followed at the tap's own rate, and taken out before any mean is formed.

A tone that adds to the secondary pickoff stands at a fixed frequency, or at one that follows the temperature; the channels turn with the oscillator, whose
frequency was recorded. A vibration stands still. Either way the line's phase is known but for a slow rest, which is followed too:

    x = a cos(2 pi turns) + b sin(2 pi turns) + what is slow + noise,        a, b change over seconds

a and b are means over a few seconds of what is left beside the slow part, of samples at which nothing else happens. Wherever the line stands so near to the
slow part that the two are one, or where nothing quiet is near, the samples are not trusted."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import fft
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from wineglass.diagnosis import channels
from wineglass.diagnosis.channels import Frames
from wineglass.diagnosis.noise_lines import Line, filled
from wineglass.recording.memory import Samples, Source
from wineglass.wire import Status

SLOW_S = 0.15
"""what is smoother than that is no line (standard deviation of a bell, s)"""
TIMES, LEAST_PASSED = 2, 0.2
"""so often the smooth part is taken out; what that is taken to leave of a line at the least"""
FOLLOWED_S, FAR_S, FAR_WEIGHT = 2.0, 20.0, 1e-4
"""over which the line's size is a mean; the wider bell carries it across stretches in which nothing is quiet"""
NEAREST_HZ = 1.2
"""from zero, and from half the tap's rate: nearer than that a line is part of what is slow, or of its own image"""
SOUGHT_HZ, SOUGHT_S = 0.75, 4.0
"""by which a line may be off its place, and windows in which that is looked for"""
ROUNDS = 5
OUTLIER, HALF, NEAR = 4.5, 0.5, 2.5
"""of noise's deviation and of the line's size: samples that are farther off do not tell the line's size, nor do their
neighbours under the bell of what is slow"""
SUPPORT = 0.75
"""part of a bell that quiet samples must fill"""
LEAST_S = 2.0
"""a piece that is shorter says nothing about a line"""
STANDS, GONE = 4.0, 0.05
"""power of a band about the line over that of the bands beside it: from there on it is to be taken out; of which this much may be left"""
BAND_HZ = 0.1, 0.6
STRONGEST = 300.0
"""of the noise beside it: what switches and test signals leave of a stronger line is above the floor of means"""
LEAST_TRUSTED = 0.3
"""of the samples: a channel of which less is left is not used"""
SHOWN = ("secondary_in_phase", "secondary_quadrature", "rebalance_in_phase", "rebalance_quadrature")


@dataclass(frozen=True)
class Cleaned:
    """values (n,) without the line; trusted (n,); stood: the line was there to begin with; gone: it is no more."""

    values: np.ndarray
    trusted: np.ndarray
    stood: bool
    gone: bool


def without(frames: Frames, recording: Source, lines: list[Line], names: list[str]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Means (n,) of these channels without the lines, and where they are to be used (n,); channels that a line does not leave are not among them."""
    if "baseband" not in recording:
        return {}
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    phases = _phases(recording, lines)
    if phases is None:
        return found
    carrier = recording.tap("baseband")
    for name in names:
        tap = carrier if name in carrier else recording.tap("output")
        cuts = np.unique(np.searchsorted(tap.time_s, carrier.time_s[switched(carrier)]))
        cleaned = _without_all(tap[name], [np.interp(tap.time_s, carrier.time_s, turns) for turns in phases], cuts, tap.sample_rate_hz)
        if cleaned is not None:
            values, complete = channels.means(tap, cleaned.values, frames.grid)
            doubtful, _ = channels.means(tap, 1.0 - cleaned.trusted, frames.grid)
            found[name] = values, complete & (doubtful == 0.0)
    return found


def _phases(recording: Source, lines: list[Line]) -> list[np.ndarray] | None:
    """Of every line (n,), at the samples of the baseband; None: of one it is not known."""
    carrier = recording.tap("baseband")
    shown = [filled(carrier, name) for name in SHOWN if name in carrier and np.nanmax(np.abs(carrier[name]), initial=0.0) > 0.0]
    phases = []
    for line in lines:
        turns = turns_of(line, carrier, _temperature(recording, carrier))
        if turns is None:
            return None
        phases.append(refined(turns, shown, carrier.sample_rate_hz))
    return phases


def _temperature(recording: Source, carrier: Samples) -> np.ndarray | None:
    """As measured (n,), at the samples of the baseband."""
    if "output" not in recording or "temperature_measured" not in recording.tap("output"):
        return None
    output = recording.tap("output")
    sound = np.isfinite(output["temperature_measured"])
    return np.interp(carrier.time_s, output.time_s[sound], output["temperature_measured"][sound]) if sound.any() else None


def _without_all(values: np.ndarray, phases: list[np.ndarray], cuts: np.ndarray, rate_hz: float) -> Cleaned | None:
    """None: a line stays, or stands so near to what is slow that little would be left."""
    trusted, stood = np.ones(len(values), bool), False
    for turns in phases:
        cleaned = removed(values, turns, rate_hz, cuts)
        values, trusted, stood = cleaned.values, trusted & cleaned.trusted, stood or cleaned.stood
        if not cleaned.gone or np.mean(trusted) < LEAST_TRUSTED:
            return None
    return Cleaned(values, trusted, stood, True)


def turns_of(line: Line, carrier: Samples, temperature_degc: np.ndarray | None) -> np.ndarray | None:
    """Phase (n,) of a line in the frame of the oscillator, at the samples of the tap that holds its frequency; None: not known."""
    if not np.isfinite(line.frequency_hz):
        return None
    if line.form not in ("tone", "force", "drifting"):
        return line.frequency_hz * carrier.time_s
    if "drive_frequency" not in carrier:
        return None
    distance_hz = line.frequency_hz - filled(carrier, "drive_frequency")
    if line.drift_hz_per_degc:
        if temperature_degc is None:
            return None
        distance_hz = distance_hz + line.drift_hz_per_degc * (temperature_degc - float(np.mean(temperature_degc)))
    return integrated(distance_hz, carrier.sample_rate_hz)


def integrated(frequency_hz: np.ndarray, rate_hz: float) -> np.ndarray:
    """Turns (n,), from zero."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (frequency_hz[1:] + frequency_hz[:-1]) / rate_hz)])


def refined(turns: np.ndarray, shown: list[np.ndarray], rate_hz: float) -> np.ndarray:
    """turns (n,) after what the line itself says in these channels (n,): its distance from them, window by window, as far as it is clear."""
    length = max(16, round(SOUGHT_S * rate_hz))
    count = len(turns) // length
    if count < 4:
        return turns
    powers, places = _about(turns, shown, rate_hz, length, count)
    top = np.argmax(powers, axis=1)
    clear = powers[np.arange(count), top] > 10.0 * np.median(powers, axis=1)
    clear &= (top > 0) & (top < len(places) - 1)
    if np.count_nonzero(clear) < 4:
        return turns
    middles = (np.arange(count) + 0.5) * length / rate_hz
    off_hz = _without_outliers(middles[clear], _parabolic(powers[clear], top[clear], places))
    return turns + integrated(np.interp(np.arange(len(turns)) / rate_hz, *off_hz), rate_hz)


def _about(turns: np.ndarray, shown: list[np.ndarray], rate_hz: float, length: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Power (count, m) in each window at these distances (m,) [Hz] from the line's place."""
    places = np.linspace(-SOUGHT_HZ, SOUGHT_HZ, 1 + 2 * round(4.0 * SOUGHT_HZ * SOUGHT_S))
    steering = np.hanning(length)[:, None] * np.exp(-2j * np.pi * np.outer(np.arange(length) / rate_hz, places))
    powers = np.zeros((count, len(places)))
    for values in shown:
        quick = _quick(np.nan_to_num(values), np.isfinite(values).astype(float), rate_hz) * np.exp(-2j * np.pi * turns)
        size = np.abs(quick[: count * length].reshape(count, length) @ steering) ** 2
        powers += size / max(float(np.median(size)), 1e-300)
    return powers, places


def _parabolic(powers: np.ndarray, top: np.ndarray, places: np.ndarray) -> np.ndarray:
    rows = np.arange(len(top))
    below, at, above = (np.log(powers[rows, top + shift]) for shift in (-1, 0, 1))
    bent = np.minimum(below + above - 2.0 * at, -1e-12)
    return places[top] + 0.5 * (below - above) / bent * (places[1] - places[0])


def _without_outliers(time_s: np.ndarray, off_hz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places that agree with the middle one of five."""
    padded = np.pad(off_hz, 2, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    good = np.abs(off_hz - middle) < 0.1
    return (time_s[good], off_hz[good]) if good.any() else (time_s[:1], np.zeros(1))


def removed(values: np.ndarray, turns: np.ndarray, rate_hz: float, cuts: np.ndarray | None = None) -> Cleaned:
    """A channel (n,) without the line at turns (n,). cuts: samples at which what passes the line on was switched, and its size jumps."""
    there, apart = np.isfinite(values), _apart(turns, rate_hz)
    known = np.nan_to_num(values)
    edges = [0, *(np.empty(0, int) if cuts is None else cuts), len(values)]
    line, weight, support = np.zeros(len(values)), np.zeros(len(values)), np.zeros(len(values))
    for first, end in pairwise(edges):
        piece = slice(first, end)
        if end - first > LEAST_S * rate_hz:
            line[piece], weight[piece], support[piece] = _line(known[piece], turns[piece], there[piece], apart[piece], rate_hz)
    before, after = (_standing(left, turns, weight, rate_hz) for left in (known, known - line))
    stood = before > STANDS
    trusted = apart & (support > SUPPORT) if stood else apart
    beside = _quick(known - line, there.astype(float), rate_hz)[weight > 0.0]
    too_strong = stood and beside.size > 0 and float(np.std(line)) > STRONGEST * float(np.median(np.abs(beside)))
    return Cleaned(np.where(trusted & stood, values - line, values), trusted, stood, after < max(STANDS, GONE * before) and not too_strong)


def _line(known: np.ndarray, turns: np.ndarray, there: np.ndarray, apart: np.ndarray, rate_hz: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The line (n,), the samples that it was taken from, and how well they support it."""
    wave = np.exp(2j * np.pi * turns)
    passed = _passed(turns, rate_hz)
    size = np.zeros(len(known), complex)
    for _ in range(ROUNDS):
        quick = _quick(known - np.real(size * wave), there.astype(float), rate_hz)
        weight = _quiet(quick, np.abs(size), there & apart, rate_hz)
        more, support = _mean(2.0 * quick * np.conj(wave) / passed, weight, rate_hz)
        size = size + more
    return np.real(size * wave), weight, support


def switched(tap: Samples) -> np.ndarray:
    """Samples before which the loop was opened or closed, or another amplitude was asked for."""
    found = np.zeros(tap.length, bool)
    if "status" in tap:
        found[1:] |= np.diff(tap.codes("status").astype(np.int64) & Status.REBALANCE_ACTIVE) != 0
    if "amplitude_set_point" in tap:
        found[1:] |= np.diff(tap.codes("amplitude_set_point").astype(np.int64)) != 0
    return np.flatnonzero(found & tap.valid & np.roll(tap.valid, 1))


def _apart(turns: np.ndarray, rate_hz: float) -> np.ndarray:
    """Samples (n,) at which the line, folded, is neither slow nor at half the rate."""
    step = np.gradient(turns)
    folded = np.abs(step - np.round(step)) * rate_hz
    return (folded > NEAREST_HZ) & (0.5 * rate_hz - folded > 0.5 * NEAREST_HZ)


def _quick(values: np.ndarray, there: np.ndarray, rate_hz: float) -> np.ndarray:
    """values (n,) without what is slow; zero where they were lost."""
    width = SLOW_S * rate_hz
    filled_part = np.maximum(gaussian_filter1d(there, width, mode="nearest"), 1e-6)
    for _ in range(TIMES):
        values = there * (values - gaussian_filter1d(values * there, width, mode="nearest") / filled_part)
    return values


def _passed(turns: np.ndarray, rate_hz: float) -> np.ndarray:
    """What `_quick` leaves of a line (n,)."""
    folded = np.gradient(turns) - np.round(np.gradient(turns))
    return np.maximum(LEAST_PASSED, (1.0 - np.exp(-2.0 * (np.pi * folded * SLOW_S * rate_hz) ** 2)) ** TIMES)


def _quiet(left: np.ndarray, size: np.ndarray, able: np.ndarray, rate_hz: float) -> np.ndarray:
    """Weights (n,): samples at which no more is left than noise and a share of the line, and not near any others."""
    if not able.any():
        return np.zeros(len(left))
    noise = 1.4826 * float(np.median(np.abs(left[able])))
    loud = able & (np.abs(left) > OUTLIER * noise + HALF * float(np.median(size[able])))
    return (able & ~maximum_filter1d(loud, 1 + 2 * round(NEAR * SLOW_S * rate_hz))).astype(float)


def _mean(values: np.ndarray, weight: np.ndarray, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Weighted means (n,) under the bells, and which part of the narrow one is filled."""
    sums, weights, near = (_under(series, rate_hz, far) for series, far in ((values * weight, FAR_WEIGHT), (weight, FAR_WEIGHT), (weight, 0.0)))
    whole = _under(np.ones(len(weight)), rate_hz, 0.0)
    return sums / np.maximum(weights.real, 1e-12), near.real / whole.real


def _under(series: np.ndarray, rate_hz: float, far: float) -> np.ndarray:
    """Means (n,) under a bell, and so much of the far one."""
    length = fft.next_fast_len(len(series) + round(4.0 * FAR_S * rate_hz))
    turns = np.abs(fft.fftfreq(length, 1.0 / rate_hz))
    near_, far_ = (np.exp(-2.0 * (np.pi * turns * width_s) ** 2) for width_s in (FOLLOWED_S, FAR_S))
    return fft.ifft(fft.fft(series, length) * (near_ + far * far_))[: len(series)]


def _standing(values: np.ndarray, turns: np.ndarray, weight: np.ndarray, rate_hz: float) -> float:
    """Power per Hz of a narrow band about the line over that of the bands beside it, at quiet samples."""
    turned = weight * _quick(values, np.ones(len(values)), rate_hz) * np.exp(-2j * np.pi * turns)
    power = np.abs(np.fft.fft(turned)) ** 2
    off = np.abs(np.fft.fftfreq(len(values), 1.0 / rate_hz))
    near, beside = off < BAND_HZ[0], (off > 2.0 * BAND_HZ[0]) & (off < BAND_HZ[1])
    return float(np.mean(power[near]) / max(float(np.mean(power[beside])), 1e-300)) if near.any() and beside.any() else 0.0
