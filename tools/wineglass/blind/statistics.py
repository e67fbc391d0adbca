"""Shares with their uncertainty, and how well probabilities were meant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Z95 = 1.959963984540054


@dataclass(frozen=True)
class Share:
    """k of n, and Wilson's 95 % interval."""

    k: int
    n: int

    @property
    def value(self) -> float | None:
        return self.k / self.n if self.n else None

    @property
    def interval(self) -> tuple[float, float]:
        return wilson(self.k, self.n)

    def plain(self) -> dict[str, object]:
        return {"k": self.k, "n": self.n, "value": self.value, "interval": list(self.interval)}


def share(flags: Sequence[bool]) -> Share:
    return Share(sum(map(bool, flags)), len(flags))


def wilson(k: int, n: int, z: float = Z95) -> tuple[float, float]:
    """Interval of a share: all p whose z-test k of n passes. Without cases anything is possible."""
    if n == 0:
        return 0.0, 1.0
    p, z2 = k / n, z * z
    middle, half = (p + z2 / (2 * n)) / (1 + z2 / n), z / (1 + z2 / n) * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n))
    return 0.0 if k == 0 else middle - half, 1.0 if k == n else middle + half


def brier(probabilities: dict[frozenset[str], float], truth: frozenset[str]) -> float:
    """Half the squared distance of the probabilities from certainty of the truth: 0 to 1; for two hypotheses the usual Brier score."""
    missing = 1.0 if truth not in probabilities else 0.0
    return 0.5 * (missing + sum((p - (ids == truth)) ** 2 for ids, p in probabilities.items()))


@dataclass(frozen=True)
class Bin:
    """Answers of like confidence."""

    confidence: float
    right: Share


def reliability(confidence: Sequence[float], right: Sequence[bool], bins: int = 10) -> list[Bin]:
    """Bins of equal width over 0 .. 1 that are not empty, each with its mean confidence."""
    p, r = np.asarray(confidence, float), np.asarray(right, bool)
    index = np.minimum((p * bins).astype(int), bins - 1)
    return [Bin(float(p[index == i].mean()), Share(int(r[index == i].sum()), int((index == i).sum()))) for i in np.unique(index)]


def calibration_error(confidence: Sequence[float], right: Sequence[bool], bins: int = 10) -> float | None:
    """Expected calibration error: distance of confidence from the share of right answers, bin by bin, weighted with the answers."""
    found = reliability(confidence, right, bins)
    total = sum(one.right.n for one in found)
    return sum(one.right.n * abs(one.confidence - one.right.k / one.right.n) for one in found) / total if total else None


def risk_over_coverage(confidence: Sequence[float], wrong: Sequence[bool]) -> tuple[np.ndarray, np.ndarray]:
    """(n,) share of cases answered when only the surest are, and (n,) share of wrong ones among these. Equal confidence is answered together."""
    p, w = np.asarray(confidence, float), np.asarray(wrong, float)
    order = np.argsort(-p, kind="stable")
    p, w = p[order], w[order]
    count = np.arange(1, len(p) + 1)
    last = np.append(p[1:] != p[:-1], True) if len(p) else np.zeros(0, bool)
    return (count / max(1, len(p)))[last], (np.cumsum(w) / count)[last]
