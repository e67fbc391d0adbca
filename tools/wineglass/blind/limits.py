"""From which strength on an effect is seen: singles of one effect over their strengths, and a logistic curve through them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wineglass.blind.marks import Mark
from wineglass.blind.statistics import share

WIDTHS = np.geomspace(0.02, 0.5, 20)


def curves(marks: list[Mark]) -> dict[str, Any]:
    """By effect: points (factor, seen, named: shares) and the factor seen in half of the cases; null where the points do not bound it."""
    found = {}
    for id in sorted({one.sheet.effects[0].id for one in marks if one.sheet.tier == "single"}):
        chosen = [one for one in marks if one.sheet.tier == "single" and one.sheet.effects[0].id == id]
        found[id] = {"points": [_point(factor, chosen) for factor in sorted({one.sheet.factor for one in chosen})],
                     "half_seen_factor": half_seen([one.sheet.factor for one in chosen], [one.gap for one in chosen]),
                     "half_seen_snr": half_seen([max(one.snr, 1e-3) for one in chosen], [one.gap for one in chosen], 1e-3, 1e6)}
    return found


def _point(factor: float, marks: list[Mark]) -> dict[str, Any]:
    here = [one for one in marks if one.sheet.factor == factor]
    return {"factor": factor, "seen": share([one.gap for one in here]).plain(), "named": share([one.in_set for one in here]).plain(),
            "snr": float(np.median([one.snr for one in here]))}


def half_seen(sizes: Sequence[float], seen: Sequence[bool], low: float = 10**-1.5, high: float = 10.0) -> float | None:
    """Size at which a logistic curve over log10(size) crosses one half, by likelihood; null where all or none were seen."""
    if len(seen) == 0 or all(seen) or not any(seen):
        return None
    x, hit = np.log10(np.asarray(sizes, float)), np.asarray(seen, bool)
    middles = np.linspace(np.log10(low), np.log10(high), 181)
    slope = (x[None, None, :] - middles[:, None, None]) / WIDTHS[None, :, None]
    likelihood = -np.logaddexp(0.0, np.where(hit, -slope, slope)).sum(axis=2)
    return float(10 ** _middle_of_best(middles, likelihood.max(axis=1)))


def _middle_of_best(middles: np.ndarray, likelihood: np.ndarray) -> float:
    """Among equally likely ones the middle: points that are cleanly apart leave a range."""
    best = middles[likelihood > likelihood.max() - 1e-6]
    return float(0.5 * (best[0] + best[-1]))
