"""Which blocks are held out: whole power-ups, whole thermal branches, whole rate segments, never interleaved samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wineglass.diagnosis.blocks import STEADY_DEGC, Blocks

LEAST_SHARE = 0.15
LEAST_GROUP = 0.06  # of the record: a smaller group is no test
LEAST_INSIDE = 0.3
MARGIN = 0.01
WANTED_FIT = 0.62  # share of the record that the coefficients of `primary` come from
BEYOND_FIT = (0.4, 0.85)
RATE_GROUPS = 4
IN_TURN = 4  # branches: from two cycles on each is held out once
COVERED = 0.7  # of the blocks must then be held out
RATE_STEP = 0.02  # of the true rate's span


@dataclass(frozen=True)
class Split:
    """Masks (n,): fit and held never overlap. Held blocks outside the temperatures of the fit part are not scored."""

    name: str
    fit: np.ndarray
    held: np.ndarray


def told(blocks: Blocks) -> list[Split]:
    """What before and after are told of: every branch in turn where there are several cycles, else the end of the record."""
    if len(blocks.branches) < IN_TURN:
        return [primary(blocks)]
    parts = [_split(blocks, "every thermal branch in turn", mask, LEAST_GROUP) for mask in _branch_masks(blocks)]
    whole = [part for part in parts if part is not None]
    return whole if len(whole) >= IN_TURN - 1 and np.mean(np.any([p.held for p in whole], axis=0)) > COVERED else [primary(blocks)]


def joined(parts: list[Split]) -> Split:
    """One part as it is; of several the held-out blocks of all."""
    held = np.any([part.held for part in parts], axis=0)
    return parts[0] if len(parts) == 1 else Split(parts[0].name, ~held, held)


def primary(blocks: Blocks) -> Split:
    """The end of the record, from a power-up, a turn of the temperature or a rate segment on."""
    index = np.arange(len(blocks))
    for name, start in _starts(blocks):
        split = _split(blocks, name, index >= start)
        if split is not None:
            return split
    later = index >= (2 * len(blocks)) // 3
    return _split(blocks, "the last third of the time", later) or Split("the last third of the time", ~later, later)


def groups(blocks: Blocks) -> list[Split]:
    """What an effect must earn its place on: every power-up and every branch held out in turn. One cycle cannot spare a branch in its middle, so there it
    is its end alone."""
    found = [_split(blocks, "a power-up", blocks.segment == number, LEAST_GROUP) for number in _several(blocks.segment)]
    if len(blocks.branches) >= IN_TURN:
        found += [_split(blocks, "a thermal branch", mask, LEAST_GROUP) for mask in _branch_masks(blocks)]
    elif len(blocks.branches) < 2:
        found += [_split(blocks, "rate segments", mask, LEAST_GROUP) for mask in _rate_masks(blocks)]
    kept = [split for split in found if split is not None]
    return kept if len(kept) > 1 else [primary(blocks)]


def _starts(blocks: Blocks) -> list[tuple[str, int]]:
    """Where the held-out part may begin, the best first."""
    n = len(blocks)
    power_ups = [int(i) + 1 for i in np.flatnonzero(np.diff(blocks.segment))]
    turns = [b.start for b in blocks.branches[1:]]
    hottest = int(np.argmax(blocks.temperature_degc))

    def by_size(places: list[int]) -> list[int]:
        return sorted((p for p in places if BEYOND_FIT[0] <= p / n <= BEYOND_FIT[1]), key=lambda p: abs(p / n - WANTED_FIT))

    found = [("the last power-ups", p) for p in by_size(power_ups)]
    if np.ptp(blocks.temperature_degc) < STEADY_DEGC:
        return found + [("the last rate segments", p) for p in by_size(rate_boundaries(blocks))]
    if 1 < len(blocks.branches) <= 3:
        found.append(("everything after the temperature maximum", hottest))
    found += [("the last thermal branches", p) for p in by_size(turns)]
    found += [("everything after the temperature maximum", hottest)]
    found += [("the last thermal branch", turns[-1])] if turns else []
    return found + [("the last rate segments", p) for p in by_size(rate_boundaries(blocks))]


def _several(numbers: np.ndarray) -> list[int]:
    values = np.unique(numbers)
    return [int(v) for v in values] if len(values) > 1 else []


def _branch_masks(blocks: Blocks) -> list[np.ndarray]:
    if len(blocks.branches) < 2:
        return []
    index = np.arange(len(blocks))
    return [(index >= b.start) & (index < b.stop) for b in blocks.branches]


def rate_boundaries(blocks: Blocks) -> list[int]:
    """Blocks at which the true rate goes over to another value."""
    if blocks.fine_true_rate is None:
        return []
    rate = blocks.mean(blocks.fine_true_rate)
    span = float(np.ptp(rate))
    return [int(i) + 1 for i in np.flatnonzero(np.abs(np.diff(rate)) > RATE_STEP * span)] if span > 1e-6 else []


def _rate_masks(blocks: Blocks) -> list[np.ndarray]:
    """Four contiguous runs of whole rate segments."""
    bounds = rate_boundaries(blocks)
    if len(bounds) < RATE_GROUPS:
        return []
    edges = [0, *(bounds[len(bounds) * k // RATE_GROUPS] for k in range(1, RATE_GROUPS)), len(blocks)]
    index = np.arange(len(blocks))
    return [(index >= a) & (index < b) for a, b in zip(edges, edges[1:])]


def _split(blocks: Blocks, name: str, held: np.ndarray, least: float = LEAST_SHARE) -> Split | None:
    fit = ~held
    if fit.mean() < LEAST_SHARE or held.mean() < least:
        return None
    seen = blocks.temperature_degc[fit]
    margin = MARGIN * float(np.ptp(seen))
    inside = (blocks.temperature_degc >= seen.min() - margin) & (blocks.temperature_degc <= seen.max() + margin)
    scored = held & inside
    return Split(name, fit, scored) if scored.sum() >= max(3, LEAST_INSIDE * held.sum()) else None
