"""Thermal branches: the stretches of a record in which the temperature rises or falls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_PIECES = 1000  # the temperature is averaged over so many pieces of the record before turning points are sought
_REVERSAL = 0.05  # of the span: the temperature must turn back this far for a turning point to count
_DWELL = 0.01  # of the span: a dwell at the turning point belongs to the branch before it while it stays this close


@dataclass(frozen=True)
class Branch:
    """Samples [start, stop) of the record."""

    kind: str
    """heating or cooling"""
    start: int
    stop: int

    @property
    def where(self) -> slice:
        return slice(self.start, self.stop)


def find_branches(temperature_degc: np.ndarray) -> list[Branch]:
    """temperature (n,) without NaN -> branches that cover all n samples."""
    count = len(temperature_degc)
    edges = np.unique(np.linspace(0, count, min(_PIECES, count) + 1).astype(int))
    smooth = np.add.reduceat(temperature_degc, edges[:-1]) / np.diff(edges)
    turns = [edges[turn + 1] for turn in _turning_points(smooth)]
    bounds = [0, *turns, count]
    return [
        Branch("heating" if temperature_degc[stop - 1] > temperature_degc[start] else "cooling", int(start), int(stop))
        for start, stop in zip(bounds, bounds[1:])
        if stop > start
    ]


def _turning_points(smooth: np.ndarray) -> list[int]:
    """Last piece of each branch but the last one: extremes that the temperature leaves by more than the reversal."""
    span = float(np.ptp(smooth))
    if span == 0.0:
        return []
    turns: list[int] = []
    extreme, direction = 0, 0.0
    for i in range(1, len(smooth)):
        if direction == 0.0:
            direction = _first_direction(smooth[: i + 1], span)
            extreme = int(np.argmax(direction * smooth[: i + 1])) if direction else 0
        elif direction * (smooth[i] - smooth[extreme]) > 0:
            extreme = i
        elif direction * (smooth[extreme] - smooth[i]) > _REVERSAL * span:
            turns.append(_end_of_dwell(smooth, extreme, i, span))
            direction, extreme = -direction, i
    return turns


def _first_direction(smooth: np.ndarray, span: float) -> float:
    if smooth[-1] - smooth.min() > _REVERSAL * span and smooth[-1] - smooth[0] >= 0:
        return 1.0
    if smooth.max() - smooth[-1] > _REVERSAL * span and smooth[-1] - smooth[0] <= 0:
        return -1.0
    return 0.0


def _end_of_dwell(smooth: np.ndarray, extreme: int, confirmed: int, span: float) -> int:
    near = np.abs(smooth[extreme : confirmed + 1] - smooth[extreme]) <= _DWELL * span
    return extreme + int(np.flatnonzero(near)[-1])
