"""Numbers with intervals for a named effect, from the mixture over variants and noise models."""

from __future__ import annotations

import numpy as np

from wineglass.diagnosis.bayes import Fit
from wineglass.diagnosis.columns import LOG_AGEING_STEP, LOG_LAG_STEP, Design, Variant
from wineglass.diagnosis.contract import Parameter

DRAWS = 2000
SEED = 21


def contribution(design: Design, mixture: list[Fit], effect: str) -> np.ndarray:
    """What the effect adds to the nominal prediction (n,) [rad/s], mean of the mixture."""
    total = np.zeros(len(design.target))
    for fit in mixture:
        total += fit.weight * _one(design, fit, effect)
    return total


def _one(design: Design, fit: Fit, effect: str) -> np.ndarray:
    coefficient = dict(zip(fit.candidate.columns, fit.mean))
    if effect == "cross_damping":
        columns = design.cross[fit.candidate.static]
        return design.matrix[:, list(columns)] @ np.array([coefficient[c] for c in columns])
    variant = fit.candidate.variants[fit.candidate.support.index(effect)]
    signal = np.zeros(len(design.target))
    if variant.columns:
        signal = signal + design.matrix[:, list(variant.columns)] @ np.array([coefficient[c] for c in variant.columns])
    if variant.static is not None:
        nominal = np.array([coefficient[c] for c in design.statics[variant.static]])
        moved = design.static_targets[0] - design.static_targets[variant.static]
        if len(nominal):
            moved = design.matrix[:, list(design.statics[variant.static])] @ nominal - design.matrix[:, list(design.statics[0])] @ nominal
        signal = signal + moved
    return signal


def describe(design: Design, mixture: list[Fit], effect: str) -> list[Parameter]:
    rng = np.random.default_rng(SEED)
    weights = np.array([f.weight for f in mixture])
    counts = rng.multinomial(DRAWS, weights / weights.sum())
    drawn: dict[str, tuple[list[float], str]] = {}
    for fit, count in zip(mixture, counts):
        if count:
            for name, unit, values in _draw(design, fit, effect, int(count), rng):
                drawn.setdefault(name, ([], unit))[0].extend(values)
    parameters = []
    for name, (values, unit) in drawn.items():
        low, middle, high = np.quantile(values, [0.025, 0.5, 0.975])
        parameters.append(Parameter(name=name, value=float(middle), interval=(float(low), float(high)), unit=unit))
    return parameters


def _draw(design: Design, fit: Fit, effect: str, count: int, rng: np.random.Generator) -> list[tuple[str, str, np.ndarray]]:
    support = fit.candidate.support
    variant = Variant("", design.cross[fit.candidate.static]) if effect == "cross_damping" else fit.candidate.variants[support.index(effect)]
    places = [fit.candidate.columns.index(c) for c in variant.columns]
    coefficients = np.zeros((count, 0))
    if places:
        factor = np.linalg.cholesky(fit.covariance[np.ix_(places, places)] + 1e-18 * np.eye(len(places)))
        coefficients = fit.mean[places] + rng.standard_normal((count, len(places))) @ factor.T
    physical = coefficients * design.scale[list(variant.columns)] if places else coefficients
    if variant.strengths:
        return [(name, unit, physical[:, i] * size) for i, (name, unit, size) in enumerate(variant.strengths)]
    if effect == "thermometer_lag":
        between = np.exp(0.5 * LOG_LAG_STEP * rng.uniform(-1.0, 1.0, count))  # the time constants tried are that far apart
        return [("lag_s" if variant.value > 0 else "bias_lag_s", "s", abs(variant.value) * between)]
    if effect == "thermal_gradient":
        return [("bias_rad_s_per_degc_s", "rad/s/(degC/s)", physical[:, 0])]
    if effect == "ageing" and variant.shape == "linear":
        return [("linear_rad_s_per_h", "rad/s/h", 3600.0 * physical[:, 0])]
    if effect == "ageing":
        between = np.exp(0.5 * LOG_AGEING_STEP * rng.uniform(-1.0, 1.0, count))
        line = [("linear_rad_s_per_h", "rad/s/h", 3600.0 * physical[:, 1])] if physical.shape[1] > 1 else []
        return [("logarithmic_rad_s", "rad/s", physical[:, 0]), ("time_constant_s", "s", variant.value * between), *line]
    if effect == "thermometer_error":
        return [("offset_degc", "degC", physical[:, 0])]
    if effect in ("coriolis_gain", "rate_reference"):
        return [("relative_gain", "1", physical[:, 0])]
    spread = np.ptp(design.matrix[:, list(variant.columns)] @ coefficients.T, axis=0)
    return [("peak_to_peak_rad_s", "rad/s", spread)]
