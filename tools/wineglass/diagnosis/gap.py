"""How large the gap is on held-out blocks, against what noise alone would give, before and after an explanation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wineglass.diagnosis.bayes import Fit
from wineglass.diagnosis.columns import Design
from wineglass.diagnosis.split import Split, joined

DRAWS = 400
PIECES = 12  # contiguous pieces of the held-out blocks, drawn again for the interval
QUANTILE = 0.99
SEED = 20


@dataclass(frozen=True)
class Floor:
    """rms on nulls, the quantile above which a gap begins, and how many independent blocks the held-out ones are worth."""

    rms: float
    threshold: float
    effective: float


@dataclass(frozen=True)
class Fraction:
    value: float | None
    interval: tuple[float, float] | None


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def nominal_residual(design: Design, split: Split) -> np.ndarray:
    """Recorded minus nominal twin (n,): the calibrated curve, or the least-squares static cubic of the fit part."""
    return _beyond_nominal(design, split, design.target)


def _beyond_nominal(design: Design, split: Split, values: np.ndarray) -> np.ndarray:
    """values (n, ...) minus the nominal curve fitted to their fit part"""
    nominal = design.matrix[:, list(design.statics[0])]
    if not nominal.shape[1]:
        return values
    rows, wanted = nominal[split.fit], values[split.fit]
    if design.described:  # within tolerance: a standard deviation weighs as much as a block's noise
        tied = design.white_rad_s * np.eye(nominal.shape[1])
        rows, wanted = np.vstack([rows, tied]), np.concatenate([wanted, np.zeros((nominal.shape[1], *wanted.shape[1:]))])
    return values - nominal @ np.linalg.lstsq(rows, wanted, rcond=None)[0]


def assembled(parts: list[Split], residuals: list[np.ndarray]) -> np.ndarray:
    """Every block's residual (n, ...) from the part that holds it out; blocks that none holds out as the first one has them."""
    out = residuals[0].copy()
    for part, values in zip(parts, residuals):
        out[part.held] = values[part.held]
    return out


def floor(design: Design, parts: list[Split], white: float, null_fits: list[Fit]) -> Floor:
    """Nulls drawn from the noise models of the floor class, weighted as the data weigh them, and put through the nominal fit."""
    split = joined(parts)
    rng = np.random.default_rng(SEED)
    weights = np.array([f.weight for f in null_fits])
    counts = rng.multinomial(DRAWS, weights / weights.sum())
    draws, effective = [], 0.0
    for fit, count in zip(null_fits, counts):
        covariance = fit.noise.covariance[np.ix_(split.held, split.held)]
        effective += fit.weight * np.trace(covariance) ** 2 / np.sum(covariance**2)
        if count:
            draws.append(np.linalg.cholesky(fit.noise.covariance) @ rng.standard_normal((len(split.fit), count)))
    noise = white * np.hstack(draws)
    noise = assembled(parts, [_beyond_nominal(design, part, noise) for part in parts])
    squares = np.mean(noise[split.held] ** 2, axis=0)
    return Floor(float(np.sqrt(squares.mean())), float(np.sqrt(np.quantile(squares, QUANTILE))), float(effective / weights.sum()))


def fraction(before: np.ndarray, after: np.ndarray, null: Floor) -> Fraction:
    """Share of the amplitude above the floor that the explanation takes away; before and after are held-out residuals (m,)."""
    if np.mean(before**2) <= null.rms**2 * (1.0 + 3.0 * np.sqrt(2.0 / null.effective)):
        return Fraction(None, None)
    squares = np.array([[np.sum(part**2) for part in np.array_split(values, PIECES)] for values in (before, after)])
    sizes = np.array([len(part) for part in np.array_split(before, PIECES)])
    rng = np.random.default_rng(SEED)
    drawn = rng.integers(0, PIECES, (DRAWS, PIECES))
    totals = squares[:, drawn].sum(axis=2) / sizes[drawn].sum(axis=1)
    values = _fraction(totals[0], totals[1], null.rms)
    whole = float(_fraction(np.mean(before**2), np.mean(after**2), null.rms))
    low, high = np.quantile(values, [0.025, 0.975])
    return Fraction(whole, (float(min(low, whole)), float(max(high, whole))))


def _fraction(before_squared: np.ndarray, after_squared: np.ndarray, floor_rms: float) -> np.ndarray:
    above = np.maximum(before_squared - floor_rms**2, 1e-6 * before_squared)
    return 1.0 - np.sqrt(np.maximum(0.0, after_squared - floor_rms**2) / above)
