"""What raw pickoff codes say that telemetry does not: the converters' own faults, and noise at the sampling rate.

A carrier is fitted to every burst, its frequency following the burst. What is left holds
    harmonics of the carrier in step with it    a curved or stepped characteristic (adc_nonlinearity)
    a sine that stays at its top                clipping (adc_saturation)
    few values, stuck low bits                  lost bits (excess_noise)
    white noise over what the converter has     excess_noise, alike over the carrier's turn
    noise that goes with the carrier's speed    clock_jitter, twice a turn
    lines elsewhere                             interference"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import median_filter

from wineglass.device import Device
from wineglass.diagnosis import curve_of_codes
from wineglass.diagnosis.noise_floor import Pickoff
from wineglass.recording.reader import Recording, Tap

HARMONICS = 9
"""highest that is looked at; those above half the sampling rate fold onto lower ones and are left out"""
LEAST_SAMPLES = 500
CHANNELS = ("primary_adc_raw", "secondary_adc_raw")
CLIP_EXCESS = 0.004
"""relative: by which the sine through the lower part of the swing must exceed the top that is reached"""
CLIP_LEAST = 20
JUMP_S = 0.3
"""a burst so soon after a jump of phase still shows the loops' answer"""
SURE = 6.0
BURIED = 0.3
"""of the noise, what a curve may have left: jitter is not looked for in that"""
LEAST_DITHER = 0.3
"""of a step: noise that moves codes for certain"""
MODEL_ERROR = 0.03
CERTAIN = 50.0
AROUND = 25
"""bins about a line: it stands over their median"""
RIPPLE_BITS, RIPPLE_FIRST = 17, 64
"""resolution over the code; periods longer than so many to the full range are curves, which harmonics show"""

Values = dict[str, list[tuple[str, float, float, str]]]
"""per effect: name, value, standard deviation, unit"""


@dataclass(frozen=True)
class Burst:
    """One channel of one burst. frequency: turns per sample; amplitude: of the carrier [FS]; harmonics (HARMONICS - 1,): complex amplitudes of 2, 3, ...
    times the carrier, in step with it; variance: of what is left [FS^2]; modulation: by how much it rises where the carrier is fastest; clipped: samples
    that stand at `level` [FS] while the sine goes on; common_step: of all codes; rest, smooth (samples,): what is left, and the rest of the signal [FS];
    phase (samples,): of the carrier [rad]; bent (samples,): what is left with the harmonics still in it [FS];
    doubt: of the variance, what a curve that was taken out may have left [FS^2]"""

    channel: str
    number: int
    samples: int
    frequency: float
    amplitude: float
    harmonics: np.ndarray
    harmonic_sigma: float
    variance: float
    variance_sigma: float
    modulation: float
    modulation_sigma: float
    clipped: int
    level: float
    common_step: int
    rest: np.ndarray
    smooth: np.ndarray
    phase: np.ndarray
    bent: np.ndarray
    doubt: float = 0.0


@dataclass(frozen=True)
class RawEvidence:
    """log_evidence: per effect against none, of this evidence alone"""

    log_evidence: dict[str, float]
    values: Values
    bursts: list[Burst]
    notes: list[str] = field(default_factory=list)
    lost_bits: bool = False
    """low bits of a converter are stuck: what it does to spectra has no simple form"""


def examine(recording: Recording, device: Device, skip_s: np.ndarray | None = None) -> RawEvidence:
    """All bursts together, without those in which something jumped: skip_s, instants (k,)."""
    jumps = np.empty(0) if skip_s is None else skip_s
    bursts = [found for number, tap in enumerate(recording.bursts) if not _jumped(tap, jumps) for channel in CHANNELS
              if (found := _burst(tap, channel, number)) is not None]
    if not bursts:
        without = " without a jump in it" if recording.bursts and len(jumps) else ""
        return RawEvidence({}, {}, [], [f"no raw burst{without} to look at the converters"])
    evidence: dict[str, float] = {}
    values: Values = {}
    lost_bits = _lost_bits(bursts, device, evidence, values)
    fine = [burst for burst in bursts if burst.common_step == 1]
    _clipping(fine, evidence, values)
    rippled = _curvature(fine, evidence, values)
    if max(evidence["adc_saturation"], evidence.get("adc_nonlinearity", 0.0)) > SURE:  # a curve does much to small signals
        fine = [curve_of_codes.straightened(burst) for burst in fine if burst.channel == CHANNELS[0]]
    _noise(fine, device, rippled, evidence, values)
    _lines(fine, recording, evidence, values)
    return RawEvidence(evidence, values, bursts, lost_bits=lost_bits)


def _jumped(tap: Tap, jumps_s: np.ndarray) -> bool:
    begin = tap.first_sample / tap.counter_rate_hz
    return bool(np.any((jumps_s > begin - JUMP_S) & (jumps_s < begin + len(tap) / tap.sample_rate_hz + 0.05)))


# ---- one burst ---------------------------------------------------------------------------------------------------------------------


def _burst(tap: Tap, channel: str, number: int) -> Burst | None:
    if channel not in tap or len(tap) < LEAST_SAMPLES or tap.lost.any():
        return None
    x, codes = tap[channel], tap.codes(channel)
    reference = tap["primary_adc_raw"] if "primary_adc_raw" in tap else x
    frequency = _frequency(reference)
    if frequency is None:
        return None
    n = np.arange(len(x)) - 0.5 * len(x)
    centred = 2.0 * np.pi * frequency * n
    base = _carrier(x, centred)
    rest = x - base.fit
    phase = centred + base.phase
    bent = rest
    harmonics, rest = _harmonics(rest, phase, min(HARMONICS, int(0.495 / frequency)))
    variance = float(np.var(rest)) * len(x) / max(1, len(x) - 2 * HARMONICS - 6)
    double = float(np.mean((rest**2 - variance) * -np.cos(2.0 * phase)) * 2.0)  # largest where the carrier is fastest
    clipped, level = _clip(x, centred, base.amplitude)
    return Burst(channel, number, len(x), frequency, base.amplitude, harmonics, math.sqrt(2.0 * variance / len(x)), variance,
                 variance * math.sqrt(2.0 / len(x)), double, variance * math.sqrt(4.0 / len(x)), clipped, level, _step(codes), rest, x - rest, phase, bent)


def _frequency(x: np.ndarray) -> float | None:
    """Of the carrier, turns per sample: peak of the spectrum, then the slope of the phase of its demodulated halves."""
    window = np.hanning(len(x))
    spectrum = np.abs(np.fft.rfft((x - x.mean()) * window))
    at = int(np.argmax(spectrum[2:])) + 2
    if spectrum[at] < 20.0 * np.median(spectrum):
        return None
    frequency = at / len(x)
    for _ in range(3):
        n = np.arange(len(x))
        pieces = np.array_split(x * np.exp(-2j * np.pi * frequency * n), 8)
        angles = np.unwrap(np.angle([np.sum(piece * np.hanning(len(piece))) for piece in pieces]))
        frequency += np.polyfit(np.arange(8), angles, 1)[0] / (2.0 * np.pi) / (len(x) / 8.0)
    return float(frequency)


@dataclass(frozen=True)
class _Carrier:
    fit: np.ndarray
    amplitude: float
    phase: float


def _carrier(x: np.ndarray, phase: np.ndarray) -> _Carrier:
    """Offset, and a carrier whose two parts may each move as a parabola over the burst: loops and rates are slow."""
    u = np.linspace(-1.0, 1.0, len(x))
    slow = np.stack([np.ones_like(u), u, u**2])
    columns = np.concatenate([slow[:1], slow * np.cos(phase), slow * np.sin(phase)]).T
    found = np.linalg.lstsq(columns, x, rcond=None)[0]
    return _Carrier(columns @ found, float(np.hypot(found[1], found[4])), float(np.arctan2(-found[4], found[1])))


def _harmonics(rest: np.ndarray, phase: np.ndarray, highest: int) -> tuple[np.ndarray, np.ndarray]:
    """Complex amplitudes a with rest = sum Re(a_m exp(j m phase)), m = 2 .. highest; zero above."""
    columns = [function(m * phase) for m in range(2, highest + 1) for function in (np.cos, np.sin)]
    amplitudes = np.zeros(HARMONICS - 1, complex)
    if not columns:
        return amplitudes, rest
    design = np.stack(columns, axis=1)
    found = np.linalg.lstsq(design, rest, rcond=1e-6)[0]
    amplitudes[:highest - 1] = found[0::2] - 1j * found[1::2]
    return amplitudes, rest - design @ found


def _clip(x: np.ndarray, phase: np.ndarray, amplitude: float) -> tuple[int, float]:
    """How many samples stand at a level that the sine through the lower part of the swing passes; and that level [FS]."""
    if amplitude < 0.05:
        return 0, math.nan
    middle, extreme = 0.5 * (float(x.max()) + float(x.min())), 0.5 * (float(x.max()) - float(x.min()))
    columns = np.stack([np.ones_like(x), np.cos(phase), np.sin(phase)], axis=1)
    lower = np.abs(x - middle) < 0.75 * extreme
    if np.count_nonzero(lower) < 100:
        return 0, math.nan
    sine = columns @ np.linalg.lstsq(columns[lower], x[lower], rcond=None)[0] - middle
    over = np.abs(sine) > (1.0 + CLIP_EXCESS) * extreme
    if np.count_nonzero(over) < CLIP_LEAST:
        return 0, math.nan
    held = np.abs(x[over] - middle)
    flat = float(np.std(held)) < 0.25 * float(np.std(np.abs(sine[over]))) + 3e-4
    return (int(np.count_nonzero(over)), float(np.median(held))) if flat else (0, math.nan)


def _step(codes: np.ndarray) -> int:
    """Greatest common divisor of all differences of codes: 2^k when the k low bits are stuck, 0 when all are."""
    return int(np.gcd.reduce(np.abs(np.diff(codes.astype(np.int64))))) if codes.dtype.kind in "iu" else 1


# ---- effects --------------------------------------------------------------------------------------------------------------------------


def _clipping(bursts: list[Burst], evidence: dict[str, float], values: Values) -> None:
    """A sine that is cut off stays at its top, in every burst at one level."""
    cut = [burst for burst in bursts if burst.clipped]
    levels = np.array([burst.level for burst in cut])
    evidence["adc_saturation"] = -2.0
    if cut and np.ptp(levels) < 0.05:
        evidence["adc_saturation"] = min(300.0, 0.2 * sum(burst.clipped for burst in cut))
        values["adc_saturation"] = [("loss_fs", 1.0 - float(levels.mean()), max(2e-4, float(np.std(levels))), "FS")]


def _curvature(bursts: list[Burst], evidence: dict[str, float], values: Values) -> float:
    """Harmonics of the primary in step with it, and steps that repeat over the code. Whatever the curve's form: even and odd ones are summed; a
    polynomial is fitted. Returns the variance [FS^2] that repeating steps leave."""
    chosen = [burst for burst in bursts if burst.channel == CHANNELS[0] and burst.amplitude > 0.05 and not burst.clipped]
    if not chosen:
        return 0.0
    weights = np.array([1.0 / burst.harmonic_sigma**2 for burst in chosen])
    mean = np.sum([w * burst.harmonics for w, burst in zip(weights, chosen, strict=True)], axis=0) / weights.sum()
    sigma = math.hypot(1.0 / math.sqrt(weights.sum()), 2e-7)
    power = np.sum((np.abs(mean) / sigma) ** 2)
    terms = len(mean)
    evidence["adc_nonlinearity"] = max(-4.0, float(0.5 * power - terms * math.log(300.0)), curve_of_codes.repeated(chosen))
    if evidence["adc_nonlinearity"] > SURE:
        values["adc_nonlinearity"] = _curve(chosen, sigma)
        top = min(CERTAIN, max(-CERTAIN, curve_of_codes.giving_way(chosen)))
        evidence["adc_saturation"] = max(evidence.get("adc_saturation", -2.0), evidence["adc_nonlinearity"] + min(0.0, top))
        evidence["adc_nonlinearity"] -= max(0.0, top)
    clipped = any(burst.clipped for burst in bursts)
    gives_way = evidence.get("adc_saturation", -2.0) > max(SURE, evidence["adc_nonlinearity"])
    if clipped:  # some bursts are flat at the top, others only bend there
        evidence["adc_saturation"] = max(evidence["adc_saturation"], evidence["adc_nonlinearity"])
    ripple = _ripple(chosen)
    if not clipped and not gives_way and ripple.log_evidence > max(SURE, evidence["adc_nonlinearity"]):
        evidence["adc_nonlinearity"] = ripple.log_evidence
        values["adc_nonlinearity"] = [("ripple_fs", ripple.amplitude, 0.1 * ripple.amplitude, "FS"),
                                      ("ripple_period_fs", ripple.period, 0.01 * ripple.period, "FS")]
        return ripple.variance
    return 0.0


@dataclass(frozen=True)
class _Ripple:
    """The strongest period of what is left over the code: steps that repeat from code to code. amplitude, period [FS]"""

    log_evidence: float
    amplitude: float
    period: float
    variance: float
    """of what is left, explained by all periods that stand out"""


def _ripple(bursts: list[Burst]) -> _Ripple:
    """Fourier transform of what is left over the level that the signal has without its noise, not over time: a converter's own steps stay where they
    are. White noise gives every period a power of one, exponentially distributed."""
    level, rest = np.concatenate([burst.smooth for burst in bursts]), np.concatenate([burst.rest for burst in bursts])
    size = 1 << RIPPLE_BITS
    places = np.clip((level + 1.0) * (size // 2), 0, size - 1).astype(np.int64)
    transform = np.fft.rfft(np.bincount(places, rest, size))[RIPPLE_FIRST:size // 8]
    power = np.abs(transform) ** 2 / np.sum(rest**2)
    at = int(np.argmax(power))
    return _Ripple(float(power[at]) - math.log(len(power)) - 3.0, 2.0 * float(np.abs(transform[at])) / len(rest), 2.0 / (at + RIPPLE_FIRST),
                   2.0 * float(np.sum(np.abs(transform[power > 14.0]) ** 2)) / len(rest) ** 2)


def _curve(bursts: list[Burst], systematic: float) -> list[tuple[str, float, float, str]]:
    """x + c3 x^3 + c5 x^5 + c2 x^2 through the second, third and fifth harmonics: c2 A^2/2, c3 A^3/4 + 5 c5 A^5/16, c5 A^5/16. One amplitude without a
    fifth harmonic leaves a sum of c3 and c5; a prior of a third of a per cent decides then, and the deviations say so."""
    amplitude = np.array([burst.amplitude for burst in bursts])
    sigma = np.array([math.hypot(burst.harmonic_sigma, systematic) for burst in bursts])
    second, third, fifth = (np.array([burst.harmonics[m].real for burst in bursts]) for m in (0, 1, 3))
    zero = np.zeros_like(amplitude)
    rows = [np.stack([zero, zero, amplitude**2 / 2.0], 1), np.stack([amplitude**3 / 4.0, 5.0 * amplitude**5 / 16.0, zero], 1)]
    found = [second, third]
    if np.any(fifth != 0.0):
        rows.append(np.stack([zero, amplitude**5 / 16.0, zero], 1))
        found.append(fifth)
    weight = 1.0 / np.tile(sigma, len(found))
    design, wanted = np.concatenate(rows) * weight[:, None], np.concatenate(found) * weight
    covariance = np.linalg.inv(design.T @ design + np.eye(3) / 3e-3**2)
    estimate, deviation = covariance @ design.T @ wanted, np.sqrt(np.diag(covariance))
    return [(name, float(value), float(error), "1 at 1 FS")
            for name, value, error in zip(("cubic", "quintic", "quadratic"), estimate, deviation, strict=True)]


def _noise(bursts: list[Burst], device: Device, rippled: float, evidence: dict[str, float], values: Values) -> None:
    """Variance per sample of both pickoffs, and how it goes with the carrier's speed."""
    floor, tolerance = Pickoff.of(device), _tolerance(device)
    evidence.setdefault("excess_noise", -1.0)
    evidence["clock_jitter"] = -1.0
    found = []
    for channel, name in zip(CHANNELS, ("primary_fs", "secondary_fs"), strict=True):
        own = [burst for burst in bursts if burst.channel == channel and not burst.clipped]
        if not own:
            continue
        variance, sigma = _weighted([(burst.variance, burst.variance_sigma) for burst in own])
        modulation, modulation_sigma = _weighted([(burst.modulation, burst.modulation_sigma) for burst in own])
        if channel == CHANNELS[0] and _weighted_doubt(own) < BURIED * variance:
            _jitter(own, device, evidence, values)
        white = variance - (max(0.0, modulation) + 1.3 * rippled if channel == CHANNELS[0] else 0.0)
        spread = math.sqrt(sigma**2 + modulation_sigma**2 + (floor.noise * tolerance) ** 2 + (MODEL_ERROR * variance) ** 2 + _weighted_doubt(own) ** 2)
        excess = white - floor.whole
        if excess > 0.0:
            z = excess / spread
            likelihood = 0.5 * _surprise(white / floor.whole, tolerance, z)
            found.append((name, excess, spread, likelihood))
    strong = [item for item in found if item[3] > 4.0]
    if strong:
        evidence["excess_noise"] = max(evidence["excess_noise"], min(300.0, sum(item[3] for item in strong) - 3.0))
        values["excess_noise"] = values.get("excess_noise", []) + [(name, math.sqrt(excess), 0.5 * spread / math.sqrt(excess), "FS rms") for name, excess, spread, _ in strong]


def _lost_bits(bursts: list[Burst], device: Device, evidence: dict[str, float], values: Values) -> bool:
    """All codes of a converter are multiples of a step, or stand still, although its noise would move them."""
    found, code_fs = False, 2.0 ** (1 - device.electronics.adc.bits)
    for channel, name in zip(CHANNELS, ("primary_fs", "secondary_fs"), strict=True):
        steps = {burst.common_step for burst in bursts if burst.channel == channel}
        if not steps or 1 in steps or device.electronics.adc.noise_fs_rms < LEAST_DITHER * code_fs:
            continue
        step = max(min(steps - {0}, default=2), 2)
        size = math.sqrt((step**2 - 1) / 12.0) * code_fs
        values.setdefault("excess_noise", []).append((name, size, 0.5 * size, "FS rms"))
        evidence["excess_noise"] = 200.0
        found = True
    return found


def _jitter(bursts: list[Burst], device: Device, evidence: dict[str, float], values: Values) -> None:
    """Noise that is largest where the carrier is fastest: variance of lateness times speed^2, and sin^2 = (1 - cos 2)/2."""
    speeds = [2.0 * math.pi * burst.frequency * burst.amplitude for burst in bursts]  # FS per sample
    late, sigma = _weighted([(2.0 * burst.modulation / v**2, 2.0 * burst.modulation_sigma / v**2) for burst, v in zip(bursts, speeds, strict=True)])
    ratio = late / sigma
    if ratio > 5.0:
        evidence["clock_jitter"] = min(300.0, 0.5 * ratio**2 - math.log(ratio) - 3.0)
        jitter = math.sqrt(late) / device.electronics.sample_rate_hz
        values["clock_jitter"] = [("jitter_s", jitter, max(0.01, 0.5 / ratio) * jitter, "s rms")]


def _weighted_doubt(bursts: list[Burst]) -> float:
    return float(np.mean([burst.doubt for burst in bursts]))


def _surprise(ratio: float, tolerance: float, z: float) -> float:
    """Twice the log likelihood lost by the floor's tolerance alone having to explain a ratio of variances."""
    return min(z**2, (math.log(max(ratio, 1.0)) / math.hypot(tolerance, MODEL_ERROR)) ** 2)


def _lines(bursts: list[Burst], recording: Recording, evidence: dict[str, float], values: Values) -> None:
    """A tone away from the carrier in the secondary codes, in all bursts at one frequency, over what is around it: a hump is a loop's."""
    own = [burst for burst in bursts if burst.channel == CHANNELS[1]]
    length = min((burst.samples for burst in own), default=0)
    if not own or length < LEAST_SAMPLES:
        return
    window = np.hanning(length)
    power = np.mean([np.abs(np.fft.rfft(burst.rest[:length] * window)) ** 2 / (burst.variance * np.sum(window**2)) for burst in own], axis=0)
    place = np.arange(len(power)) / length
    carrier = own[0].frequency
    near = np.zeros(len(power), bool)
    for m in range(HARMONICS + 1):  # the carrier's own surroundings, and what is left of harmonics
        folded = abs((m * carrier + 0.5) % 1.0 - 0.5)
        near |= np.abs(place - folded) < (6.0 if m <= 1 else 2.5) / length
    power = np.where(near | (place < 3.0 / length), 1.0, power)
    around = np.maximum(1.0, median_filter(power, AROUND))
    at = int(np.argmax(power / around))
    ratio, count = float(power[at] / around[at]), 0.7 * len(own)
    score = count * (ratio - 1.0 - math.log(max(ratio, 1e-9))) - math.log(len(power)) - 3.0
    evidence["interference"] = max(score, -5.0)
    if score > 3.0:
        variance = float(np.mean([burst.variance for burst in own]))
        amplitude = 2.0 * math.sqrt(max(ratio - 1.0, 0.0) * float(around[at]) * variance * np.sum(window**2)) / np.sum(window)
        rate = recording.bursts[0].sample_rate_hz
        values["interference"] = [("amplitude_fs", amplitude, 0.2 * amplitude, "FS"),
                                  ("frequency_hz", float(place[at]) * rate, 0.5 * rate / length, "Hz")]


def _weighted(pairs: list[tuple[float, float]]) -> tuple[float, float]:
    weights = np.array([1.0 / sigma**2 for _, sigma in pairs])
    return float(np.sum(weights * [value for value, _ in pairs]) / weights.sum()), float(1.0 / math.sqrt(weights.sum()))


def _tolerance(device: Device) -> float:
    stated = device.tolerance.get("electronics.adc.snr_db")
    decibel = stated.absolute if stated is not None and isinstance(stated.absolute, float) else 0.2
    return float(decibel) * math.log(10.0) / 10.0
