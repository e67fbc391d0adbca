"""The polynomial's order, chosen by held-out thermal branches.

Whole branches are predicted from the others, never interleaved samples: neighbours share lag, hysteresis and drift, and would hide them. A
held-out sample counts only where the others have been, in temperature: extrapolation is not what a calibration is for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from wineglass.calibration.branches import Branch

SEGMENTS = 16  # per branch, for the standard error
MARGIN = 0.01  # of the others' span: this close outside still counts as inside
MIN_INSIDE = 0.1  # of a branch's samples must lie inside the others' temperatures, or it is not scored


@dataclass(frozen=True)
class HeldOut:
    """One stretch that was predicted from all the rest. rms_by_order and squares are in the measured channel's unit."""

    kind: str
    start_s: float
    stop_s: float
    from_degc: float
    to_degc: float
    inside: float
    """share of its samples inside the others' temperature range"""
    rms_by_order: list[float]
    squares: list[np.ndarray] = field(repr=False)
    """per order: squared prediction errors of the samples that counted"""


@dataclass(frozen=True)
class OrderChoice:
    order: int
    best: int
    rms_by_order: list[float]
    in_sample_rms_by_order: list[float]
    excess_by_order: list[float]
    """mean square over the best order's, and ..."""
    standard_error_by_order: list[float]
    """... the standard error of that difference"""
    branches: list[HeldOut]


Fit = Callable[[int, np.ndarray], np.ndarray]
"""(order, mask of the samples to fit) -> prediction errors of all samples (n,)"""


def hold_out(
    fit: Fit, held: np.ndarray, usable: np.ndarray, time_s: np.ndarray, temperature: np.ndarray, kind: str, orders: range
) -> HeldOut | None:
    """Predict the samples `held` (mask) from the other usable ones; None where they have too little in common."""
    rest, asked = usable & ~held, usable & held
    if not asked.any() or rest.sum() < 2 * (max(orders) + 1):
        return None
    margin = MARGIN * float(np.ptp(temperature[rest]))
    counted = asked & (temperature >= temperature[rest].min() - margin) & (temperature <= temperature[rest].max() + margin)
    inside = counted.sum() / asked.sum()
    if inside < MIN_INSIDE:
        return None
    squares = [fit(order, rest)[counted] ** 2 for order in orders]
    where = np.flatnonzero(asked)
    return HeldOut(
        kind=kind,
        start_s=float(time_s[where[0]]),
        stop_s=float(time_s[where[-1]]),
        from_degc=float(temperature[where[0]]),
        to_degc=float(temperature[where[-1]]),
        inside=float(inside),
        rms_by_order=[float(np.sqrt(np.mean(s))) for s in squares],
        squares=squares,
    )


def after_maximum(temperature: np.ndarray) -> np.ndarray:
    """Mask of the samples from the highest temperature on."""
    return np.arange(len(temperature)) >= int(np.argmax(temperature))


def hold_out_branches(
    fit: Fit, branches: list[Branch], usable: np.ndarray, time_s: np.ndarray, temperature: np.ndarray, orders: range
) -> list[HeldOut]:
    found = []
    for branch in branches:
        held = np.zeros(len(usable), bool)
        held[branch.where] = True
        scored = hold_out(fit, held, usable, time_s, temperature, branch.kind, orders)
        if scored is not None:
            found.append(scored)
    return found


def choose(branches: list[HeldOut], in_sample: list[float], orders: range) -> OrderChoice:
    """The smallest order whose held-out mean square exceeds the best one's by no more than one standard error of that difference.

    The standard error is paired: squared errors of both orders are subtracted sample by sample, averaged over SEGMENTS stretches of each
    branch (long against the noise's memory), and the scatter of these averages counts.
    """
    pooled = [np.concatenate([b.squares[i] for b in branches]) for i in range(len(orders))]
    mean_squares = [float(np.mean(p)) for p in pooled]
    best = int(np.argmin(mean_squares))
    excess, errors = [], []
    for i in range(len(orders)):
        differences = np.concatenate([_segment_means(b.squares[i] - b.squares[best]) for b in branches])
        excess.append(mean_squares[i] - mean_squares[best])
        errors.append(float(np.std(differences, ddof=1) / np.sqrt(len(differences))) if len(differences) > 1 else 0.0)
    chosen = next(i for i in range(len(orders)) if excess[i] <= errors[i])
    return OrderChoice(
        order=orders[chosen],
        best=orders[best],
        rms_by_order=[float(np.sqrt(m)) for m in mean_squares],
        in_sample_rms_by_order=in_sample,
        excess_by_order=excess,
        standard_error_by_order=errors,
        branches=branches,
    )


def _segment_means(differences: np.ndarray) -> np.ndarray:
    pieces = np.array_split(differences, min(SEGMENTS, len(differences)))
    return np.array([piece.mean() for piece in pieces])
