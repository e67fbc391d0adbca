"""The gap of every channel on held-out data, and what an explanation changes about it.

Nuisances, and the last decimals of the effects' parameters, come from the other folds; a fold is never fitted on itself.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from wineglass.diagnosis.explain import posterior_mean, within
from wineglass.diagnosis.system import FOLDS, Products, System

DRAWS = 400
PIECES = 15
SEED = 22
FLOOR_KNOWN = 1.1  # the floor's variance comes from a short run of the description, and a unit is fitted as well as slopes allow
BRIEF = 0.1  # of all frames: a channel that speaks in fewer
APART = 40  # frames: what is further from the last one is another stretch
MOST, ITS_SIZE = 0.75, 1.1503  # of the sizes of normal numbers so many are below that
TRUSTED = 0.3  # frames with less weight than that are left out of the rms: there the twin is not believed


@dataclass(frozen=True)
class Change:
    """One channel: rms in its unit; fraction and its interval are None where it has no gap."""

    channel: str
    before: float
    after: float
    floor: float
    fraction: float | None
    interval: tuple[float, float] | None
    foretold: float = 0.0
    """energy in floors that the explanation foretells of what the unit leaves even if it is fitted there, as many independent frames as the channel has; of what
    is brief nothing; of all channels the most"""

    @property
    def in_floors(self) -> float:
        """Before, of a channel without noise something very large."""
        return self.before / max(self.floor, 1e-300)


def counted(system: System) -> np.ndarray:
    """(channels, n) bool: frames that count."""
    return system.weight > TRUSTED


@dataclass(frozen=True)
class Left:
    """What a twin leaves of a recording on held-out data: values (channels, n), everything uncertain fitted on the other folds. least (channels,): rms that the
    unit leaves as it stands, or fitted on all folds, whichever is less: what goes so was no gap, though a stretch that alone shows a slope cannot be foretold
    from the others. Of a channel that speaks briefly, between two loops, no more than three quarters of its frames have: a few in a row are a transient."""

    values: np.ndarray
    least: np.ndarray


def held_out(system: System, products: Products, softening: np.ndarray, columns: np.ndarray, left: np.ndarray, noise: Collection[int],
             limit: float | np.ndarray | None = None) -> Left:
    """What a twin leaves, left (channels, n), less what columns (k, channels, n) of the products foretell of it. noise: columns that wander; where nobody looked
    nobody can tell how, it is a part of the floor. limit: no coefficient may be further from its prior's middle; or one of each (k,)."""
    places = list(range(len(columns)))

    def without(fold: int | None) -> np.ndarray:
        gram = products.pooled(softening, [f for f in range(FOLDS) if f != fold])
        coefficients = posterior_mean(gram, places)[0] if limit is None else within(gram, places, -products.about[places], limit)
        coefficients[list(noise)] = 0.0
        here = np.ones(left.shape[1], bool) if fold is None else system.fold == fold
        return left[:, here] - np.einsum("k,kcn->cn", coefficients, columns[:, :, here])

    values = np.empty_like(left)
    for fold in range(FOLDS):
        values[:, system.fold == fold] = without(fold)
    use, fitted = counted(system), without(None)
    return Left(values, np.array([min(_lasting(one[i], use[i]) for one in (left, fitted)) for i in range(len(left))]))


def changes(system: System, before: Left, after: np.ndarray) -> tuple[list[Change], Change]:
    """Of every channel, and of all that have a gap, each in units of its floor. after (channels, n): recorded minus twin."""
    use = counted(system)
    found = [_change(system, i, before.values[i], after[i], use[i], float(before.least[i])) for i in range(len(system.names))]
    return found, _total(system, found, before.values, after, use)


def _floor_of(system: System, channel: int) -> float:
    weight = system.weight[channel][counted(system)[channel]]
    return float(system.floor.rms[channel] * np.sqrt(np.mean(1.0 / weight**2))) if len(weight) else float(system.floor.rms[channel])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _is_brief(use: np.ndarray) -> bool:
    return bool(brief(use) and use.any())


def brief(use: np.ndarray) -> np.ndarray:
    """(...,) bool: which channels with frames in use (..., n) speak briefly, or not at all."""
    return np.count_nonzero(use, axis=-1) < BRIEF * use.shape[-1]


def _lasting(values: np.ndarray, use: np.ndarray) -> float:
    """rms of the frames in use (n,); where they are few, not more than three quarters of them tell."""
    kept = values[use]
    return min(_rms(kept), float(np.quantile(np.abs(kept), MOST)) / ITS_SIZE) if _is_brief(use) else _rms(kept)


def _worth(system: System, channel: int, use: np.ndarray) -> float:
    """Independent frames; of a channel that speaks briefly as many as it has stretches: what is slow is alike within each."""
    at = np.flatnonzero(use)
    if _is_brief(use):
        return 1.0 + np.count_nonzero(np.diff(at) > APART)
    return system.floor.independent(channel) * len(at)


def _limit(worth: float) -> float:
    """Of a mean square, in floors: what noise alone leaves at most."""
    return FLOOR_KNOWN + 3.0 * float(np.sqrt(2.0 / max(worth, 1.0)))


def _change(system: System, channel: int, before: np.ndarray, after: np.ndarray, use: np.ndarray, least: float) -> Change:
    floor, worth = _floor_of(system, channel), _worth(system, channel, use)
    fraction, interval = _fraction([before[use]], [after[use]], [floor], worth)
    if least**2 <= (_limit(worth) if _is_brief(use) else FLOOR_KNOWN) * floor**2:
        fraction, interval = None, None
    rms, left = _rms(before[use]), _rms(after[use])
    foretold = 0.0 if brief(use) else worth * (min(rms, least) ** 2 - left**2) / floor**2
    return Change(system.names[channel], rms, left, floor, fraction, interval, foretold)


def _total(system: System, found: list[Change], before: np.ndarray, after: np.ndarray, use: np.ndarray) -> Change:
    foretold = max(change.foretold for change in found)
    gaps = [i for i, change in enumerate(found) if change.fraction is not None]
    if not gaps:
        return Change("all", 0.0, 0.0, 1.0, None, None, foretold)
    scaled = [[values[i][use[i]] / found[i].floor for i in gaps] for values in (before, after)]
    worth = sum(_worth(system, i, use[i]) for i in gaps)
    fraction, interval = _fraction(scaled[0], scaled[1], [1.0] * len(gaps), worth)
    return Change("all", _rms(np.concatenate(scaled[0])), _rms(np.concatenate(scaled[1])), 1.0, fraction, interval, foretold)


def _fraction(before: list[np.ndarray], after: list[np.ndarray], floors: list[float], worth: float) -> tuple[float | None, tuple[float, float] | None]:
    """Share of the amplitude above the floor that is gone, and 95 % of it from contiguous pieces drawn again. worth: independent frames."""
    count = sum(len(values) for values in before)
    floor_squared = float(np.mean([f**2 for f in floors]))
    if count == 0 or floor_squared == 0.0:
        return None, None
    squares = np.array([[sum(float(np.sum(np.array_split(v, PIECES)[p] ** 2)) for v in values) for p in range(PIECES)] for values in (before, after)])
    sizes = np.array([sum(len(np.array_split(v, PIECES)[p]) for v in before) for p in range(PIECES)])
    mean = squares.sum(axis=1) / count
    if mean[0] <= floor_squared * _limit(worth):
        return None, None
    drawn = np.random.default_rng(SEED).integers(0, PIECES, (DRAWS, PIECES))
    again = squares[:, drawn].sum(axis=2) / sizes[drawn].sum(axis=1)
    values = 1.0 - np.sqrt(np.maximum(0.0, again[1] - floor_squared) / np.maximum(again[0] - floor_squared, 1e-6 * again[0]))
    whole = 1.0 - float(np.sqrt(max(0.0, mean[1] - floor_squared) / (mean[0] - floor_squared)))
    low, high = np.quantile(values, [0.025, 0.975])
    return whole, (float(min(low, whole)), float(max(high, whole)))
