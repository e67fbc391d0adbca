"""Narrow lines over the smooth spectrum of the secondary axis, and what they are.

vibration      moves the shell as a rate does: a line of fixed frequency in the in-phase channel, so both sidebands of the carrier alike
interference   is a tone at the pickoff: one sideband, in phase and quadrature alike and a quarter turn apart; its distance from the carrier
               changes when the carrier's frequency does, so it is sharp in a frame that does not turn with the oscillator

Each kind is scored by the likelihood of the windows' spectra with such a line against without any line, at the best of all frequencies."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from wineglass.calibration_block import Calibration
from wineglass.diagnosis import noise_windows
from wineglass.diagnosis.noise_floor import FORCES, RATE, SECONDARY, FloorModel
from wineglass.diagnosis.noise_windows import TAPERS, Windows
from wineglass.recording.reader import Tap

LEAST_BIN, FIRST_SOUND_BIN = 8, 3
"""counted from zero frequency: below, what moves slowly leaves no level to compare with; the polynomial takes the first bins' power"""
REACH_BINS = 10
OCCAM = 3.0
"""nats for a line's size and its place within a bin"""


@dataclass(frozen=True)
class Line:
    """kind: effect id, or "other"; amplitude: rad/s of a vibration, FS at the pickoff of a tone; log_evidence against no line"""

    kind: str
    frequency_hz: float
    frequency_sigma_hz: float
    amplitude: float
    amplitude_sigma: float
    log_evidence: float
    ratio: float
    height: float = 1.0
    """over the quiet parts of the spectrum; a strong line raises its own surroundings"""


@dataclass(frozen=True)
class Lines:
    """best: the best line of each kind"""

    best: dict[str, Line]
    windows: int
    notes: list[str] = field(default_factory=list)

    @property
    def log_evidence(self) -> dict[str, float]:
        return {kind: line.log_evidence for kind, line in self.best.items()}


def find(windows: Windows, calibration: Calibration, model: FloorModel) -> Lines:
    """Lines in the quiet windows of the baseband."""
    tap = windows.tap
    axis = FORCES if calibration.loop == "rebalance" else SECONDARY
    windows = windows.only(~noise_windows.has_image(windows, calibration))
    if len(windows) < noise_windows.LEAST_WINDOWS or not all(name in tap for name in (*axis, "drive_frequency")):
        return Lines({}, len(windows), ["too little quiet baseband near the nominal frequency to look for lines"])
    sign = -1.0 if axis is FORCES else 1.0  # the force in phase works against the amplitude in phase, that in quadrature along it
    z = sign * _filled(tap, axis[0]) + 1j * _filled(tap, axis[1])
    rotary, still = windows.transforms(z), windows.transforms(z, np.exp(1j * _carrier_phase(tap)))
    best = {"vibration": _vibration(windows, rotary, model, axis[0]), "interference": _interference(windows, tap, rotary, still, model, axis[0]),
            "other": _other(windows, rotary)}
    return Lines(best, len(windows))


def find_in_rate(windows: Windows, model: FloorModel) -> Lines:
    """Lines of the rate output alone: a sideband cannot be told from a rate there, so both explain a line alike."""
    if len(windows) < noise_windows.LEAST_WINDOWS:
        return Lines({}, len(windows), ["too little quiet rate to look for lines"])
    real = np.mean(np.abs(windows.transforms(_filled(windows.tap, RATE))[:, :, 1:windows.length // 2]) ** 2, axis=(0, 1))
    line = _line_of_rate(windows, real, np.zeros_like(real), model, RATE)
    tone = replace(line, kind="interference", amplitude=math.nan, amplitude_sigma=math.nan, frequency_hz=math.nan, frequency_sigma_hz=math.nan,
                   log_evidence=line.log_evidence - math.log(2.0))
    return Lines({"vibration": line, "interference": tone}, len(windows), ["a line in the rate alone may be a vibration as well as a tone"])


def taken(lines: Lines, windows: Windows, carrier: Tap | None = None, highest: float = math.inf, least: float = 6.0) -> np.ndarray:
    """Bins (n, length // 2) of each window that the best line, if there is one, stands on; a tone moves with the oscillator's frequency, which is in
    the tap `carrier`, and its own square falls on twice its distance. highest: taken for a stronger line's height, too."""
    bins = windows.frequency_hz
    found = np.zeros((len(windows), len(bins)), bool)
    real = [line for line in lines.best.values() if line.log_evidence > least]
    if not real:
        return found
    line = max(real, key=lambda item: item.log_evidence)
    place, wander = np.full(len(windows), line.frequency_hz), np.zeros(len(windows))
    if line.kind == "interference":
        place, wander = _distance_hz(line.frequency_hz, windows, windows.tap if carrier is None else carrier)
    reach = max(4.5, 2.5 * (min(line.height, highest) / 0.03) ** 0.25)  # the tapers' sides fall with the fourth power
    width = reach * windows.tap.sample_rate_hz / windows.length
    for times in (1.0, 2.0, 3.0) if line.height > 100.0 else (1.0,):
        found |= np.abs(bins - _folded(times * place, windows.tap.sample_rate_hz)[:, None]) < (width + 0.5 * times * wander)[:, None]
    return found


def _distance_hz(frequency_hz: float, windows: Windows, carrier: Tap) -> tuple[np.ndarray, np.ndarray]:
    """Mean distance from the oscillator in each window, and by how much it moves there; (n,) each."""
    drive, begin = _filled(carrier, "drive_frequency"), windows.tap.time_s[windows.first]
    first = np.searchsorted(carrier.time_s, begin)
    last = np.searchsorted(carrier.time_s, begin + windows.length / windows.tap.sample_rate_hz)
    inside = [drive[a:max(b, a + 1)] if a < len(drive) else drive[-1:] for a, b in zip(first, last)]
    return np.abs(frequency_hz - np.array([part.mean() for part in inside])), np.array([np.ptp(part) for part in inside])


def _folded(frequency_hz: np.ndarray, rate_hz: float) -> np.ndarray:
    turns = frequency_hz / rate_hz
    return np.asarray(np.abs(turns - np.round(turns)) * rate_hz)


def _filled(tap: Tap, channel: str) -> np.ndarray:
    values = tap[channel]
    sound = np.isfinite(values)
    return values if sound.all() else np.interp(tap.time_s, tap.time_s[sound], values[sound])


def _carrier_phase(tap: Tap) -> np.ndarray:
    """Phase [rad] of the oscillator against one of constant frequency, the median."""
    frequency = _filled(tap, "drive_frequency")
    turns = np.cumsum(frequency - np.median(frequency)) / tap.sample_rate_hz
    return np.asarray(2.0 * np.pi * turns)


def _score(power: np.ndarray, count: float, first: int = FIRST_SOUND_BIN - 1) -> tuple[np.ndarray, np.ndarray]:
    """Of every bin: power over the higher of the levels on both sides, so that a slope is no line, and the log likelihood ratio of a line there, both
    (m,); power: mean of `count` terms; first: of the bins that are sound."""
    size = len(power)
    around = np.empty(size)
    for at in range(size):
        left, right = power[max(first, at - REACH_BINS):max(first, at - 2)], power[at + 3:at + 3 + REACH_BINS]
        around[at] = max((float(np.median(side)) for side in (left, right) if len(side) >= 3), default=np.inf)
    ratio = power / around
    over = np.maximum(ratio, 1.0)
    return ratio, count * (over - 1.0 - np.log(over))


def _in_phase_powers(rotary: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Spectra (m,) of real and imaginary part from the complex transform, positive frequencies, mean over windows and tapers."""
    length = rotary.shape[2]
    up, down = rotary[:, :, 1:length // 2], np.conj(rotary[:, :, :length // 2:-1])
    return np.mean(np.abs(0.5 * (up + down)) ** 2, axis=(0, 1)), np.mean(np.abs(0.5 * (up - down)) ** 2, axis=(0, 1))


def _vibration(windows: Windows, rotary: np.ndarray, model: FloorModel, channel: str) -> Line:
    real, imaginary = _in_phase_powers(rotary)
    return _line_of_rate(windows, real, imaginary, model, channel)


def _line_of_rate(windows: Windows, real: np.ndarray, imaginary: np.ndarray, model: FloorModel, channel: str) -> Line:
    """The best line in the in-phase power; what stands in quadrature (zeros: not seen) speaks against a rate."""
    frequency = windows.frequency_hz[:len(real)]
    count = float(len(windows) * TAPERS) * 0.8
    ratio, score = _score(real, count)
    quadrature = _score(imaginary, count)[0] if np.any(imaginary) else np.ones_like(real)
    score = np.where(np.arange(len(score)) < LEAST_BIN - 1, -np.inf, score)
    at = int(np.argmax(score))
    gain = math.sqrt(float(model.of_rate(channel, np.ones_like)[at]) * 1.0)
    amplitude = math.sqrt(4.0 * _line_power(windows, real, ratio, at)) / max(gain, 1e-300)
    mixed = 0.0 if quadrature[at] < 1.5 else count * (quadrature[at] - 1.0 - math.log(quadrature[at]))
    evidence = float(score[at]) - math.log(len(frequency)) - OCCAM - max(0.0, mixed - 0.01 * float(score[at]))
    sigma = _sigma_hz(windows, ratio[at], count)
    return Line("vibration", _centre(frequency, real, ratio, at), sigma, amplitude, amplitude * _relative_sigma(ratio[at], count), evidence, float(ratio[at]), _height(real, at))


def _interference(windows: Windows, tap: Tap, rotary: np.ndarray, still: np.ndarray, model: FloorModel, channel: str) -> Line:
    found = []
    length = still.shape[2]
    frequency = np.fft.fftfreq(length, 1.0 / tap.sample_rate_hz)
    count = float(len(windows) * TAPERS) * 0.8
    for transforms in (still, rotary):
        power = np.fft.fftshift(np.mean(np.abs(transforms) ** 2, axis=(0, 1)))
        place = np.fft.fftshift(frequency)
        ratio, score = _score(power, count, 0)
        score = np.where(np.abs(place) < (LEAST_BIN - 0.5) * tap.sample_rate_hz / length, -np.inf, score)
        at = int(np.argmax(score))
        found.append((float(score[at]) - math.log(length) - OCCAM, _centre(place, power, ratio, at), float(ratio[at]),
                      _line_power(windows, power, ratio, at), _height(power, at)))
    evidence, offset, ratio_at, power_at, height = max(found)
    answer = math.sqrt(float(model.of_tone(channel, np.array([offset]))[0]))
    amplitude = math.sqrt(power_at) / max(answer, 1e-300)
    carrier = float(np.median(_filled(tap, "drive_frequency")))
    return Line("interference", carrier + offset, _sigma_hz(windows, ratio_at, count), amplitude, amplitude * _relative_sigma(ratio_at, count),
                evidence, ratio_at, height)


def _other(windows: Windows, rotary: np.ndarray) -> Line:
    """A line in quadrature alone: of neither kind."""
    _, imaginary = _in_phase_powers(rotary)
    frequency = windows.frequency_hz[:len(imaginary)]
    count = float(len(windows) * TAPERS) * 0.8
    ratio, score = _score(imaginary, count)
    score = np.where(np.arange(len(score)) < LEAST_BIN - 1, -np.inf, score)
    at = int(np.argmax(score))
    return Line("other", float(frequency[at]), _sigma_hz(windows, ratio[at], count), math.nan, math.nan,
                float(score[at]) - math.log(len(frequency)) - OCCAM - 4.0, float(ratio[at]))


def _line_power(windows: Windows, power: np.ndarray, ratio: np.ndarray, at: int) -> float:
    """Power of the line: what its bins have over the level around them, times a bin's width."""
    near = slice(max(0, at - 3), at + 4)
    extra = power[near] * (1.0 - 1.0 / np.maximum(ratio[near], 1.0))
    return float(np.sum(extra)) * windows.tap.sample_rate_hz / windows.length


def _height(power: np.ndarray, at: int) -> float:
    return float(power[at] / np.quantile(power, 0.1))


def _centre(place_hz: np.ndarray, power: np.ndarray, ratio: np.ndarray, at: int) -> float:
    """Centre of gravity [Hz] of what the line's bins have over the level around them."""
    near = slice(max(0, at - 3), at + 4)
    extra = power[near] * (1.0 - 1.0 / np.maximum(ratio[near], 1.0))
    return float(np.sum(extra * place_hz[near]) / np.sum(extra)) if np.sum(extra) > 0 else float(place_hz[at])


def _sigma_hz(windows: Windows, ratio: float, count: float) -> float:
    return float(windows.tap.sample_rate_hz / windows.length * max(0.02, 0.5 / math.sqrt(max(1.0, (ratio - 1.0) * count))))


def _relative_sigma(ratio: float, count: float) -> float:
    return float(max(0.04, 0.5 * ratio / max(ratio - 1.0, 1e-3) / math.sqrt(count)))
