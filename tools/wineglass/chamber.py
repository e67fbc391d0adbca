"""A gyro at rest in a climate chamber, from a table: static cubic over temperature, subtracted through the firmware's own polynomial."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.polynomial import Polynomial

from wineglass import firmware_polynomial
from wineglass.errors import BadInput
from wineglass.importers.csv import ImportOptions, read_csv

ORDER = 3
DROPPED_ROWS = frozenset({0, 1})  # the first two rows stand apart from the sweep (measured: 0.5 degC and 20 mrad/s off)
AXES = ("gyro_a", "gyro_b")

Compensation = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(coefficients [rad/s/degC^i], shift [degC] (n,)) -> bias [rad/s] (n,)"""


@dataclass(frozen=True)
class Sweep:
    """time_s, temperature_degc (n,); rate_rad_s: axis -> (n,)"""

    time_s: np.ndarray
    temperature_degc: np.ndarray
    rate_rad_s: dict[str, np.ndarray]


@dataclass(frozen=True)
class Split:
    """Residual rms in rad/s of one way to hold data out, in float64 and through the firmware's fixed-point polynomial."""

    name: str
    float64_rad_s: float
    firmware_rad_s: float


@dataclass(frozen=True)
class AxisResult:
    """coefficients (4,) [rad/s/degC^i] of the fit to all samples; residual_rad_s (n,) through the firmware's polynomial."""

    axis: str
    coefficients: np.ndarray
    residual_rad_s: np.ndarray
    raw_rms_rad_s: float
    splits: list[Split]


def read_sweep(path: Path, rate_unit: str) -> Sweep:
    """The table's first column is time, the second temperature; AXES are rates in `rate_unit`, which the file does not say."""
    rates, time_s, temperature = {}, np.empty(0), np.empty(0)
    for axis in AXES:
        data = read_csv(path, ImportOptions(
            columns={"time": "t_s", "temperature": "temperature_degC", "rate": axis},
            unit_of={"t_s": "s", "temperature_degC": "degC", axis: rate_unit},
            drop_rows=DROPPED_ROWS, columns_flag="column",
        ))
        rates[axis] = data.channels["rate"]
        time_s, temperature = data.time_s, data.channels["temperature_measured"]
    if len(time_s) < 8 * (ORDER + 1):
        raise BadInput(f"only {len(time_s)} rows", path, "a sweep needs more")
    return Sweep(time_s, temperature, rates)


def float64_bias(coefficients: np.ndarray, shift_degc: np.ndarray) -> np.ndarray:
    return Polynomial(coefficients)(shift_degc)


def analyse(sweep: Sweep, reference_degc: float) -> list[AxisResult]:
    shift = sweep.temperature_degc - reference_degc
    return [_analyse_axis(axis, shift, rate) for axis, rate in sweep.rate_rad_s.items()]


def _analyse_axis(axis: str, shift: np.ndarray, rate: np.ndarray) -> AxisResult:
    everything = np.ones(len(rate), bool)
    even = np.arange(len(rate)) % 2 == 0
    after = np.arange(len(rate)) >= int(np.argmax(shift))
    ways = [
        ("in sample", [(everything, everything)]),
        ("interleaved", [(even, ~even), (~even, even)]),
        ("after the maximum held out", [(~after, after)]),
    ]
    coefficients = fit_cubic(shift, rate)
    return AxisResult(
        axis=axis,
        coefficients=coefficients,
        residual_rad_s=rate - firmware_polynomial.bias_rad_s(coefficients, shift),
        raw_rms_rad_s=_rms(rate - rate.mean()),
        splits=[
            Split(name, _held_out(shift, rate, folds, float64_bias), _held_out(shift, rate, folds, firmware_polynomial.bias_rad_s))
            for name, folds in ways
        ],
    )


def fit_cubic(shift: np.ndarray, rate: np.ndarray) -> np.ndarray:
    return Polynomial.fit(shift, rate, ORDER).convert().coef


def _held_out(shift: np.ndarray, rate: np.ndarray, folds: list[tuple[np.ndarray, np.ndarray]], bias: Compensation) -> float:
    """Pooled rms over folds of (mask to fit, mask to predict)."""
    errors = [rate[test] - bias(fit_cubic(shift[train], rate[train]), shift[test]) for train, test in folds]
    return _rms(np.concatenate(errors))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
