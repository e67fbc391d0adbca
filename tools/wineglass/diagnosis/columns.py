"""Effects as a rate-level recording shows them: for every effect a few variants, each a set of columns with prior sizes.

A variant adds columns to the static curve, or puts another temperature under it (a lag). Functional forms are only approximately those of
nature: the scores must therefore allow a remainder (noise_models), and rivals that can imitate an effect are looked for (verdict).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wineglass.calibration.lag import Lag
from wineglass.diagnosis.blocks import Blocks
from wineglass.diagnosis.described import OF_THE_THERMOMETER, REACH, Strength

STATIC_ORDER = 3  # of the nominal curve where no calibration is known
CROSS_ORDER = 5  # what the firmware's polynomial holds
LAG_SHARES = (0.01, 0.6)  # time constants, of a thermal branch
LAG_STEPS = 8
PART_BLOCKS = 2.0  # a part of the bias that is late by less is a gradient in all but name
LOG_LAG_STEP = float(np.log(LAG_SHARES[1] / LAG_SHARES[0])) / (LAG_STEPS - 1)
LAG_POLES = (1, 3)  # one pole, or as heat that creeps through a wall
SLOPE_NOISE = 0.004  # of the slope: what the thermometer's noise may make of it
WIDEST_SLOPE = 0.02  # of the record, to each side
AGEING_TIMES = (0.0, 0.02, 0.06, 0.15, 0.4, 1.0)  # time constants of log ageing, of the record; 0 is linear
LOG_AGEING_STEP = float(np.log(2.6))  # between neighbours of them
TWO_PART_TIMES = (0.02, 0.15)  # of logarithmic with linear ageing
VISIBLE = 1.0  # of a block's noise: an effect that never shows more within its bounds is left out
PLAY_WIDTHS = (0.06, 0.15, 0.3, 0.55, 0.9)  # half widths of play, of half the temperature span


@dataclass(frozen=True)
class Variant:
    """columns: indices into the design; static: index of the static curve under it, None: the nominal one; value: of its shape parameter"""

    shape: str
    columns: tuple[int, ...]
    static: int | None = None
    value: float = 0.0
    strengths: tuple[tuple[str, str, float], ...] = ()
    """of an effect as the envelope twin has it: name, unit and size per column"""


@dataclass(frozen=True)
class Design:
    """matrix (n, k): all columns, scaled so that a coefficient's prior is a standard normal.

    statics: columns of every static curve; offsets: index of a column to subtract from the data for that curve, or None
    """

    matrix: np.ndarray
    target: np.ndarray
    statics: list[tuple[int, ...]]
    static_targets: np.ndarray
    """(statics, n): the data minus what the curve predicts without any free coefficient"""
    effects: dict[str, list[Variant]]
    scale: np.ndarray
    """(k,): size of each column's unit coefficient [rad/s]"""
    calibrated: bool
    cross: list[tuple[int, ...]]
    """per static curve: columns of cross_damping over the same temperature"""
    white_rad_s: float = 1.0
    described: bool = False
    """the nominal columns are what a device description calls uncertain, a standard deviation each"""


class _Builder:
    def __init__(self, blocks: Blocks):
        self.blocks = blocks
        self.columns: list[np.ndarray] = []
        self.scales: list[float] = []
        low, high = blocks.temperature_degc.min(), blocks.temperature_degc.max()
        self.middle, self.half = 0.5 * (low + high), max(0.5 * (high - low), 1e-6)
        self.size = max(0.3 * float(np.ptp(blocks.residual_rad_s)), 3.0 * blocks.sample_noise_rad_s)

    def x(self, temperature: np.ndarray) -> np.ndarray:
        return (temperature - self.middle) / self.half

    def add(self, columns: list[np.ndarray], size: float, share: bool = True) -> tuple[int, ...]:
        """Columns (n,), each scaled to a spread of one and then to the prior size."""
        first = len(self.columns)
        each = size / np.sqrt(len(columns)) if share else size
        for column in columns:
            spread = float(np.sqrt(np.mean((column - column.mean()) ** 2))) or float(np.max(np.abs(column))) or 1.0
            spread = spread if spread > 1e-9 else 1.0
            self.columns.append(column / spread * each)
            self.scales.append(each / spread)
        return tuple(range(first, len(self.columns)))

    def add_as_is(self, columns: np.ndarray) -> tuple[int, ...]:
        """(n, k): responses to one standard deviation each."""
        first = len(self.columns)
        self.columns += list(columns.T)
        self.scales += [1.0] * columns.shape[1]
        return tuple(range(first, len(self.columns)))


def build(blocks: Blocks) -> Design:
    b = _Builder(blocks)
    calibrated = blocks.evidence.bias_rad_s is not None
    uncertain = () if blocks.fine_uncertain is None else b.add_as_is(blocks.mean(blocks.fine_uncertain))
    statics: list[tuple[int, ...]] = []
    targets: list[np.ndarray] = []
    cross: list[tuple[int, ...]] = []

    def static(fine_temperature: np.ndarray, shift: np.ndarray | None) -> int:
        powers = np.polynomial.legendre.legvander(np.clip(b.x(fine_temperature), -1.3, 1.3), CROSS_ORDER)
        means = blocks.mean(powers)
        nominal = uncertain if calibrated else b.add([means[:, i] for i in range(STATIC_ORDER + 1)], 10.0 * b.size, share=False)
        extra = range(0, STATIC_ORDER + 1) if calibrated else range(STATIC_ORDER + 1, CROSS_ORDER + 1)
        cross.append(b.add([means[:, i] for i in extra], b.size))
        statics.append(nominal)
        targets.append(blocks.residual_rad_s - (0.0 if shift is None else shift))
        return len(statics) - 1

    static(blocks.fine_temperature_degc, None)
    effects = {"thermometer_lag": _lags(b, calibrated, static)}
    slope = _slope(blocks.fine_time_s, blocks.fine_temperature_degc, blocks.per_block)
    effects["thermal_gradient"] = [Variant("proportional to dT/dt", b.add([blocks.mean(slope)], b.size)),
                                   Variant("over temperature", b.add([blocks.mean(slope), blocks.mean(slope * b.x(blocks.fine_temperature_degc))], b.size))]
    effects["ageing"] = _ageing(b)
    effects["thermal_hysteresis"] = _hysteresis(b)
    effects["cross_damping"] = [Variant("static curve", ())]  # its columns go with the static curve: see `cross`
    if calibrated:
        effects["thermometer_error"] = _thermometer_error(b)
    if blocks.fine_true_rate is not None and np.ptp(blocks.fine_true_rate) > 1e-6:
        effects |= _rate_effects(b)
    expected = blocks.evidence.expected
    if blocks.fine_measured_degc is not None:  # the thermometer is judged by itself: thermometer.py
        effects = {name: v for name, v in effects.items() if name not in OF_THE_THERMOMETER}
    if expected is not None:
        effects |= _as_the_twin_has_them(b, expected.shown, effects)
    if np.ptp(blocks.temperature_degc) < 1.0:
        effects = _without_temperature(effects)
    return Design(np.column_stack(b.columns), blocks.residual_rad_s, statics, np.array(targets), effects, np.array(b.scales), calibrated, cross,
                  blocks.white_rad_s, bool(uncertain))


def _as_the_twin_has_them(b: _Builder, shown: dict[str, list[list[Strength]]], own: dict[str, list[Variant]]) -> dict[str, list[Variant]]:
    """Effects of a described device, as far as the output can show them within their bounds, beside this file's own shapes of them."""
    found: dict[str, list[Variant]] = {}
    for name, shapes in shown.items():
        for strengths in shapes:
            means = [(s, b.blocks.mean(b.blocks.fine(s.response))) for s in strengths]
            seen = [(s, column) for s, column in means if REACH * float(np.max(np.abs(column))) > VISIBLE * b.blocks.white_rad_s]
            if seen and name != "cross_damping":  # its own columns are complete
                columns = b.add([column for _, column in seen], b.size)
                variant = Variant("of the described device", columns, strengths=tuple((s.name, s.unit, s.size) for s, _ in seen))
                found.setdefault(name, list(own.get(name, []))).append(variant)
    return found


def _without_temperature(effects: dict[str, list[Variant]]) -> dict[str, list[Variant]]:
    """What can be seen at one temperature."""
    kept = {name: [v for v in variants if v.strengths or name in ("ageing", "coriolis_gain", "rate_reference")] for name, variants in effects.items()}
    return {name: variants for name, variants in kept.items() if variants}


def _lags(b: _Builder, calibrated: bool, static) -> list[Variant]:  # noqa: ANN001 - local function of build
    """Positive lag: the thermometer follows the bias' temperature late; negative: the bias follows the thermometer late."""
    blocks = b.blocks
    time_s, temperature = blocks.fine_time_s, blocks.fine_temperature_degc
    branch_s = (time_s[-1] - time_s[0]) / max(1, len(blocks.branches))
    shortest_part_s = max(0.02 * branch_s, PART_BLOCKS * (time_s[-1] - time_s[0]) / len(blocks))
    slope = _slope(time_s, temperature, blocks.per_block)
    found = []
    for tau in branch_s * np.geomspace(*LAG_SHARES, LAG_STEPS):
        found += _thermometer_late(b, calibrated, static, float(tau), temperature + tau * slope, tau < 0.15 * branch_s)
        for poles in LAG_POLES:
            late = temperature
            for _ in range(poles):
                late = Lag(time_s, np.full(len(time_s), tau / poles))(late)
            found += _bias_late(b, calibrated, static, float(tau), late, "" if poles == 1 else f", {poles} poles", tau > shortest_part_s)
    return found


def _thermometer_late(b: _Builder, calibrated: bool, static, tau: float, early: np.ndarray, sound: bool) -> list[Variant]:  # noqa: ANN001
    """The bias goes with what the thermometer will show: its own temperature and tau times its slope."""
    blocks = b.blocks
    if calibrated:
        shift = blocks.mean(blocks.fine_slope * (early - blocks.fine_temperature_degc))
        return [Variant("thermometer late", (), static(early, shift), tau)]
    return [Variant("thermometer late", (), static(early, None), tau)] if sound else []


def _bias_late(b: _Builder, calibrated: bool, static, tau: float, late: np.ndarray, poles: str, sound: bool) -> list[Variant]:  # noqa: ANN001
    """The bias, or a part of it, goes with a temperature further in. sound: a faster part is a gradient in all but name."""
    blocks = b.blocks
    part = late - blocks.fine_temperature_degc
    if calibrated:
        return [Variant(f"bias late{poles}", (), static(late, blocks.mean(blocks.fine_slope * part)), -tau)]
    found = [Variant(f"bias late{poles}", (), static(late, None), -tau)]
    if sound:
        columns = b.add([blocks.mean(part), blocks.mean(part * b.x(blocks.fine_temperature_degc))], b.size)
        found.append(Variant(f"part of the bias late{poles}", columns, None, -tau))
    return found


def _slope(time_s: np.ndarray, temperature: np.ndarray, width: int) -> np.ndarray:
    """dT/dt [degC/s] by a straight line through the neighbourhood: about a block to each side, further where the thermometer is noisy."""
    noise = float(np.median(np.abs(np.diff(temperature, 2)))) / 0.6745 / np.sqrt(6.0)
    step = float(np.median(np.diff(time_s)))
    reach = max(1, width)
    slope = _line(time_s, temperature, reach)
    while reach < WIDEST_SLOPE * len(time_s):
        scatter = noise / step * np.sqrt(12.0 / (2 * reach + 1) ** 3)
        if scatter <= SLOPE_NOISE * float(np.sqrt(np.mean(slope**2))):
            break
        reach = reach * 5 // 4 + 1
        slope = _line(time_s, temperature, reach)
    return slope


def _line(time_s: np.ndarray, values: np.ndarray, reach: int) -> np.ndarray:
    """Slope of the least-squares line over `reach` samples to each side of every sample, fewer at the ends (n,)."""
    index = np.arange(len(time_s))
    low, high = np.maximum(index - reach, 0), np.minimum(index + reach, len(time_s) - 1) + 1
    t, v = time_s - time_s.mean(), values - values.mean()

    def mean(x: np.ndarray) -> np.ndarray:
        total = np.concatenate(([0.0], np.cumsum(x)))
        return (total[high] - total[low]) / (high - low)

    return (mean(t * v) - mean(t) * mean(v)) / np.maximum(mean(t * t) - mean(t) ** 2, 1e-12)


def _ageing(b: _Builder) -> list[Variant]:
    elapsed = b.blocks.fine_time_s - b.blocks.fine_time_s[0]
    span = elapsed[-1]
    variants = []
    for share in AGEING_TIMES:
        shape = elapsed if share == 0.0 else np.log1p(elapsed / (share * span))
        name = "linear" if share == 0.0 else "logarithmic"
        variants.append(Variant(name, b.add([b.blocks.mean(shape)], b.size), None, float(share * span)))
        if share in TWO_PART_TIMES:
            columns = b.add([b.blocks.mean(shape), b.blocks.mean(elapsed)], b.size)
            variants.append(Variant("logarithmic and linear", columns, None, float(share * span)))
    return variants


def _hysteresis(b: _Builder) -> list[Variant]:
    """Play: operators of several widths begun in the middle. Set on extreme: plays begun at an edge, and the extremes passed so far."""
    temperature = b.blocks.fine_temperature_degc
    widths = np.repeat(np.array(PLAY_WIDTHS) * b.half, 3)
    begin = np.tile([0.0, 1.0, -1.0], len(PLAY_WIDTHS))
    state = temperature[0] + begin * widths
    path = np.empty((len(temperature), len(widths)))
    for i, degc in enumerate(temperature):
        state = np.minimum(np.maximum(state, degc - widths), degc + widths)
        path[i] = state
    extremes = np.column_stack([np.maximum.accumulate(temperature), np.minimum.accumulate(temperature)])
    plays = list(b.blocks.mean(path[:, begin == 0.0]).T)
    edges = list(b.blocks.mean(np.hstack([path[:, begin != 0.0][:, -4:], extremes])).T)
    return [Variant("play", b.add(plays, b.size)), Variant("set on extreme", b.add(edges, b.size)),
            Variant("play and set on extreme", b.add(plays + edges, b.size))]


def _thermometer_error(b: _Builder) -> list[Variant]:
    slope, x = b.blocks.fine_slope, b.x(b.blocks.fine_temperature_degc)
    return [Variant("offset", b.add([b.blocks.mean(slope)], b.size)),
            Variant("offset and gain", b.add([b.blocks.mean(slope), b.blocks.mean(slope * x)], b.size))]


def _rate_effects(b: _Builder) -> dict[str, list[Variant]]:
    rate, x = b.blocks.fine_true_rate, b.x(b.blocks.fine_temperature_degc)
    turning = b.blocks.mean(rate)
    gain = [Variant("constant", b.add([turning], b.size))]
    if np.ptp(b.blocks.temperature_degc) > 1.0:
        gain.append(Variant("over temperature", b.add([turning, b.blocks.mean(rate * x)], b.size)))
    gain.append(Variant("cubic", b.add([turning, b.blocks.mean(rate**3)], b.size)))
    return {"coriolis_gain": gain, "rate_reference": [Variant("constant", b.add([turning], b.size))]}
