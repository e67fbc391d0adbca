"""Broadband noise: which of excess_noise, clock_jitter and flicker_noise, or something else, raises the spectra above the floor, and by how much.

    density(channel, f) = floor(channel, f) + sum over effects of strength^2 shape(effect, channel, f)

Patterns: a noisy pickoff is white in both quadratures of its axis; jitter of the clock moves the phase, so it is in the primary's quadrature in
proportion to the amplitude, and (white jitter) a third of it in phase; flicker is a rate, so it is in the secondary axis' in-phase channel alone, and
low. Likelihood of band powers (Whittle); strengths and the floor's tolerance are integrated (noise_mixture.py), so that evidences can be compared."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.special import gammaincc, logsumexp, polygamma

from wineglass.calibration_block import Calibration
from wineglass.device import Device
from wineglass.diagnosis import noise_windows
from wineglass.diagnosis.noise_floor import FORCES, PRIMARY, RATE, SECONDARY, FloorModel, Pickoff, flicker, relaxations, walk
from wineglass.diagnosis.noise_mixture import WANDERS, Mixture
from wineglass.diagnosis.noise_windows import Windows
from wineglass.recording.reader import Tap

BANDS = 13
FIRST_BIN, LAST_PART = 3.5, 0.49
LOW_LENGTH_S, LOW_TO_HZ, LOW_ORDER = 10.24, 1.3, 5
"""of the rate's own windows, which reach down further: bias that wanders is slow, and the output filter keeps fast noise from folding there"""
LOW_KEPT = 0.5
"""of the rate's windows: steps of the bias are no noise that wanders all the time"""
LEAST_ANSWER = 0.1
"""of an open shell to a rate: where it hardly answers, what is slow in the output is something else"""
SHAPE_PER_BIN = 0.8
"""gamma shape of one bin's power, tapers' overlap included; held against white noise by a test"""
MODEL_ERROR, MODEL_ERROR_AT_1_HZ = 0.05, 0.1
"""relative, of a band: what the closed forms may be off, beyond the stated tolerance, and what slow content may have left, falling with f"""
WANDER_ERROR = 0.5
"""relative, of the described slow noise: the description gives its size, not its form"""
LEAST_SENSITIVITY = 0.08
"""where a loop leaves less of the noise's power, slow content counts for more than noise"""
SLOW_TO_HZ, SMOOTH_SHARE = 3.0, 1.3
"""a low band whose power depends on how much of a polynomial was taken out holds slow content and no noise"""
RESTLESS, CHANCE = 0.3, 1e-3
"""by which the power of noise may change from window to window beyond chance (of its log); chance by which more than that is taken for noise"""
JUMP_S, LEAST_MEANS, MOST_MOMENT, JUMPING = 0.24, 30, 4.5, 0.2
"""means of so long are compared, so many in a window at least; fourth moment of their changes over the square of the second, 3 of normal ones; share of
windows with more than that by which a bias jumps (of forty normal changes 3 % have more)"""
WHITE_FROM_HZ = 5.0
LINE_RATIO = 4.0
FINE_NODES = 400
"""of a strength, for its interval"""
_FLOOR_NODES = np.array([-2.0, -1.2, -0.6, 0.0, 0.6, 1.2, 2.0])
EFFECTS = ("excess_noise", "clock_jitter", "flicker_noise", "other")


@dataclass(frozen=True)
class Band:
    """Mean power of a channel in a band. shape: gamma shape of that mean; floor_noise, floor_steps: what the converter's noise and steps make of it;
    answers: density per unit strength squared of each source; floor_wander: what the described slow noise makes of it"""

    channel: str
    low_hz: float
    high_hz: float
    amplitude_fs: float
    power: float
    shape: float
    floor_noise: float
    floor_steps: float
    answers: dict[str, float]
    floor_wander: float = 0.0

    @property
    def ratio(self) -> float:
        return self.power / (self.floor_noise + self.floor_steps + self.floor_wander)


@dataclass(frozen=True)
class Source:
    """One way of adding noise. low, high: of its strength, where log-uniform is all that is known of it"""

    effect: str
    name: str
    unit: str
    low: float
    high: float

    def nodes(self, count: int) -> np.ndarray:
        return np.geomspace(self.low, self.high, count)


@dataclass(frozen=True)
class Estimate:
    name: str
    unit: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class SpectralEvidence:
    """log_evidence: of each set of EFFECTS, relative to none; estimates: per effect, of the explanation by that effect alone"""

    log_evidence: dict[frozenset[str], float]
    estimates: dict[str, list[Estimate]]
    bands: list[Band]
    windows: int
    notes: list[str] = field(default_factory=list)


# ---- bands -----------------------------------------------------------------------------------------------------------------------


def bands_of(windows: Windows, device: Device, calibration: Calibration, slow: dict[str, np.ndarray], lines: np.ndarray,
             echoes: np.ndarray, levels: dict[str, np.ndarray] | None = None) -> list[Band]:
    """All usable bands. slow: what another model predicts of channels' slow content, by name, at the baseband's samples;
    lines: bins of each window that a line stands on, (n, m) bool; echoes: those on which the primary shows it, through coupling; levels: by which noise that
    changes is above its usual level in each window (n,), by axis: bands that look at other windows would be at odds."""
    tap = windows.tap
    found: list[Band] = []
    loop = calibration.loop
    axis = FORCES if loop == "rebalance" else SECONDARY
    amplitudes = np.where(np.isfinite(windows.amplitude_fs), windows.amplitude_fs, calibration.amplitude_set_point_fs)
    model = FloorModel(device, calibration, tap.sample_rate_hz, windows.frequency_hz, loop)
    images = noise_windows.image_bins(windows, calibration)
    for amplitude in np.unique(np.round(amplitudes, 3)):
        chosen = np.abs(amplitudes - amplitude) < 6e-4
        group = windows.only(chosen)
        if len(group) < noise_windows.LEAST_WINDOWS:
            continue
        for channel in (*PRIMARY, *axis):
            if channel in tap:
                values = _filled(tap, channel) - slow.get(channel, 0.0)
                taken = images[chosen] | (lines[chosen] if channel in axis else echoes[chosen])
                level = (levels or {}).get("primary" if channel in PRIMARY else "secondary", np.ones(len(windows)))[chosen]
                found += _bands(group, channel, values, float(amplitude), model, taken, level)
    return found


def rate_bands(windows: Windows, device: Device, calibration: Calibration, values: np.ndarray, lines: np.ndarray, to_hz: float) -> list[Band]:
    """The rate output's bands up to a frequency, at the described amplitude. values: the rate at the tap's samples, (n,)"""
    amplitude = calibration.amplitude_set_point_fs
    usual = ~(np.abs(windows.amplitude_fs - amplitude) > 6e-4)  # not recorded counts, too
    group = windows.only(usual)
    if len(group) < noise_windows.LEAST_WINDOWS or RATE not in windows.tap:
        return []
    model = FloorModel(device, calibration, windows.tap.sample_rate_hz, windows.frequency_hz, calibration.loop)
    found = [band for band in _bands(group, RATE, values, amplitude, model, lines[usual]) if band.high_hz <= to_hz]
    if to_hz == math.inf:
        return found
    return [band for band in found if float(model.rate_answer(np.array([band.high_hz]))[0]) > LEAST_ANSWER]


def comes_and_goes(windows: Windows, values: np.ndarray, lines: np.ndarray) -> bool:
    """Is what is slow in the rate there in some windows and not in others? Noise of a bias is there all the time, its windows' powers gamma distributed about
    one mean; strain that is let go, a path over temperature, and a bias that switches move in some and stand still in others. What changes at all frequencies
    alike is white, and does not count. lines (n, m): bins that do not count"""
    f = windows.frequency_hz
    chosen = (np.arange(1, len(f) + 1) > FIRST_BIN) & (f < LOW_TO_HZ) & ~lines.any(axis=0)
    quick = (f > WHITE_FROM_HZ) & ~lines.any(axis=0)
    if len(windows) < noise_windows.LEAST_WINDOWS or min(np.count_nonzero(chosen), np.count_nonzero(quick)) < 3:
        return False
    densities = windows.densities(values)
    power, white = densities[:, chosen], np.median(densities[:, quick] / np.median(densities[:, quick], axis=0), axis=1)
    logs = np.log(np.mean(power / np.median(power, axis=0), axis=1) / white)
    variance = float(polygamma(1, SHAPE_PER_BIN * np.count_nonzero(chosen))) + RESTLESS**2
    squares = float(np.sum((logs - logs.mean()) ** 2)) / variance
    return bool(gammaincc(0.5 * (len(logs) - 1), 0.5 * squares) < CHANCE)


def switches(windows: Windows, values: np.ndarray) -> bool:
    """Does what is slow in the rate stand still and jump, again and again? A bias wanders by many small things that add up, so that its changes are normally
    distributed; those of a bias that switches, or of a mount that slips, are not: their fourth moment says so."""
    step = max(1, round(JUMP_S * windows.tap.sample_rate_hz))
    count = windows.length // step
    if len(windows) < noise_windows.LEAST_WINDOWS or count < LEAST_MEANS:
        return False
    means = values[windows.first[:, None] + np.arange(count * step)].reshape(len(windows), count, step).mean(axis=2)
    changed = np.diff(means, axis=1)
    changed -= changed.mean(axis=1, keepdims=True)
    moments = np.mean(changed**4, axis=1) / np.maximum(np.mean(changed**2, axis=1) ** 2, 1e-300)
    return bool(np.count_nonzero(moments > MOST_MOMENT) >= max(noise_windows.LEAST_WINDOWS, JUMPING * len(windows)))


def without_rate(bands: list[Band]) -> list[Band]:
    """Without what a rate is in."""
    return [band for band in bands if band.channel not in (SECONDARY[0], FORCES[0], RATE)]


def without_low(bands: list[Band], from_hz: float) -> list[Band]:
    """Without the secondary axis' low bands: in phase the rate's own are better, and in quadrature nothing but slow content is found there."""
    return [band for band in bands if band.channel not in (*SECONDARY, *FORCES) or band.low_hz > from_hz]


def _filled(tap: Tap, channel: str) -> np.ndarray:
    values = tap[channel]
    sound = np.isfinite(values)
    return values if sound.all() else np.interp(tap.time_s, tap.time_s[sound], values[sound])


def _bands(group: Windows, channel: str, values: np.ndarray, amplitude: float, model: FloorModel, lines: np.ndarray,
           level: np.ndarray | None = None) -> list[Band]:
    level = np.ones(len(group)) if level is None else level
    densities, pickoff = np.where(lines, np.nan, group.densities(values)) / level[:, None], Pickoff.of(model.device)
    white = model.of_white(channel)
    answers = {name: group.leaked(answer) for name, answer in _answers(channel, amplitude, model, white).items()}
    wander = group.leaked(model.of_wander(channel)) * (amplitude / model.calibration.amplitude_set_point_fs) ** 2
    white = group.leaked(white)
    keep = _without_lines(densities, white) & (white > LEAST_SENSITIVITY * white.max() * (channel in PRIMARY))
    bins = np.arange(1, len(white) + 1)
    smoother = replace(group, order=group.order + 2).densities(values) / level[:, None]
    found = []
    for low, high in zip(*_edges(group.length)):
        chosen = (bins > low) & (bins < high) & keep
        if np.count_nonzero(chosen) < 2 or np.any(lines[:, chosen].mean(axis=0) > 0.5):
            continue
        shape = SHAPE_PER_BIN * np.count_nonzero(chosen)
        relative = densities[:, chosen] / white[chosen]  # white within the band, so that no bin dominates
        whole = relative[~np.any(np.isnan(relative), axis=1)]
        if len(whole) < noise_windows.LEAST_WINDOWS:
            continue
        share = LOW_KEPT if channel == RATE else noise_windows.KEPT
        power = _power(whole, shape, share)
        f = group.frequency_hz[chosen]
        if f[-1] < SLOW_TO_HZ and power > SMOOTH_SHARE * _power(smoother[:, chosen] / white[chosen], shape, share):
            continue
        granted = float(np.mean(wander[chosen] / white[chosen]))
        model_error = math.hypot(MODEL_ERROR, MODEL_ERROR_AT_1_HZ / float(f.mean()), WANDER_ERROR * granted / (granted + pickoff.whole))
        total = 1.0 / (1.0 / (0.8 * min(1.0, share / noise_windows.KEPT) * shape * len(whole)) + model_error**2)
        inside = {name: float(np.mean(answer[chosen] / white[chosen])) for name, answer in answers.items()}
        found.append(Band(channel, float(f[0]), float(f[-1]), amplitude, power, total, pickoff.noise, pickoff.steps, inside, granted))
    return found


def _power(relative: np.ndarray, shape: float, share: float) -> float:
    """Of windows' densities (n, bins) over the model's."""
    return float(noise_windows.trimmed(relative.mean(axis=1)[:, None], shape, share)[0])


def _edges(length: int) -> tuple[np.ndarray, np.ndarray]:
    """Of the bands, in bins: even in the logarithm, at least two bins each."""
    edges = [FIRST_BIN]
    for wanted in np.geomspace(FIRST_BIN, LAST_PART * length, BANDS)[1:]:
        edges.append(max(edges[-1] + 2.0, math.floor(wanted) + 0.5))
    found = np.array([edge for edge in edges if edge <= LAST_PART * length + 1.0])
    return found[:-1], found[1:]


def _answers(channel: str, amplitude: float, model: FloorModel, white: np.ndarray) -> dict[str, np.ndarray]:
    """Densities per unit strength squared."""
    if channel in PRIMARY:
        speed = (2.0 * math.pi * model.device.resonator.frequency_hz * amplitude) ** 2
        phase = channel == PRIMARY[1]
        return {"primary_fs": white, "jitter_s": speed * (0.75 if phase else 0.25) * white, "slow_jitter_s": speed * (0.75 if phase else 0.0) * white,
                f"other_{channel}": white, f"other_slow_{channel}": white * (1.0 / model.frequency_hz) ** 2}
    scale = (amplitude / model.calibration.amplitude_set_point_fs) ** 2
    named = channel if channel != RATE else FORCES[0] if model.loop == "rebalance" else SECONDARY[0]
    return {"secondary_fs": white, f"other_{named}": white, f"other_slow_{named}": white * (1.0 / model.frequency_hz) ** 2,
            "bias_rad_s": scale * model.of_rate(channel, relaxations), "octaves_rad_s": scale * model.of_rate(channel, flicker),
            "walk_rad_s_per_rt_s": scale * model.of_rate(channel, walk)}


def _without_lines(densities: np.ndarray, white: np.ndarray) -> np.ndarray:
    """Bins that no line stands on, (m,) bool."""
    whole = np.where(np.all(np.isnan(densities), axis=0), white, densities)
    level = np.nanmedian(whole / white, axis=0)
    around = np.full(len(level), np.inf)  # the higher side, so that a slope is no line
    for at in range(6, len(level) - 6):
        around[at] = max(np.median(level[max(2, at - 9):at - 2]), np.median(level[at + 3:at + 10]))
    line = level > LINE_RATIO * around
    return ~np.convolve(line, np.ones(5), "same").astype(bool)


# ---- evidence --------------------------------------------------------------------------------------------------------------------


def sources(device: Device) -> dict[str, Source]:
    """What may add noise, with the range of strengths that is thought possible, from the floor's tenth upwards."""
    floor = math.sqrt(Pickoff.of(device).whole)
    speed = 2.0 * math.pi * device.resonator.frequency_hz * device.firmware.amplitude_fs
    bias = device.noise_floor.rate_bias_instability_rad_s
    least = max(1e-8, bias)  # what the description calls healthy is none
    return {item.name: item for item in (
        Source("excess_noise", "primary_fs", "FS rms", 0.3 * floor, 300.0 * floor),
        Source("excess_noise", "secondary_fs", "FS rms", 0.3 * floor, 300.0 * floor),
        Source("clock_jitter", "jitter_s", "s rms", 0.2 * floor / speed, 300.0 * floor / speed),
        Source("clock_jitter", "slow_jitter_s", "s rms", 0.2 * floor / speed, 300.0 * floor / speed),
        Source("flicker_noise", "bias_rad_s", "rad/s rms", least, 1e-3), Source("flicker_noise", "octaves_rad_s", "rad/s rms", least, 1e-3),
        Source("flicker_noise", "walk_rad_s_per_rt_s", "rad/s/sqrt(s)", least, 1e-3))}


def weigh(bands: list[Band], device: Device, windows: int) -> SpectralEvidence:
    """The whole question, answered per axis and put together."""
    if not bands:
        return SpectralEvidence({}, {}, [], windows, ["no stretch of the recording is quiet for long enough to look at its noise"])
    axes = [_Axis([band for band in bands if (band.channel in PRIMARY) == primary], device) for primary in (True, False)]
    axes = [axis for axis in axes if axis.bands]
    scores = {chosen: _joined(axes, chosen) for size in range(3) for chosen in _sets(size)}
    none = scores[frozenset()]
    estimates: dict[str, list[Estimate]] = {}
    for axis in axes:
        for effect in EFFECTS[:-1]:
            estimates.setdefault(effect, []).extend(axis.estimates(effect))
    return SpectralEvidence({chosen: score - none for chosen, score in scores.items()}, estimates, bands, windows)


def _sets(size: int) -> list[frozenset[str]]:
    return list({frozenset(chosen) for chosen in product(EFFECTS, repeat=size) if len(set(chosen)) == size}) if size else [frozenset()]


def _joined(axes: list[_Axis], chosen: frozenset[str]) -> float:
    """Log evidence of both axes: an effect that can act on either acts on one of them or on both, each a third."""
    whole, parts = [axis.log_evidence(chosen) for axis in axes], [axis.log_evidence(frozenset()) for axis in axes]
    shared = chosen & {"excess_noise", "other"}
    if len(axes) < 2 or not shared:
        return float(sum(whole))
    first = [axes[0].log_evidence(chosen - shared) if shared else parts[0], axes[1].log_evidence(chosen - shared)]
    return float(logsumexp([whole[0] + whole[1], whole[0] + first[1], first[0] + whole[1]]) - math.log(3.0))


class _Axis:
    """Bands of one pickoff and what may raise them."""

    def __init__(self, bands: list[Band], device: Device):
        self.bands = bands
        rows = [(band.power, band.shape, band.floor_noise, band.floor_steps, band.floor_wander) for band in bands]
        self._mixture = Mixture(*np.array(rows).reshape(-1, 5).T, _tolerance(device))
        self._sources = sources(device)
        self._cache: dict[frozenset[str], float] = {}

    def log_evidence(self, effects: frozenset[str]) -> float:
        effects = frozenset(effect for effect in effects if self._variants(effect))
        if effects not in self._cache:
            variants = [self._variants(effect) for effect in sorted(effects)]
            scores = [self._integrated([name for part in combination for name in part]) for combination in product(*variants)]
            self._cache[effects] = float(logsumexp(scores) - math.log(len(scores)))
        return self._cache[effects]

    def _variants(self, effect: str) -> list[list[str]]:
        """Ways in which an effect may act here, each a list of sources."""
        answers = {name for band in self.bands for name in band.answers}
        if effect == "other":
            channels = sorted({name.removeprefix("other_") for name in answers if name.startswith("other_") and not name.startswith("other_slow_")})
            kinds = [[f"other_{c}"] for c in channels] + [[f"other_slow_{c}"] for c in channels]
            return kinds + ([[f"other_{c}" for c in channels], [f"other_slow_{c}" for c in channels]] if len(channels) == 2 else [])
        return [[name] for name, source in self._sources.items() if source.effect == effect and name in answers]

    def _range(self, name: str) -> tuple[float, float]:
        """Of a strength squared."""
        if name in self._sources:
            return self._sources[name].low ** 2, self._sources[name].high ** 2
        floor = float(np.mean(self._mixture.noise + self._mixture.steps))
        return 0.1 * floor, 1e5 * floor

    def _answer(self, name: str) -> np.ndarray:
        return np.array([band.answers.get(name, 0.0) for band in self.bands])

    def _integrated(self, names: list[str]) -> float:
        """Log evidence with these sources' strengths and the floor's tolerance integrated."""
        low, high = np.array([self._range(name) for name in names]).reshape(-1, 2).T
        return self._mixture.log_evidence(np.array([self._answer(name) for name in names]).reshape(-1, len(self.bands)), low, high)

    def _log_posterior(self, name: str, nodes: np.ndarray) -> np.ndarray:
        """Of the strengths of one source, the floor integrated, (nodes,)."""
        mixture = self._mixture
        weight = np.repeat(-0.5 * _FLOOR_NODES**2, len(WANDERS))
        floor = np.repeat(mixture.noise * np.exp(mixture.tolerance * _FLOOR_NODES)[:, None], len(WANDERS), axis=0) + mixture.steps
        floor += np.tile(WANDERS**2, len(_FLOOR_NODES))[:, None] * mixture.wander
        joint = mixture.log_likelihood(floor[:, None, :] + nodes[:, None] ** 2 * self._answer(name))
        return np.asarray(logsumexp(joint + weight[:, None], axis=0))

    def estimates(self, effect: str) -> list[Estimate]:
        """Of the best variant of an effect alone, on this axis."""
        variants = self._variants(effect)
        if not variants or effect == "other":
            return []
        name = max((variant[0] for variant in variants), key=lambda item: self._integrated([item]))
        nodes = self._sources[name].nodes(FINE_NODES)
        score = self._log_posterior(name, nodes)
        cumulative = np.cumsum(np.exp(score - score.max()))
        cumulative /= cumulative[-1]
        low, middle, high = (float(np.interp(level, cumulative, nodes)) for level in (0.025, 0.5, 0.975))
        return [Estimate(name, self._sources[name].unit, middle, low, high)]


def _tolerance(device: Device) -> float:
    """Standard deviation of the log of the converter's noise power."""
    stated = device.tolerance.get("electronics.adc.snr_db")
    decibel = stated.absolute if stated is not None and isinstance(stated.absolute, float) else 0.2
    return float(decibel) * math.log(10.0) / 10.0
