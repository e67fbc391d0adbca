"""Is the recorded rate what the recorded calibration makes of the recorded baseband? Needs no raw burst.

    uncompensated rate = scale(T) Re(read conj(primary)) / |primary|^2      read: the secondary; in rebalance the force that holds it
    compensated        = that less bias(T)                                   with the decoupler on: the other way round, the bias behind its pole

Both sides are means over the same samples, so their noise cancels, and a scale that is off by a part in ten thousand stands out. Pieces in which
the rate moves are left out: the output filter delays one side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from wineglass.calibration_block import Calibration, from_binary, from_json
from wineglass.diagnosis import recorded_modes
from wineglass.errors import BadInput
from wineglass.recording.reader import Recording, Tap
from wineglass.wire import Status

PIECE_S = 1.0
QUIET_FACTOR = 8.0
"""a piece is left out when the rate moves within it so many times more than in the quieter half of all"""
LEAST_PIECES = 8
TOLERANCE = {"scale": 3e-5, "bias": 1e-3, "offset": 2e-8}
"""what rounding, the output filter and the means of a changing temperature may leave: relative, relative, rad/s"""
PRIOR = {"scale": 0.03, "bias": 0.2, "offset": 1e-3}
"""usual size of a mismatch: another unit's block"""
_GROUP_DELAY_TICKS = {"none": 0.0, "0.01": 33.6, "0.025": 13.4, "0.05": 6.7, "0.1": 3.3}
"""of the output filter; docs/SPEC.md, latency"""


@dataclass(frozen=True)
class Deviation:
    """error: found minus stated, relative (scale, bias) or in rad/s (offset); sigma: its standard deviation, rounding included"""

    name: str
    error: float
    sigma: float

    @property
    def log_evidence(self) -> float:
        """For a deviation of the usual size against none, both Gaussian."""
        ratio = (PRIOR[self.name] / self.sigma) ** 2
        return 0.5 * (self.error / self.sigma) ** 2 * ratio / (1.0 + ratio) - 0.5 * math.log1p(ratio)


@dataclass(frozen=True)
class OutputCheck:
    """deviations: those that could be measured; empty with the reasons in `not_checked`"""

    deviations: list[Deviation] = field(default_factory=list)
    pieces: int = 0
    not_checked: list[str] = field(default_factory=list)

    @property
    def log_evidence(self) -> float:
        """That the output is not what this calibration makes of the baseband. One deviation is enough; all three share the prior."""
        if not self.deviations:
            return 0.0
        scores = np.array([item.log_evidence for item in self.deviations])
        return float(max(scores) + np.log(np.mean(np.exp(scores - max(scores)))))


def check(recording: Recording) -> OutputCheck:
    """Compares what can be compared."""
    try:
        calibration = _calibration(recording)
        return _Comparison(recording, calibration).run()
    except _Missing as reason:
        return OutputCheck(not_checked=[str(reason)])


class _Missing(Exception):
    """What the comparison would need."""


def _calibration(recording: Recording) -> Calibration:
    try:
        if recording.calibration_block:
            return from_binary(recording.calibration_block)
        if recording.calibration_json:
            return from_json(recording.calibration_json)
    except BadInput as error:
        raise _Missing(f"the calibration cannot be read ({error.what})") from None
    raise _Missing("there is no calibration")


class _Comparison:
    def __init__(self, recording: Recording, calibration: Calibration):
        self._calibration = calibration
        for tap in ("baseband", "output"):
            if tap not in recording:
                raise _Missing(f"the recording has no tap {tap}")
        self._baseband, self._output = recording.tap("baseband"), recording.tap("output")
        self._foreign = recorded_modes.foreign_spans(recording, calibration)

    def run(self) -> OutputCheck:
        needed = ["primary_in_phase", "primary_quadrature", "status", *self._read_channels()]
        missing = [name for name in needed if name not in self._baseband]
        missing += [name for name in ("temperature_measured",) if name not in self._output]
        if missing:
            raise _Missing(f"channel {missing[0]} is missing")
        pieces = _Pieces(self._baseband, self._output, self._foreign)
        found, notes = [], []
        for compare in (self._scale, self._bias):
            try:
                found += compare(pieces)
            except _Missing as reason:
                notes.append(str(reason))
        return OutputCheck(found, pieces.count, notes)

    def _read_channels(self) -> tuple[str, str]:
        axis = "rebalance" if self._calibration.loop == "rebalance" else "secondary"
        return f"{axis}_in_phase", f"{axis}_quadrature"

    @property
    def _decoupling(self) -> bool:
        return self._calibration.compensation == "g2" and self._calibration.loop == "open"

    def _predicted(self) -> np.ndarray:
        """Rate as demodulated, unfiltered, at the baseband's samples [rad/s], (n,)."""
        base, calibration = self._baseband, self._calibration
        primary = base["primary_in_phase"] + 1j * base["primary_quadrature"]
        in_phase, quadrature = (base[name] for name in self._read_channels())
        rebalanced = calibration.loop == "rebalance"
        read = (-in_phase if rebalanced else in_phase) + 1j * quadrature
        scale = calibration.rebalance_scale_rad_s_per_ratio if rebalanced else calibration.scale_rad_s_per_ratio
        with np.errstate(invalid="ignore", divide="ignore"):
            return self._polynomial(scale, base.time_s) * (read * primary.conj()).real / np.abs(primary) ** 2

    def _polynomial(self, coefficients: list[float], time_s: np.ndarray) -> np.ndarray:
        return np.polynomial.polynomial.polyval(self._temperature(time_s) - self._calibration.reference_temperature_degc, coefficients)

    def _temperature(self, time_s: np.ndarray) -> np.ndarray:
        sound = self._output.valid
        if not sound.any():
            raise _Missing("no temperature")
        return np.interp(time_s, self._output.time_s[sound], self._output["temperature_measured"][sound])

    @property
    def _filter_s(self) -> float:
        """By which the output is later than the baseband."""
        return _GROUP_DELAY_TICKS[self._calibration.output_filter] / self._calibration.slow_rate_hz

    def _scale(self, pieces: _Pieces) -> list[Deviation]:
        channel = "rate" if self._decoupling else "rate_uncompensated"
        if channel not in self._output and not (channel == "rate_uncompensated" and self._calibration.compensation == "none"):
            raise _Missing(f"channel {channel} is missing: the scale cannot be checked")
        measured = pieces.of(self._output, self._output[channel if channel in self._output else "rate"])
        predicted = pieces.of(self._baseband, self._predicted(), self._filter_s)
        quiet = pieces.quiet(self._baseband, self._predicted())
        ones = np.ones(np.count_nonzero(quiet))
        instrument = _neighbours(np.where(quiet, measured, np.nan))[quiet]
        fit = _fit(measured[quiet], np.stack([predicted[quiet], ones]), np.array([1.0, 0.0]), np.stack([instrument, ones]))
        return [Deviation("scale", fit[0][0], math.hypot(fit[1][0], TOLERANCE["scale"])),
                Deviation("offset", fit[0][1], math.hypot(fit[1][1], TOLERANCE["offset"]))]

    def _bias(self, pieces: _Pieces) -> list[Deviation]:
        if "rate" not in self._output or "rate_uncompensated" not in self._output:
            raise _Missing("rate with and without compensation are not both there: the bias cannot be checked")
        if self._calibration.compensation == "none":
            raise _Missing("no compensation is on: the bias cannot be checked")
        bias = self._polynomial(self._calibration.bias_rad_s, self._output.time_s)
        start = np.zeros_like(bias)
        if self._decoupling:
            bias, start = self._behind_pole(bias)
        removed = self._output["rate_uncompensated"] - self._output["rate"]
        columns = np.stack([pieces.of(self._output, values, self._filter_s) for values in (bias, start)])
        measured = pieces.of(self._output, removed)
        if not np.any(np.nan_to_num(columns[1]) > 1e-6):
            columns = columns[:1]
        error, sigma = _fit(measured, columns, np.eye(len(columns))[0])
        return [Deviation("bias", error[0], math.hypot(sigma[0], TOLERANCE["bias"]))]

    def _behind_pole(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What the decoupler takes away, the bias behind the secondary's decay, from zero; and what remains of a start elsewhere, from one; (n,) each."""
        decay = self._polynomial(self._calibration.decay_rate_per_s, self._output.time_s)
        kept = np.exp(-decay / self._output.sample_rate_hz)
        filled = np.nan_to_num(values)
        behind, state = np.empty_like(filled), 0.0
        for at, (share, value) in enumerate(zip(kept.tolist(), filled.tolist(), strict=True)):
            state = share * state + (1.0 - share) * value
            behind[at] = state
        return behind, np.cumprod(kept)


class _Pieces:
    """The span that both taps cover, in pieces of a second, without those in which anything was invalid."""

    def __init__(self, baseband: Tap, output: Tap, foreign: list[tuple[float, float]]):
        begin = max(tap.time_s[0] - 0.5 / tap.sample_rate_hz for tap in (baseband, output))
        end = min(tap.time_s[-1] + 0.5 / tap.sample_rate_hz for tap in (baseband, output))
        longest = max(PIECE_S, 4.0 / baseband.sample_rate_hz, 4.0 / output.sample_rate_hz)
        self.edges = np.arange(begin, end, longest)
        if len(self.edges) <= LEAST_PIECES:
            raise _Missing("the recording is too short to compare output with baseband")
        good = baseband["status"]
        bits = np.nan_to_num(good, nan=0.0).astype(np.int64)
        wanted = int(Status.LOCKED)
        bad = (bits & wanted == 0) | (bits & int(Status.OVERFLOW | Status.TEST_ACTIVE | Status.REBALANCE_SATURATED) != 0)
        self._sound = self._fold(baseband, bad.astype(float), np.sum) == 0
        self.times_s = 0.5 * (self.edges[1:] + self.edges[:-1])
        for first, last in foreign:
            self._sound &= (self.edges[1:] < first) | (self.edges[:-1] > last)

    @property
    def count(self) -> int:
        return int(np.count_nonzero(self._sound))

    def of(self, tap: Tap, values: np.ndarray, late_s: float = 0.0) -> np.ndarray:
        """Means; of what comes later by late_s. NaN where samples are missing or the device was not well; (pieces,)"""
        shifted = np.interp(tap.time_s - late_s, tap.time_s, values) if late_s else values
        means = self._fold(tap, shifted, np.mean)
        return np.where(self._sound, means, np.nan)

    def quiet(self, tap: Tap, values: np.ndarray) -> np.ndarray:
        """Pieces in which the values do not move beyond their noise; (pieces,) bool."""
        means = self._fold(tap, values, np.mean)
        spread = self._fold(tap, values, np.std)
        usable = self._sound & np.isfinite(means) & np.isfinite(spread)
        if np.count_nonzero(usable) < LEAST_PIECES:
            raise _Missing("too little of the recording is sound to compare output with baseband")
        usual = np.quantile(spread[usable], 0.25)
        steady = usable & (spread <= QUIET_FACTOR * usual)
        near = np.convolve(~steady, np.ones(3), "same") > 0  # and the neighbours of a piece that moves
        return usable & ~near if np.count_nonzero(usable & ~near) >= LEAST_PIECES else steady

    def _fold(self, tap: Tap, values: np.ndarray, how: object) -> np.ndarray:
        first = np.searchsorted(tap.time_s, self.edges)
        return np.array([how(values[a:b]) if b > a else np.nan for a, b in zip(first[:-1], first[1:])])  # type: ignore[operator]


def _neighbours(values: np.ndarray) -> np.ndarray:
    """Mean of the pieces before and after, where they are sound: has the same rate, mostly, and other noise. NaN where neither is; (n,)"""
    padded = np.concatenate([[np.nan], values, [np.nan]])
    pair = np.stack([padded[:-2], padded[2:]])
    count = np.sum(np.isfinite(pair), axis=0)
    return np.where(count > 0, np.nansum(pair, axis=0) / np.maximum(count, 1), np.nan)


def _fit(measured: np.ndarray, columns: np.ndarray, stated: np.ndarray, instruments: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Fit of the difference from what is stated: errors and their standard deviations, each (m,). Errors that hang together between neighbours count
    as fewer. instruments: where the columns are noisy themselves, what goes with them and not with their noise; like columns, (m, n)."""
    instruments = columns if instruments is None else instruments
    sound = np.isfinite(measured) & np.all(np.isfinite(columns), axis=0) & np.all(np.isfinite(instruments), axis=0)
    if np.count_nonzero(sound) < LEAST_PIECES:
        raise _Missing("too few steady pieces to compare output with baseband")
    design, tool, rest = columns[:, sound].T, instruments[:, sound].T, measured[sound] - stated @ columns[:, sound]
    inverse = np.linalg.pinv(tool.T @ design)
    error = inverse @ tool.T @ rest
    residual = rest - design @ error
    memory = residual[1:] @ residual[:-1] / max(residual @ residual, 1e-300)
    inflation = (1.0 + max(0.0, memory)) / (1.0 - min(0.9, max(0.0, memory)))
    variance = residual @ residual / max(1, len(rest) - len(stated)) * inflation
    return error, np.sqrt(np.diag(inverse @ (tool.T @ tool) @ inverse.T) * variance) + 1e-300
