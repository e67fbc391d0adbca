"""Before and after on held-out data, by the full twin: how far an explanation shrinks the gap of every channel.

Nuisances, and the last decimals of the effects' parameters, come from the other folds; a fold is never fitted on itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wineglass.diagnosis.channels import Frames
from wineglass.diagnosis.closure import Closed
from wineglass.diagnosis.explain import posterior_mean, within
from wineglass.diagnosis.system import FOLDS, Products, products
from wineglass.diagnosis import responses, standing
from wineglass.diagnosis.standing import Standing
from wineglass.diagnosis.twin_level import FREEDOM, TwinAnalysis

DRAWS = 400
PIECES = 15
SEED = 22
FLOOR_KNOWN = 1.1  # the floor's variance comes from a short run: it is known to a tenth
TOLERATED = 3.0  # standard deviations: further off than that is no tolerance
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


@dataclass(frozen=True)
class Confirmed:
    """before, after (channels, n): recorded minus twin, in the channels' units; use (channels, n). values (k,), covariance (k, k): of the
    chosen explanation's unknowns, about the full twin's run."""

    changes: list[Change]
    total: Change
    before: np.ndarray
    after: np.ndarray
    use: np.ndarray
    values: np.ndarray
    covariance: np.ndarray


def confirm(found: TwinAnalysis, chosen: Closed | None) -> Confirmed:
    """chosen: None leaves the gap as it is."""
    recorded, base = _channels(found, found.recorded), _channels(found, found.base)
    nuisance = found.responses.values[list(found.responses.nuisances)][:, found.pick, :]
    before = recorded - base - _folded(found, found.table, list(range(len(nuisance))), nuisance, TOLERATED)
    after, polished = before, None
    if chosen is not None:
        there = Standing(found.bench, chosen.unknowns, chosen.values, chosen.jacobian)
        left = recorded - _channels(found, standing.run(there))
        slopes = np.array([slope[found.pick] for _, slope in there.slopes])
        columns = np.concatenate([slopes, chosen.jacobian * there.spread[:, None, None]])
        polished = _polish(found, columns, left, np.concatenate([found.responses.centre, there.off]))
        after = left - _folded(found, polished, list(range(len(columns))), columns)
    use = found.system.weight > TRUSTED
    changes = [_change(found, i, before[i], after[i], use[i]) for i in range(len(found.names))]
    values, covariance = (np.zeros(0), np.zeros((0, 0))) if chosen is None or polished is None else _estimate(found, chosen, polished)
    return Confirmed(changes, _total(changes, before, after, use), before, after, use, values, covariance)


def _channels(found: TwinAnalysis, frames: Frames) -> np.ndarray:
    return np.array([frames[name] for name in found.names])


def _polish(found: TwinAnalysis, columns: np.ndarray, left: np.ndarray, about: np.ndarray) -> Products:
    """The linear system about the full twin's run instead of the envelope's; it was run with coefficients `about`."""
    white = found.system.whiten(columns)
    return products(found.system, white, about, found.system.whiten(left))


def _estimate(found: TwinAnalysis, chosen: Closed, polished: Products) -> tuple[np.ndarray, np.ndarray]:
    """Values (k,) of the unknowns and their covariance (k, k): forms are believed as far as the full twin's own remainder allows."""
    places = list(range(polished.count))
    exact, _ = posterior_mean(polished.pooled(np.ones(len(found.names))), places)
    left = polished.left(exact)
    excess = np.maximum(0.0, left - found.system.n_rows * (1.0 + 3.0 * np.sqrt(2.0 / np.maximum(found.system.n_rows, 1))))
    gram = polished.pooled(1.0 + excess / FREEDOM)
    coefficients = polished.about + posterior_mean(gram, places)[0]
    first = polished.count - len(chosen.unknowns)
    size = np.sqrt(np.maximum(np.diagonal(gram)[:-1], 1e-12))
    inner = gram[:-1, :-1] / np.outer(size, size) + np.diag(1.0 / size**2 + 1e-12)
    covariance = (np.linalg.inv(inner) / np.outer(size, size))[first:, first:]
    spread, middle = np.array([u.spread for u in chosen.unknowns]), np.array([u.middle for u in chosen.unknowns])
    return middle + coefficients[first:] * spread, covariance * np.outer(spread, spread)


def _folded(found: TwinAnalysis, products: Products, places: list[int], columns: np.ndarray, limit: float | None = None) -> np.ndarray:
    """(channels, n): columns times what coefficients, fitted without a frame's own fold, are beside the ones of the data. limit: none may be further
    from its prior's middle."""
    total = np.zeros(columns.shape[1:])
    for fold in range(FOLDS):
        gram = products.pooled(found.softening, [f for f in range(FOLDS) if f != fold])
        coefficients = posterior_mean(gram, places)[0] if limit is None else within(gram, places, -products.about[places], limit)
        here = found.system.fold == fold
        total[:, here] = np.einsum("k,kcn->cn", coefficients, columns[:, :, here])
    return total


def _floor_of(found: TwinAnalysis, channel: int, use: np.ndarray) -> float:
    weight = found.system.weight[channel][use]
    return float(found.system.floor.rms[channel] * np.sqrt(np.mean(1.0 / weight**2))) if len(weight) else float(found.system.floor.rms[channel])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _change(found: TwinAnalysis, channel: int, before: np.ndarray, after: np.ndarray, use: np.ndarray) -> Change:
    floor = _floor_of(found, channel, use)
    left, right = before[use], after[use]
    fraction, interval = _fraction([left], [right], [floor])
    return Change(found.names[channel], _rms(left), _rms(right), floor, fraction, interval)


def _total(changes: list[Change], before: np.ndarray, after: np.ndarray, use: np.ndarray) -> Change:
    """Over the channels that have a gap, each in units of its floor."""
    gaps = [i for i, change in enumerate(changes) if change.fraction is not None]
    if not gaps:
        return Change("all", 0.0, 0.0, 1.0, None, None)
    floors = [changes[i].floor for i in gaps]
    scaled = [([before[i][use[i]] / f for i, f in zip(gaps, floors)]), ([after[i][use[i]] / f for i, f in zip(gaps, floors)])]
    fraction, interval = _fraction(scaled[0], scaled[1], [1.0] * len(gaps))
    return Change("all", _rms(np.concatenate(scaled[0])), _rms(np.concatenate(scaled[1])), 1.0, fraction, interval)


def _fraction(before: list[np.ndarray], after: list[np.ndarray], floors: list[float]) -> tuple[float | None, tuple[float, float] | None]:
    """Share of the amplitude above the floor that is gone, and 95 % of it from contiguous pieces drawn again."""
    count = sum(len(values) for values in before)
    floor_squared = float(np.mean([f**2 for f in floors]))
    if count == 0 or floor_squared == 0.0:
        return None, None
    squares = np.array([[sum(float(np.sum(np.array_split(v, PIECES)[p] ** 2)) for v in values) for p in range(PIECES)] for values in (before, after)])
    sizes = np.array([sum(len(np.array_split(v, PIECES)[p]) for v in before) for p in range(PIECES)])
    mean = squares.sum(axis=1) / count
    if mean[0] <= floor_squared * (FLOOR_KNOWN + 3.0 * np.sqrt(2.0 / count)):
        return None, None
    drawn = np.random.default_rng(SEED).integers(0, PIECES, (DRAWS, PIECES))
    again = squares[:, drawn].sum(axis=2) / sizes[drawn].sum(axis=1)
    values = 1.0 - np.sqrt(np.maximum(0.0, again[1] - floor_squared) / np.maximum(again[0] - floor_squared, 1e-6 * again[0]))
    whole = 1.0 - float(np.sqrt(max(0.0, mean[1] - floor_squared) / (mean[0] - floor_squared)))
    low, high = np.quantile(values, [0.025, 0.975])
    return whole, (float(min(low, whole)), float(max(high, whole)))


def held_out_text(found: TwinAnalysis) -> str:
    return f"{FOLDS} stretches of whole segments, each predicted from the others ({found.grid.count} frames of {found.grid.frame_s:g} s)"


