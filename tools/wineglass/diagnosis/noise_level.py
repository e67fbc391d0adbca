"""Everything that noise, lines, single events and raw codes say about effects, as one piece of evidence beside the slow channels' own.

    evidence = examine(recording, device)
    evidence.log_evidence[frozenset({"clock_jitter"})]       # against none

Independent looks, added up: broadband spectra (noise_spectra.py), lines (noise_lines.py), jumps of phase (noise_events.py), steps of the thermometer
(thermometer_codes.py), raw codes (raw_codes.py), and whether the output is what the firmware makes of its input (replay.py, output_check.py)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from wineglass import device as devices
from wineglass.calibration_block import Calibration, from_binary
from wineglass.device import Device
from wineglass.diagnosis import curve_of_codes, noise_added, noise_events, noise_floor, noise_lines, noise_spectra, noise_trend, noise_windows, output_check, raw_codes, replay, thermometer_codes
from wineglass.diagnosis.noise_events import Events
from wineglass.diagnosis.noise_floor import FORCES, PRIMARY, RATE, SECONDARY, FloorModel, Pickoff
from wineglass.diagnosis.noise_lines import Lines
from wineglass.diagnosis.noise_spectra import Band, SpectralEvidence
from wineglass.diagnosis.output_check import OutputCheck
from wineglass.diagnosis.raw_codes import RawEvidence
from wineglass.diagnosis.replay import Replay
from wineglass.diagnosis.thermometer_codes import Steps
from wineglass.diagnosis.vocabulary import FLICKER, OTHER
from wineglass.errors import BadInput
from wineglass.recording.reader import Recording, Tap
from wineglass.scenario import Run

EFFECTS = ("excess_noise", "flicker_noise", "clock_jitter", "dropped_samples", "interference", "vibration", "thermometer_quantisation",
           "adc_saturation", "adc_nonlinearity", "firmware_mismatch")
LARGEST_SUPPORT, LARGEST_BROADBAND = 3, 2
"""effects in a set, and among them those that raise the noise"""
ENOUGH = 100.0
"""nats: beyond this certainty is certainty, and sums stay comparable"""
SURE = 6.0
ECHO = 100.0
"""height of a line as far as the primary can show it"""
BURIED = 300.0
"""height of a line whose sides move noise's level"""
ANYTHING = ("dropped_samples", "adc_saturation", "adc_nonlinearity", "thermometer_quantisation")
"""effects whose jolts, stairs or beats with the sampling may raise any spectrum anywhere: beside them spectra and lines blame nobody else"""
ONE_SIDED = 4.0
"""nats: something unknown need not raise both quadratures of an axis alike"""
FORM_ERROR = 0.4
"""relative, of a band: by which an effect's spectrum may be of another form than its model; what misses the spectrum by more is not it, however loud it is"""
STALE_S, DECAYS = 0.5, 16.0
INTERVAL_S, STAIR = 0.02, 1.5
"""events are known to an interval of the baseband, of the slowest one that is usual, and all of them are off alike: what one stair does at worst to the slope of a line through it"""
_CURVES = frozenset({"adc_saturation", "adc_nonlinearity"})
OTHER_PENALTY = 4.0

Parameter = tuple[str, float, tuple[float, float], str]


@dataclass(frozen=True)
class NoiseEvidence:
    """log_evidence: of each set of up to three effects (or "other") against none, likelihood only; where: stage, channel, component, ratio over the floor,
    region"""

    log_evidence: dict[frozenset[str], float]
    where: list[tuple[str, str, str, float, str]]
    notes: list[str]
    replay: Replay | None
    output: OutputCheck | None
    spectral: SpectralEvidence | None
    lines: Lines | None
    events: Events | None
    steps: Steps | None
    raw: RawEvidence | None
    looks: dict[str, list[str]] = field(default_factory=dict)
    """per effect: which looks could have seen it in this recording; an effect without any is not excluded by silence"""
    _parameters: dict[str, list[Parameter]] = field(default_factory=dict)

    def parameters(self, effect_id: str) -> list[Parameter]:
        """name, value, 95 % interval, unit; in the catalogue's names"""
        return self._parameters.get(effect_id, [])

    @property
    def stairs(self) -> Steps | None:
        """Of the thermometer, where its readings show coarse ones."""
        return self.steps if self.steps is not None and self.steps.coarse else None

    def added(self, effects: frozenset[str]) -> noise_added.Added:
        """What these effects' noise, as strong as the spectra say, does to slow channels: densities for their floors, and the bias' own wander."""
        added = noise_added.of(self.spectral.estimates if self.spectral is not None else {}, effects)
        unread_fs = curve_of_codes.unread_fs(self.raw.bursts) if self.raw is not None and "adc_nonlinearity" in effects else 0.0
        return replace(added, strengths={**added.strengths, noise_added.UNREAD: unread_fs}) if unread_fs > 0.0 else added

    def disturbed_s(self, decay_per_s: float) -> list[tuple[float, float]]:
        """Spans in which single events shake slow channels, or may do so unseen: a wrong sample misleads the loops, a jump of phase moves the shell until it
        has decayed."""
        if self.events is None:
            return []
        found = [(event.time_s - 0.1, event.time_s + (STALE_S if event.stale else DECAYS / decay_per_s)) for event in self.events.found]
        jumps = any(not event.stale for event in self.events.found)
        if self.events.found:  # where samples are lost or wrong, others may be whose phase comes back: a whole turn's, or one that the amplitude does not show
            found += [(time_s - STALE_S, time_s + STALE_S) for time_s in self.events.spikes_s]
        return found + [(begin, end + (DECAYS / decay_per_s if jumps else STALE_S)) for begin, end in self.events.hidden_s]

    def forget(self, without: frozenset[str]) -> NoiseEvidence:
        """The same with effects taken out of the catalogue (for tests of honesty)."""
        return replace(self, log_evidence={chosen: value for chosen, value in self.log_evidence.items() if not chosen & without}) if without else self

    @property
    def named(self) -> list[str]:
        """Effects of the best set, if it is better than none by three nats."""
        best = max(self._worth, key=lambda chosen: self._worth[chosen])
        return sorted(best) if self._worth[best] > 3.0 else []

    @property
    def within_reach(self) -> frozenset[str]:
        """Effects of all sets that are not much worse than the best, and that would be without them."""
        best = max(self._worth.values())
        return frozenset(effect for chosen, worth in self._worth.items() if worth > best - SURE for effect in chosen
                         if self.log_evidence[chosen] > self.log_evidence.get(chosen - {effect}, -np.inf))

    @property
    def _worth(self) -> dict[frozenset[str], float]:
        """Nats, two of them paid for every effect."""
        return {chosen: value - 2.0 * len(chosen) for chosen, value in self.log_evidence.items()}


def examine(recording: Recording, device: Device | Run | None = None, slow_model: Mapping[str, np.ndarray] | None = None) -> NoiseEvidence:
    """device: None takes the recording's own description. slow_model: slow content of baseband channels as another model predicts it, (n,) each."""
    described, calibration, notes = _setting(recording, device)
    again = replay.check(recording)
    output = output_check.check(recording)
    steps = thermometer_codes.find(recording, described) if described is not None else None
    events = noise_events.find(recording)
    raw = raw_codes.examine(recording, described, None if events is None else events.times_s) if described is not None else None
    spectral, lines, trends, switches = _telemetry(recording, described, calibration, events, steps, dict(slow_model or {}), notes)
    looks = _Looks(again, output, spectral, lines, events, steps, raw, trends, switches)
    for part in (again.not_checked if again.ok is None else [], output.not_checked, spectral.notes if spectral else [], lines.notes if lines else [],
                 raw.notes if raw else []):
        notes += part
    return NoiseEvidence(looks.log_evidence(), looks.where(), list(dict.fromkeys(notes)), again, output, spectral, lines, events, steps, raw, looks.seen(),
                         looks.parameters())


def _setting(recording: Recording, device: Device | Run | None) -> tuple[Device | None, Calibration | None, list[str]]:
    notes: list[str] = []
    described = device.device if isinstance(device, Run) else device
    if described is None and recording.device_toml:
        described = devices.loads(recording.device_toml)
    if described is None:
        notes.append("without a device description there is no noise floor to compare with")
    block, wrong = replay.block_of(recording)
    notes += wrong
    try:
        calibration = from_binary(block) if block else None
    except BadInput as error:
        calibration = None
        notes.append(f"the recorded calibration cannot be read ({error.what})")
    return described, calibration, notes


def _telemetry(recording: Recording, device: Device | None, calibration: Calibration | None, events: Events | None, steps: Steps | None,
               slow: dict[str, np.ndarray], notes: list[str]) -> tuple[SpectralEvidence | None, Lines | None, list[noise_trend.Trend], bool]:
    """Spectra and lines of baseband and rate; the last: the rate switches."""
    if device is None or calibration is None:
        notes.append("no description or no calibration: the spectra say nothing")
        return None, None, [], False
    seen = _Seen(recording, device, calibration, events.times_s if events is not None else np.empty(0), steps, slow)
    bands: list[Band] = []
    lines: Lines | None = None
    try:
        if "baseband" in recording and "drive_frequency" in recording.tap("baseband"):
            found, lines = seen.baseband()
            low: list[Band] = []
            if noise_windows.knows_rate(recording):
                low = seen.rate(noise_spectra.LOW_LENGTH_S, noise_spectra.LOW_TO_HZ, lines)
            else:
                notes.append("no true rate: a bias that wanders cannot be told from a base that turns")
            if seen.restless:
                notes.append("what is slow in the rate comes and goes, and no noise does that: it is left to the slow channels")
            if seen.switches:
                notes.append("what is slow in the rate stands still and jumps, and no noise does that: it is left to the slow channels")
                found = noise_spectra.without_rate(found)
            bands = [*noise_spectra.without_low(found, noise_spectra.SLOW_TO_HZ if seen.restless else noise_spectra.LOW_TO_HZ), *low]
        else:
            notes.append("no baseband with the drive's frequency: only the rate's own spectrum can be looked at, and no axis told from the other")
            lines = seen.rate_lines()
            bands = seen.rate(noise_windows.LENGTH_S, np.inf, lines)
    except (ValueError, np.linalg.LinAlgError, BadInput) as error:
        notes.append(f"the spectra cannot be modelled ({error})")
        return None, None, [], False
    return noise_spectra.weigh(bands, device, seen.windows), lines, seen.trends, seen.switches


class _Seen:
    """The quiet stretches of a recording."""

    def __init__(self, recording: Recording, device: Device, calibration: Calibration, skip_s: np.ndarray, steps: Steps | None, slow: dict[str, np.ndarray]):
        self._recording, self._device, self._calibration = recording, device, calibration
        self._skip_s, self._steps, self._slow = skip_s, steps, slow
        self.windows = 0
        self.restless = self.switches = False
        self.trends: list[noise_trend.Trend] = []

    def baseband(self) -> tuple[list[Band], Lines]:
        tap = self._recording.tap("baseband")
        windows = self._quiet(tap, noise_windows.LENGTH_S, noise_windows.ORDER)
        model = FloorModel(self._device, self._calibration, tap.sample_rate_hz, windows.frequency_hz, self._calibration.loop)
        degc = self._temperature(tap)
        lines = noise_lines.find(windows, self._calibration, model, degc)
        taken = noise_lines.taken(lines, windows, None, degc), noise_lines.taken(lines, windows, None, degc, highest=ECHO)
        self._look_for_trends(windows, model, lines, taken, degc)
        return noise_spectra.bands_of(windows, self._device, self._calibration, self._slow, *taken, self._levels(windows)), lines

    def _levels(self, windows: noise_windows.Windows) -> dict[str, np.ndarray]:
        """Of noise that changes with the temperature: its level in each window over the usual one, by axis."""
        usual = self._at_described_amplitude(windows)
        levels = {trend.axis: np.ones(len(windows)) for trend in self.trends}
        for trend in self.trends:
            levels[trend.axis][usual] = trend.relative
        return levels

    def _at_described_amplitude(self, windows: noise_windows.Windows) -> np.ndarray:
        return ~(np.abs(windows.amplitude_fs - self._calibration.amplitude_set_point_fs) > 6e-4)

    def _look_for_trends(self, windows: noise_windows.Windows, model: FloorModel, lines: Lines, taken: tuple[np.ndarray, np.ndarray],
                         degc: np.ndarray | None) -> None:
        """At the described amplitude, where the windows' temperatures are known; under a line that hides the noise, where that can be taken out."""
        usual = self._at_described_amplitude(windows)
        if degc is None or np.count_nonzero(usual) < noise_windows.LEAST_WINDOWS:
            return
        buried = any(line.height > BURIED for line in lines.clear)
        group, tap = windows.only(usual), windows.tap
        images = noise_windows.image_bins(group, self._calibration)
        middles = np.interp(group.time_s, tap.time_s, degc)
        axis = FORCES if self._calibration.loop == "rebalance" else SECONDARY
        if buried:
            taken = (noise_lines.taken(lines, windows, None, degc, highest=0.0),) * 2
        for name, channels, bins in (("primary", PRIMARY, taken[1]), ("secondary", axis, taken[0])):
            if all(channel in tap for channel in channels):
                values = {channel: noise_lines.filled(tap, channel) for channel in channels}
                if buried:
                    cleaned = {channel: noise_lines.without(values[channel], lines, group, tap, degc) for channel in channels}
                    if not all(done for _, done in cleaned.values()):
                        continue
                    values = {channel: cleaned[channel][0] for channel in channels}
                found = noise_trend.find(name, group, values, {channel: model.of_white(channel) for channel in channels}, images | bins[usual],
                                         middles, Pickoff.of(self._device).whole)
                self.trends += [found] if found is not None else []

    def rate_lines(self) -> Lines | None:
        if "output" not in self._recording or "rate" not in self._recording.tap("output"):
            return None
        windows = self._quiet(self._recording.tap("output"), noise_windows.LENGTH_S)
        model = FloorModel(self._device, self._calibration, windows.tap.sample_rate_hz, windows.frequency_hz, self._calibration.loop)
        return noise_lines.find_in_rate(windows, model)

    def rate(self, length_s: float, to_hz: float, lines: Lines | None) -> list[Band]:
        """Bands of the rate output, none where it is not recorded. lines: found in the baseband."""
        if "output" not in self._recording or "rate" not in self._recording.tap("output"):
            return []
        windows = self._quiet(self._recording.tap("output"), length_s, noise_spectra.LOW_ORDER)
        taken, values = np.zeros((len(windows), windows.length // 2), bool), noise_lines.filled(windows.tap, RATE)
        carrier = self._recording.taps.get("baseband")
        if lines is not None and carrier is not None and len(windows):
            degc = self._temperature(carrier)
            taken = noise_lines.taken(lines, windows, carrier, degc)
            values, sound = noise_lines.without(values, lines, windows, carrier, degc)
            if not sound:
                return []
        values = values - self._slow.get(RATE, 0.0)
        self.switches = noise_spectra.switches(windows, values)
        if self.switches:
            return []
        if np.isfinite(to_hz) and noise_spectra.comes_and_goes(windows, values, taken):
            self.restless = True
            return []
        return noise_spectra.rate_bands(windows, self._device, self._calibration, values, taken, to_hz)

    def _temperature(self, tap: Tap) -> np.ndarray | None:
        """As measured, at a tap's samples."""
        if "output" not in self._recording or "temperature_measured" not in self._recording.tap("output"):
            return None
        output = self._recording.tap("output")
        sound = output.valid & np.isfinite(output["temperature_measured"])
        if not sound.any():
            return None
        return np.interp(tap.time_s, output.time_s[sound], output["temperature_measured"][sound])

    def _quiet(self, tap: Tap, length_s: float, order: int = noise_windows.ORDER) -> noise_windows.Windows:
        windows = noise_windows.quiet(self._recording, tap, self._calibration, length_s, self._skip_s, order)
        if self._steps is not None and self._steps.coarse and len(windows):
            windows = windows.only(_still(self._recording, windows, self._steps.step_degc))
        self.windows = max(self.windows, len(windows))
        return windows


def _still(recording: Recording, windows: noise_windows.Windows, step_degc: float) -> np.ndarray:
    """Windows in which a coarse thermometer did not change its reading: its stairs are in whatever is compensated with it, (n,) bool."""
    output = recording.tap("output")
    half = 0.5 * windows.length / windows.tap.sample_rate_hz
    found = []
    for middle in windows.time_s:
        inside = (output.time_s >= middle - half - 1.0) & (output.time_s <= middle + half)
        values = output["temperature_measured"][inside]
        found.append(len(values) > 0 and float(np.nanmax(values) - np.nanmin(values)) < 0.3 * step_degc)
    return np.array(found, bool)


@dataclass(frozen=True)
class _Looks:
    """All looks, put together."""

    again: Replay
    output: OutputCheck
    spectral: SpectralEvidence | None
    lines: Lines | None
    events: Events | None
    steps: Steps | None
    raw: RawEvidence | None
    trends: list[noise_trend.Trend]
    switches: bool = False

    def log_evidence(self) -> dict[frozenset[str], float]:
        names = (*EFFECTS, OTHER)
        sets = [frozenset(chosen) for size in range(LARGEST_SUPPORT + 1) for chosen in combinations(names, size)]
        return {chosen: self._of(chosen) for chosen in sets if len(chosen & frozenset(noise_spectra.EFFECTS)) <= LARGEST_BROADBAND}

    def _of(self, chosen: frozenset[str]) -> float:
        if not chosen:
            return 0.0
        total = self._broadband(chosen) + self._line(chosen) + self._jumps(chosen)
        total += self._bent(chosen & _CURVES)
        for effect in chosen - {OTHER} - _CURVES:
            total += self._alone(effect)
        total -= ENOUGH if self.switches and FLICKER in chosen else 0.0
        return total - (OTHER_PENALTY if OTHER in chosen else 0.0)

    def _broadband(self, chosen: frozenset[str]) -> float:
        if self.spectral is None or not self.spectral.log_evidence:
            return 0.0
        found = self.spectral.log_evidence[chosen & frozenset(noise_spectra.EFFECTS)]
        if self._raises_anything(chosen):
            found = max(found, *self.spectral.log_evidence.values()) - 1.0
        changing = sum(max(0.0, trend.log_evidence) for trend in self.trends)
        if chosen & {"excess_noise", OTHER} or self._raises_anything(chosen):
            steady = self.spectral.log_evidence[(chosen - {"excess_noise", OTHER}) & frozenset(noise_spectra.EFFECTS)]
            found = max(found, steady - 1.0) + changing if changing > 0.0 else found  # what is there in the warmth alone hardly raises a mean
        if changing > 0.0 and OTHER in chosen and "excess_noise" not in chosen:
            found -= ONE_SIDED
        return _held_to_form(found, max(self.spectral.log_evidence.values()) + changing, sum(band.shape for band in self.spectral.bands))

    def _raises_anything(self, chosen: frozenset[str]) -> bool:
        """One of ANYTHING is chosen, and its own mark is there."""
        jumps = self._jumps(chosen & {"dropped_samples"})
        if "excess_noise" in chosen and self.raw is not None and self.raw.lost_bits:
            return True
        return jumps > SURE or any(self._alone(effect) > SURE for effect in chosen & set(ANYTHING))

    def _line(self, chosen: frozenset[str]) -> float:
        """Every line is explained by the best of the kinds that are chosen; a kind that explains none is missed."""
        found = self.lines.found if self.lines is not None else []
        kinds = set(_STAGE) if self._raises_anything(chosen) else chosen & set(_STAGE)
        total, used = 0.0, set()
        for item in found:
            top = max(line.log_evidence for line in item.values())
            scores = {kind: _bounded(top) + item[kind].log_evidence - top for kind in kinds if kind in item and item[kind].log_evidence > 0.0}
            best = max(scores, key=lambda kind: scores[kind], default="")
            if best and scores[best] > 0.0:
                total += scores[best]
                used.add(best)
        for kind in {"vibration", "interference"} & chosen - used:
            total += self._without_line(kind, found)
        return total

    def _without_line(self, kind: str, found: list[dict[str, noise_lines.Line]]) -> float:
        """Of a kind that explains none of the lines near the carrier."""
        away = [self.raw.log_evidence[kind]] if self.raw is not None and kind in self.raw.log_evidence else []
        if away and away[0] > 0.0:
            return _bounded(away[0])
        looked = away + [min(0.0, item[kind].log_evidence) for item in found if kind in item]
        return max(-5.0, *looked) if looked else 0.0

    def _jumps(self, chosen: frozenset[str]) -> float:
        if self.events is None:
            return 0.0
        found = self.events.log_evidence
        scores = [found[kind] for kind in ("dropped_samples", OTHER) if kind in chosen]
        if not scores and any(self._alone(effect) > SURE for effect in chosen & set(ANYTHING)):
            scores = [max(0.0, found[OTHER])]
        return _bounded(max(scores)) if scores else 0.0

    def _bent(self, chosen: frozenset[str]) -> float:
        """A converter's curve is explained once."""
        if self.raw is None or not chosen:
            return 0.0
        scores = {effect: self.raw.log_evidence.get(effect, 0.0) for effect in _CURVES}
        top, best = max(scores.values()), max(scores[effect] for effect in chosen)
        second = min(scores[effect] for effect in chosen) - 4.0 if len(chosen) > 1 else 0.0
        return _bounded(top) + best - top + min(0.0, max(second, -4.0))

    def _alone(self, effect: str) -> float:
        """Looks at which only this effect counts."""
        total = 0.0
        if effect == "firmware_mismatch":
            total += self._firmware()
        if effect == "thermometer_quantisation" and self.steps is not None:
            total += self.steps.log_evidence
        if effect in _CURVES | {"excess_noise", "clock_jitter"} and self.raw is not None:
            total += self.raw.log_evidence.get(effect, 0.0)
        return _bounded(total)

    def _firmware(self) -> float:
        if self.again.ok is False:
            return 500.0
        return self.output.log_evidence - (4.0 if self.again.ok else 0.0)

    # ---- parameters, places, and what could have been seen ------------------------------------------------------------------------

    def parameters(self) -> dict[str, list[Parameter]]:
        found: dict[str, list[Parameter]] = {}
        if self.spectral is not None:
            for effect, estimates in self.spectral.estimates.items():
                found[effect] = [_in_catalogue(estimate) for estimate in estimates]
        if self.lines is not None:
            for kind, line in self.lines.best.items():
                if np.isfinite(line.amplitude) and np.isfinite(line.frequency_hz):
                    found[kind] = _line_parameters(line)
        if self.raw is not None:
            for effect, values in self.raw.values.items():
                self._from_raw(found, effect, values)
        if self.events is not None and self.events.slips:
            found["dropped_samples"] = _slip_parameters(self.events)
        if self.steps is not None and self.steps.coarse:
            step = self.steps.step_degc
            found["thermometer_quantisation"] = [("step_degc", step, (0.995 * step, 1.005 * step), "degC")]
        if self.output.deviations:
            found["firmware_mismatch"] = [("offset_rad_s" if d.name == "offset" else d.name, d.error, (d.error - 2.0 * d.sigma, d.error + 2.0 * d.sigma), "1" if d.name != "offset" else "rad/s")
                                          for d in self.output.deviations]
        return found

    def _from_raw(self, found: dict[str, list[Parameter]], effect: str, values: list[tuple[str, float, float, str]]) -> None:
        """Raw codes are the sharper look, except at tones near the carrier, which they do not resolve."""
        seen_better = effect == "interference" and self.lines is not None and (
            self.lines.log_evidence.get(effect, 0.0) >= self.raw.log_evidence[effect] if self.raw is not None else True)
        if not seen_better:
            found[effect] = [(name, value, (value - 1.96 * sigma, value + 1.96 * sigma), unit) for name, value, sigma, unit in values]

    def where(self) -> list[tuple[str, str, str, float, str]]:
        found: list[tuple[str, str, str, float, str]] = []
        if self.again.ok is False or self.output.log_evidence > 3.0:
            found.append(("firmware", "rate", "in_phase", float("inf"), "everywhere"))
        if self.spectral is not None:
            for channel in sorted({band.channel for band in self.spectral.bands}):
                bands = [band for band in self.spectral.bands if band.channel == channel]
                worst = max(bands, key=lambda band: (band.ratio - 1.0) * np.sqrt(band.shape))
                if (worst.ratio - 1.0) * np.sqrt(worst.shape) > 5.0:
                    found.append(("pickoff", channel, "noise", worst.ratio, f"{worst.low_hz:.2g} to {worst.high_hz:.2g} Hz"))
        if self.lines is not None:
            found += [(_STAGE[kind], "secondary", "noise", line.ratio, f"line at {line.frequency_hz:.6g} Hz") for kind, line in self.lines.best.items()
                      if line.log_evidence > 6.0 and line.log_evidence == max(self.lines.log_evidence.values())]
        if self.events is not None and self.events.found:
            found.append(("clock", "drive_frequency", "noise", float(len(self.events.found)), "single jumps of phase"))
        if self.steps is not None and self.steps.coarse:
            found.append(("temperature", "temperature_measured", "temperature", self.steps.step_degc / self.steps.own_degc, "steps"))
        if self.raw is not None:
            found += [("pickoff", "primary_adc_raw", "level", score, "raw codes") for effect, score in self.raw.log_evidence.items()
                      if effect.startswith("adc_") and score > 6.0]
        return found

    def seen(self) -> dict[str, list[str]]:
        """Which looks there were for each effect."""
        spectra = ["spectra"] if self.spectral is not None and self.spectral.bands else []
        lines = ["lines"] if self.lines is not None and self.lines.best else []
        raw = ["raw codes"] if self.raw is not None and self.raw.bursts else []
        firmware = (["replay"] if self.again.ok is not None else []) + (["output against baseband"] if self.output.deviations else [])
        primary = spectra if spectra and any(band.channel in PRIMARY for band in (self.spectral.bands if self.spectral is not None else [])) else []
        rate = spectra if spectra and self.spectral is not None and any(band.channel == RATE for band in self.spectral.bands) else []
        return {"excess_noise": spectra + raw, "clock_jitter": primary + raw, "flicker_noise": rate, "interference": lines + raw, "vibration": lines,
                "dropped_samples": ["phase jumps"] if self.events is not None else [], "thermometer_quantisation": ["readings"] if self.steps else [],
                "adc_saturation": raw, "adc_nonlinearity": raw, "firmware_mismatch": firmware}


_CATALOGUE = {"slow_jitter_s": "jitter_s", "octaves_rad_s": "bias_rad_s", "walk_rad_s_per_rt_s": "bias_rad_s"}
_WALK = float(np.sqrt(noise_floor.walk(np.array([0.7])) / noise_floor.relaxations(np.array([0.7])))[0])
"""rms of relaxations that are as strong where both are seen as a walk of 1 per root second"""
_STAGE = {"vibration": "environment", "interference": "environment", "clock_jitter": "clock", OTHER: "secondary"}


def _in_catalogue(found: noise_spectra.Estimate) -> Parameter:
    size, unit = (_WALK, "rad/s rms") if found.name.startswith("walk") else (1.0, found.unit)
    return _CATALOGUE.get(found.name, found.name), size * found.value, (size * found.low, size * found.high), unit


def _line_parameters(line: noise_lines.Line) -> list[Parameter]:
    name, unit = ("rate_rad_s", "rad/s") if line.kind == "vibration" else ("amplitude_fs", "FS")
    at_hz = line.distance_hz if line.form == "force" else line.frequency_hz
    size = (line.amplitude - 1.96 * line.amplitude_sigma, line.amplitude + 1.96 * line.amplitude_sigma)
    place = (at_hz - 1.96 * line.frequency_sigma_hz, at_hz + 1.96 * line.frequency_sigma_hz)
    return [(name, line.amplitude, size, unit), ("frequency_hz", at_hz, place, "Hz")]


def _slip_parameters(events: Events) -> list[Parameter]:
    """Mean distance, from the gaps if there are some, else from how many there were in all."""
    times, rate = np.array([event.time_s for event in events.slips]), events.counter_rate_hz
    doubled = float(np.mean([event.samples < 0 for event in events.slips]) > 0.5)
    between, spread = _distance_s(times, events.examined_s)
    distance = ("distance_samples", between * rate, ((between - spread) * rate, (between + spread) * rate), "sample")
    return [distance, ("doubled", doubled, (doubled, doubled), "1")]


def _distance_s(times: np.ndarray, examined_s: float) -> tuple[float, float]:
    """Distance between events and half its 95 % interval: of a regular course with gaps, else of chance."""
    if len(times) >= 3:
        usual = float(np.median(np.diff(times)))
        number = np.concatenate([[0.0], np.cumsum(np.round(np.diff(times) / usual))])
        slope, _ = np.polyfit(number, times, 1)
        rest = times - np.polyval(np.polyfit(number, times, 1), number)
        if np.std(rest) < 0.05 * usual:
            sigma = np.std(rest) / np.sqrt(np.sum((number - number.mean()) ** 2))
            return float(slope), float(np.hypot(2.0 * sigma, STAIR * INTERVAL_S / np.ptp(number)))
    usual = examined_s / len(times)
    return usual, min(0.9, 2.0 / np.sqrt(len(times))) * usual


def _held_to_form(found: float, top: float, terms: float) -> float:
    """Bounded evidence of a set; less where it misses the spectra by more than a wrong form would. top: of the best set; terms: of all bands' powers."""
    missed = max(0.0, top - found - 0.5 * FORM_ERROR**2 * terms)
    return min(_bounded(max(found, -20.0)), _bounded(top) - _bounded(missed))


def _bounded(nats: float) -> float:
    """Evidence of forms that are known to be inexact: linear as long as it decides, then slower and slower, in the same order."""
    return float(nats if abs(nats) < ENOUGH else np.sign(nats) * ENOUGH * (1.0 + 0.5 * np.log(abs(nats) / ENOUGH)))
