"""Narrow lines over the smooth spectrum, and what they are.

    a rate              both sidebands of the carrier alike, in phase alone, at a fixed distance                  vibration
    a force             one sideband, at a fixed frequency; the shell answers the less, the farther it is         vibration
    a tone              one sideband, at a fixed frequency or one that follows the temperature                    interference
    swinging samples    the primary's quadrature alone                                                            clock_jitter
    a line that goes where neither a structure nor an oscillator goes (noise_tracks.py)                           other
    none of these                                                                                                 other

A tone's distance from the carrier changes when the carrier's frequency does, so it is sharp in a frame that does not turn with the oscillator. Each
kind is scored by the likelihood of the windows' spectra with such a line against without any line, at the best of all frequencies. The strongest
line is taken out, and a second one looked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wineglass.calibration_block import Calibration
from wineglass.diagnosis import noise_tracks, noise_windows
from wineglass.diagnosis.line_spectra import LEAST_BIN, Spectra, score, usual
from wineglass.diagnosis.noise_floor import FORCES, PRIMARY, RATE, SECONDARY, FloorModel
from wineglass.diagnosis.noise_tracks import Track
from wineglass.diagnosis.noise_windows import Windows
from wineglass.recording.reader import Tap

OCCAM = 3.0
"""nats for a line's size and its place within a bin"""
UNUSUAL = {"force": 2.0, "drifting": 2.0, "other": 4.0}
"""nats for forms that are rarer"""
CLEAR = 6.0
MOST = 2
STRONG, STEADY = 30.0, 0.3
"""height of a line that shows beside itself; turns by which one may slip in a window"""
ECHO_RATIO = 0.03
"""a line whose height on one axis is below this part of that on the other is the other's echo"""
LARGEST_DRIFT_HZ_PER_DEGC, LEAST_SPAN_DEGC = 0.5, 5.0
FORM_SIGMA, MIRROR = 0.1, 0.1
"""relative, of a line's power in one window; of the other side's power that coupling and gains may leave"""
TWO_SIDED, REFUTED = 0.3, -5.0
"""part of the windows with a line on both sides of the carrier that refutes a tone"""
SHARPER, MOSTLY = 1.5, 0.6
"""by which a line must rise more in a frame that follows the temperature; part of the windows that must show it"""


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
    form: str = ""
    drift_hz_per_degc: float = 0.0
    axis: str = "secondary"
    distance_hz: float = math.nan
    """from the carrier, in the mean"""
    track: Track | None = field(default=None, compare=False, repr=False)
    """where it stands, of a line that goes its own way"""


@dataclass(frozen=True)
class Lines:
    """found: one dictionary per line, of what it would be as each kind; the strongest first"""

    found: list[dict[str, Line]]
    windows: int
    notes: list[str] = field(default_factory=list)

    @property
    def best(self) -> dict[str, Line]:
        """The best line of each kind."""
        kinds = {kind for item in self.found for kind in item}
        return {kind: max((item[kind] for item in self.found if kind in item), key=lambda line: line.log_evidence) for kind in sorted(kinds)}

    @property
    def log_evidence(self) -> dict[str, float]:
        return {kind: line.log_evidence for kind, line in self.best.items()}

    @property
    def clear(self) -> list[Line]:
        """The lines that are there, each as what it most probably is."""
        best = [max(item.values(), key=lambda line: line.log_evidence) for item in self.found if item]
        return [line for line in best if line.log_evidence > CLEAR]


def find(windows: Windows, calibration: Calibration, model: FloorModel, temperature_degc: np.ndarray | None = None) -> Lines:
    """Lines in the quiet windows of the baseband. temperature_degc: at the tap's samples, (n,)"""
    tap = windows.tap
    axis = FORCES if calibration.loop == "rebalance" else SECONDARY
    if len(windows) < noise_windows.LEAST_WINDOWS or not all(name in tap for name in (*axis, "drive_frequency")):
        return Lines([], len(windows), ["too little quiet baseband to look for lines"])
    search = _Search(windows, calibration, model, axis, temperature_degc)
    found = search.astray()
    for _ in range(MOST):
        item = search.next(found)
        found.append(item)
        if max(line.log_evidence for line in item.values()) < CLEAR:
            break
    return Lines(found, len(windows))


def find_in_rate(windows: Windows, model: FloorModel) -> Lines:
    """Lines of the rate output alone: a sideband cannot be told from a rate there, so both explain a line alike."""
    if len(windows) < noise_windows.LEAST_WINDOWS:
        return Lines([], len(windows), ["too little quiet rate to look for lines"])
    real = np.abs(windows.transforms(filled(windows.tap, RATE))[:, :, 1:windows.length // 2]) ** 2
    line = _line_of_rate(windows, real.mean(axis=1), None, model, RATE)
    tone = replace(line, kind="interference", amplitude=math.nan, amplitude_sigma=math.nan, frequency_hz=math.nan, frequency_sigma_hz=math.nan,
                   log_evidence=line.log_evidence - math.log(2.0))
    return Lines([{"vibration": line, "interference": tone}], len(windows), ["a line in the rate alone may be a vibration as well as a tone"])


def taken(lines: Lines, windows: Windows, carrier: Tap | None = None, temperature_degc: np.ndarray | None = None, highest: float = math.inf) -> np.ndarray:
    """Bins (n, length // 2) of each window that a line stands on; a tone moves with the oscillator's frequency, which is in the tap `carrier`, and its
    own square falls on twice its distance. highest: taken for a stronger line's height, too."""
    found = np.zeros((len(windows), windows.length // 2), bool)
    for line in lines.clear:
        found |= _taken(line, windows, windows.tap if carrier is None else carrier, temperature_degc, highest)
    return found


def without(values: np.ndarray, lines: Lines, windows: Windows, carrier: Tap, temperature_degc: np.ndarray | None) -> tuple[np.ndarray, bool]:
    """A channel (n,) without the strong lines in its windows, since a polynomial does not leave them alone; and whether that could be done: a line
    whose phase is not known within a window stays."""
    left, done = values.copy(), True
    length = windows.length
    slow = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, length), windows.order)
    for line in lines.clear:
        if line.height < STRONG:
            continue
        turns, known = _turns(line, windows, carrier, temperature_degc)
        done &= known
        for first in windows.first if known else []:
            piece = slice(first, first + length)
            wave = np.exp(2j * np.pi * turns[piece])[:, None] * slow[:, :2]  # its size may change, too
            design = np.column_stack([wave.real, wave.imag, slow])
            left[piece] -= design[:, :4] @ np.linalg.lstsq(design, left[piece], rcond=None)[0][:4]
    return left, done


def _turns(line: Line, windows: Windows, carrier: Tap, temperature_degc: np.ndarray | None) -> tuple[np.ndarray, bool]:
    """Phase (n,) of a line at the samples of the windows' tap, and whether it is known: a thermometer tells a frequency too late for a phase where that
    moves much."""
    tap = windows.tap
    if line.track is not None or not math.isfinite(line.frequency_hz):
        return np.zeros(len(tap)), False
    if line.form not in ("tone", "force", "drifting"):
        return line.frequency_hz * tap.time_s, True
    away, known = line.frequency_hz - filled(carrier, "drive_frequency"), True
    if line.drift_hz_per_degc and temperature_degc is not None:
        drift = line.drift_hz_per_degc * (temperature_degc - float(np.mean(temperature_degc)))
        away = away + drift
        known = float(np.median(_in_windows(drift, windows, carrier)[1])) * windows.length / tap.sample_rate_hz < STEADY
    turns = np.concatenate([[0.0], np.cumsum(0.5 * (away[1:] + away[:-1]) * np.diff(carrier.time_s))])
    return np.interp(tap.time_s, carrier.time_s, turns), known


def _places(line: Line, windows: Windows, carrier: Tap, temperature_degc: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Distance of a line from the oscillator in each window, and by how much it moves there [Hz]; (n,) each."""
    if line.track is not None:
        return np.interp(windows.time_s, line.track.time_s, line.track.place_hz), np.interp(windows.time_s, line.track.time_s, line.track.reach_hz)
    if line.form not in ("tone", "force", "drifting") or not math.isfinite(line.frequency_hz):
        return np.full(len(windows), line.frequency_hz), np.zeros(len(windows))
    moved = filled(carrier, "drive_frequency")
    if line.drift_hz_per_degc and temperature_degc is not None:
        moved = moved - line.drift_hz_per_degc * (temperature_degc - float(np.mean(temperature_degc)))
    mean, wander = _in_windows(moved, windows, carrier)
    return np.abs(line.frequency_hz - mean), wander


def _taken(line: Line, windows: Windows, carrier: Tap, temperature_degc: np.ndarray | None, highest: float) -> np.ndarray:
    bins, rate_hz = windows.frequency_hz, windows.tap.sample_rate_hz
    found = np.zeros((len(windows), len(bins)), bool)
    place, wander = _places(line, windows, carrier, temperature_degc)
    reach = max(4.5, 2.5 * (min(line.height, highest) / 0.03) ** 0.25)  # the tapers' sides fall with the fourth power
    width = reach * rate_hz / windows.length
    for times in (1.0, 2.0, 3.0) if line.height > STRONG else (1.0,):
        found |= np.abs(bins - _folded(times * place, rate_hz)[:, None]) < (width + 0.5 * times * wander)[:, None]
    return found


def _in_windows(values: np.ndarray, windows: Windows, carrier: Tap) -> tuple[np.ndarray, np.ndarray]:
    """Mean in each window, and by how much it moves there; (n,) each."""
    begin = windows.tap.time_s[windows.first]
    first = np.searchsorted(carrier.time_s, begin)
    last = np.searchsorted(carrier.time_s, begin + windows.length / windows.tap.sample_rate_hz)
    inside = [values[a:max(b, a + 1)] if a < len(values) else values[-1:] for a, b in zip(first, last, strict=True)]
    return np.array([part.mean() for part in inside]), np.array([np.ptp(part) for part in inside])


def _folded(frequency_hz: np.ndarray, rate_hz: float) -> np.ndarray:
    turns = frequency_hz / rate_hz
    return np.asarray(np.abs(turns - np.round(turns)) * rate_hz)


def filled(tap: Tap, channel: str) -> np.ndarray:
    """A channel (n,), straight across lost samples."""
    values = tap[channel]
    sound = np.isfinite(values)
    return values if sound.all() else np.interp(tap.time_s, tap.time_s[sound], values[sound])


class _Search:
    """Both axes of one recording's quiet windows."""

    def __init__(self, windows: Windows, calibration: Calibration, model: FloorModel, axis: Sequence[str], temperature_degc: np.ndarray | None):
        tap = windows.tap
        self._windows, self._model, self._channel = windows, model, axis[0]
        self._carrier = filled(tap, "drive_frequency")
        self._temperature = temperature_degc
        sign = -1.0 if axis is FORCES else 1.0  # the force in phase works against the amplitude in phase, that in quadrature along it
        images = noise_windows.image_bins(windows, calibration, 4)
        self._second = Spectra.of(windows, sign * filled(tap, axis[0]) + 1j * filled(tap, axis[1]), self._carrier, model.of_white(axis[0]), images)
        self._first = None
        if all(name in tap for name in PRIMARY):
            white = [model.of_white(name) for name in PRIMARY]
            self._first = Spectra.of(windows, filled(tap, PRIMARY[0]) + 1j * filled(tap, PRIMARY[1]), self._carrier, np.maximum(*white), images)

    def next(self, found: list[dict[str, Line]]) -> dict[str, Line]:
        """The strongest line beside those found, as each kind."""
        clear = Lines(found, len(self._windows)).clear
        mask = np.zeros((len(self._windows), self._windows.length // 2), bool)
        for line in clear:
            mask |= _taken(line, self._windows, self._windows.tap, self._temperature, math.inf)
        second = self._second.without(mask)
        item = self._of_secondary(second)
        if self._first is not None:
            item = self._joined(item, self._of_primary(self._first.without(mask)))
        return item

    def astray(self) -> list[dict[str, Line]]:
        """The strong line that goes its own way, if there is one; what it would be if it did not is worth so much less."""
        wander = _in_windows(self._carrier, self._windows, self._windows.tap)[1]
        found = noise_tracks.peaks(self._second.folded(), self._windows.frequency_hz[:self._windows.length // 2 - 1], self._windows.time_s, wander)
        degc = None if self._temperature is None else _in_windows(self._temperature, self._windows, self._windows.tap)[0]
        track = noise_tracks.follow(found, self._middles(), degc, 0.5 * self._windows.tap.sample_rate_hz)
        if track is None:
            return []
        height = float(np.median(track.height[found.strong]))
        line = Line("other", float(np.median(track.place_hz)), math.nan, math.nan, math.nan, track.log_evidence, height, height, track.form, track=track)
        usual = {kind: replace(other, log_evidence=track.log_evidence - track.margin) if other.log_evidence > CLEAR else other
                 for kind, other in self._of_secondary(self._second).items() if kind != "other"}
        return [usual | {"other": line}]

    def _joined(self, second: dict[str, Line], first: dict[str, Line]) -> dict[str, Line]:
        """Of the axis on which the line stands higher; on both alike it is a tone at both pickoffs, or two lines."""
        tops = [max(item.values(), key=lambda line: line.log_evidence) for item in (second, first)]
        if tops[1].log_evidence < CLEAR or tops[1].height < tops[0].height:
            return second
        if tops[0].log_evidence < CLEAR or tops[0].height < ECHO_RATIO * tops[1].height:
            return first | {kind: replace(line, log_evidence=min(line.log_evidence, 0.0)) for kind, line in second.items() if kind not in first}
        return second if tops[0].kind == "interference" else first | {k: v for k, v in second.items() if k not in first}

    # ---- the secondary axis -----------------------------------------------------------------------------------------------------------

    def _of_secondary(self, spectra: Spectra) -> dict[str, Line]:
        real, imaginary = spectra.parts()
        rate = _line_of_rate(self._windows, real, imaginary, self._model, self._channel)
        tone, force = self._tones(spectra, self._channel)
        vibration = max(rate, force, key=lambda line: line.log_evidence)
        drifting = self._drifting(spectra, SHARPER * max(rate.ratio, tone.ratio))
        return {"vibration": vibration, "interference": max(tone, drifting, key=lambda line: line.log_evidence),
                "other": self._part_alone(imaginary, "other", "quadrature")}

    def _tones(self, spectra: Spectra, channel: str) -> tuple[Line, Line]:
        """The best single sideband at a fixed frequency, as a tone at the pickoff and as a force on the shell."""
        line = self._sideband(spectra, channel, 0.0, "tone", 1)
        electrical, mechanical, both_sides = self._forms(spectra, channel, line.frequency_hz - self._middles())
        better = max(electrical, mechanical)
        line = replace(line, log_evidence=max(line.log_evidence - both_sides, min(line.log_evidence, REFUTED)))
        tone = replace(line, log_evidence=line.log_evidence + electrical - better)
        answer = float(np.mean(self._model.rate_answer(np.maximum(np.abs(line.frequency_hz - self._middles()), 1e-3))))
        gain = abs(self._model.rate_gain(channel)) * answer
        force = replace(line, kind="vibration", form="force", amplitude=self._power_root(line, channel) / max(gain, 1e-300),
                        log_evidence=line.log_evidence + mechanical - better - UNUSUAL["force"])
        return tone, replace(force, amplitude_sigma=0.3 * force.amplitude)

    def _power_root(self, line: Line, channel: str) -> float:
        """Amplitude [FS of the channel] of a tone's line."""
        offset = line.frequency_hz - float(np.median(self._carrier))
        return line.amplitude * math.sqrt(float(self._model.of_tone(channel, np.array([offset]))[0]))

    def _middles(self) -> np.ndarray:
        return _in_windows(self._carrier, self._windows, self._windows.tap)[0]

    def _forms(self, spectra: Spectra, channel: str, offset: np.ndarray) -> tuple[float, float, float]:
        """Log likelihoods of the line's powers over the windows, its distance (n,) from the carrier changing: of a tone, and of a force; and what is
        against both where the other side of the carrier shows a line, too."""
        power, noise, mirror = spectra.powers_at(offset)
        sound = np.isfinite(power) & (power > 3.0 * noise)
        if np.count_nonzero(sound) < 4:
            return 0.0, 0.0, 0.0
        twice = np.count_nonzero(mirror[sound] > MIRROR * power[sound] + 6.0 * noise[sound])
        sigma = np.sqrt(FORM_SIGMA**2 + 2.0 * noise[sound] / power[sound])
        found = []
        for answer in (self._model.of_tone(channel, offset[sound]), self._model.rate_answer(np.abs(offset[sound])) ** 2):
            rest = np.log(power[sound]) - np.log(answer)
            middle = np.sum(rest / sigma**2) / np.sum(sigma**-2)
            found.append(float(-0.5 * np.sum(np.minimum(((rest - middle) / sigma) ** 2, 16.0))))
        return found[0], found[1], math.inf if twice > TWO_SIDED * np.count_nonzero(sound) else 0.0

    def _sideband(self, spectra: Spectra, channel: str, drift: float, form: str, trials: int) -> Line:
        """The sharpest line in a frame that stands still, or moves with the temperature."""
        frame = self._carrier - float(np.median(self._carrier))
        if drift and self._temperature is not None:
            frame = frame - drift * (self._temperature - float(np.mean(self._temperature)))
        place, power, count = spectra.in_frame(frame)
        ratio, scores = score(power, count, round=True)
        at = int(np.argmax(scores))
        offset = _centre(place, power, ratio, at)
        answer = float(self._model.of_tone(channel, np.array([offset]))[0])
        amplitude = math.sqrt(_line_power(self._windows, power, ratio, at) / max(answer, 1e-300))
        evidence = float(scores[at]) - math.log(len(place) * trials) - OCCAM
        return Line("interference", float(np.median(self._carrier)) + offset, _sigma_hz(self._windows, ratio[at], count[at]), amplitude,
                    amplitude * _relative_sigma(ratio[at], count[at]), evidence, float(ratio[at]), _height(power, at), form, drift, distance_hz=abs(offset))

    def _drifting(self, spectra: Spectra, least_ratio: float) -> Line:
        """A tone whose frequency follows the temperature: the best of a row of slopes; least_ratio: what it must be better than."""
        nothing = Line("interference", math.nan, math.nan, math.nan, math.nan, -10.0, 1.0, form="drifting")
        if self._temperature is None:
            return nothing
        degc = _in_windows(self._temperature, self._windows, self._windows.tap)[0]
        span = float(np.ptp(degc))
        if span < LEAST_SPAN_DEGC:
            return nothing
        step = 1.5 * self._windows.tap.sample_rate_hz / self._windows.length / (0.5 * span)
        slopes = step * np.arange(-int(LARGEST_DRIFT_HZ_PER_DEGC / step), int(LARGEST_DRIFT_HZ_PER_DEGC / step) + 1)
        shift = self._middles() - float(np.median(self._carrier))
        tops = [spectra.top_of_shifted(shift - slope * (degc - float(np.mean(self._temperature)))) for slope in slopes]
        best = float(slopes[int(np.argmax(tops))])
        fine = [self._sideband(spectra, self._channel, slope, "drifting", len(slopes)) for slope in best + step * np.array([-0.5, 0.0, 0.5])]
        line = max(fine, key=lambda item: item.log_evidence)
        if line.ratio < least_ratio:
            return nothing
        electrical, mechanical, both_sides = self._forms(spectra, self._channel, self._offsets(line, degc))
        power, noise, _ = spectra.powers_at(self._offsets(line, degc))
        seen = np.isfinite(power)
        if both_sides > 0.0 or np.count_nonzero(power[seen] > 2.5 * noise[seen]) < MOSTLY * np.count_nonzero(seen):
            return nothing
        return replace(line, log_evidence=line.log_evidence + min(0.0, electrical - mechanical) - UNUSUAL["drifting"])

    def _offsets(self, line: Line, degc: np.ndarray) -> np.ndarray:
        """Distance of a drifting line from the carrier in each window, (n,)."""
        mean = float(np.mean(self._temperature)) if self._temperature is not None else 0.0
        return line.frequency_hz + line.drift_hz_per_degc * (degc - mean) - self._middles()

    def _part_alone(self, powers: np.ndarray, kind: str, form: str, axis: str = "secondary") -> Line:
        """A line in one quadrature; powers: (windows, m)."""
        power, count = usual(powers)
        ratio, scores = score(power, count, LEAST_BIN - 1)
        at = int(np.argmax(scores))
        frequency = self._windows.frequency_hz[:len(power)]
        evidence = float(scores[at]) - math.log(len(power)) - OCCAM - UNUSUAL.get(kind, 0.0)
        return Line(kind, _centre(frequency, power, ratio, at), _sigma_hz(self._windows, ratio[at], count[at]), math.nan, math.nan, evidence,
                    float(ratio[at]), _height(power, at), form, axis=axis)

    # ---- the primary axis ---------------------------------------------------------------------------------------------------------------

    def _of_primary(self, spectra: Spectra) -> dict[str, Line]:
        """In quadrature alone the instants swing, in phase alone something else does; a sideband is a tone at both pickoffs."""
        real, imaginary = spectra.parts()
        swing, breath = self._part_alone(imaginary, "clock_jitter", "swing", "primary"), self._part_alone(real, "other", "in phase", "primary")
        if breath.log_evidence > 0.1 * swing.log_evidence:  # both: neither alone
            swing = replace(swing, log_evidence=min(swing.log_evidence - breath.log_evidence, 0.0))
        tone = replace(self._sideband(spectra, PRIMARY[0], 0.0, "tone", 1), axis="primary")
        return {"clock_jitter": swing, "other": breath, "interference": tone}


def _line_of_rate(windows: Windows, real: np.ndarray, imaginary: np.ndarray | None, model: FloorModel, channel: str) -> Line:
    """The best line in the in-phase power; what stands in quadrature (None: not seen) speaks against a rate. real, imaginary: (windows, m)"""
    power, count = usual(real)
    frequency = windows.frequency_hz[:len(power)]
    ratio, scores = score(power, count, LEAST_BIN - 1)
    at = int(np.argmax(scores))
    against = 1.0
    if imaginary is not None:
        against = float(score(*usual(imaginary), LEAST_BIN - 1)[0][at])
    gain = math.sqrt(float(model.of_rate(channel, np.ones_like)[at]))
    amplitude = math.sqrt(4.0 * _line_power(windows, power, ratio, at)) / max(gain, 1e-300)
    mixed = 0.0 if against < 1.5 else float(count[at]) * (against - 1.0 - math.log(against))
    evidence = float(scores[at]) - math.log(len(frequency)) - OCCAM - max(0.0, mixed - 0.01 * float(scores[at]))
    return Line("vibration", _centre(frequency, power, ratio, at), _sigma_hz(windows, ratio[at], count[at]), amplitude,
                amplitude * _relative_sigma(ratio[at], count[at]), evidence, float(ratio[at]), _height(power, at), "rate")


def _near(ratio: np.ndarray, at: int) -> slice:
    return slice(max(0, at - 3), at + 4)


def _line_power(windows: Windows, power: np.ndarray, ratio: np.ndarray, at: int) -> float:
    """Power of the line: what its bins have over the level around them, times a bin's width."""
    near = _near(ratio, at)
    extra = np.nan_to_num(power[near] * (1.0 - 1.0 / np.maximum(ratio[near], 1.0)))
    return float(np.sum(extra)) * windows.tap.sample_rate_hz / windows.length


def _height(power: np.ndarray, at: int) -> float:
    return float(power[at] / np.nanquantile(power, 0.1)) if np.any(np.isfinite(power)) else 1.0


def _centre(place_hz: np.ndarray, power: np.ndarray, ratio: np.ndarray, at: int) -> float:
    """Centre of gravity [Hz] of what the line's bins have over the level around them."""
    near = _near(ratio, at)
    extra = np.nan_to_num(power[near] * (1.0 - 1.0 / np.maximum(ratio[near], 1.0)))
    return float(np.sum(extra * place_hz[near]) / np.sum(extra)) if np.sum(extra) > 0 else float(place_hz[at])


def _sigma_hz(windows: Windows, ratio: float, count: float) -> float:
    return float(windows.tap.sample_rate_hz / windows.length * max(0.02, 0.5 / math.sqrt(max(1.0, (ratio - 1.0) * count))))


def _relative_sigma(ratio: float, count: float) -> float:
    return float(max(0.04, 0.5 * ratio / max(ratio - 1.0, 1e-3) / math.sqrt(max(count, 1.0))))
