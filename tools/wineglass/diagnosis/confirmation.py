"""Before and after on held-out data, by the full twin: how far an explanation shrinks the gap of every channel."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from wineglass.diagnosis import changes, standing
from wineglass.diagnosis.changes import Change
from wineglass.diagnosis.channels import Frames
from wineglass.diagnosis.closure import Closed
from wineglass.diagnosis.explain import posterior_mean
from wineglass.diagnosis.looks import FREEDOM
from wineglass.diagnosis.responses import Bench
from wineglass.diagnosis.system import FOLDS, Products, products
from wineglass.diagnosis.standing import Standing
from wineglass.diagnosis.twin_level import TwinAnalysis
from wineglass.diagnosis.unit import FARTHEST
from wineglass.effects import Setting
from wineglass.errors import BadInput

STRAIGHT = 60.0  # energy in floors that a linear system may miss of what it corrects about a run of the full twin


@dataclass(frozen=True)
class Confirmed:
    """before, after (channels, n): recorded minus twin, in the channels' units; use (channels, n). values (k,), covariance (k, k): of the
    chosen explanation's unknowns, about the full twin's run."""

    changes: list[Change]
    total: Change
    gained: Change
    """of all channels, against the unit that needs no effect"""
    before: np.ndarray
    after: np.ndarray
    use: np.ndarray
    values: np.ndarray
    covariance: np.ndarray


def confirm(found: TwinAnalysis, chosen: Closed | None) -> Confirmed:
    """chosen: None leaves the gap as it is."""
    recorded, base = _channels(found, found.recorded), _channels(found, found.base)
    nuisance = found.responses.values[list(found.responses.nuisances)][:, found.pick, :]
    before = changes.held_out(found.system, found.table, found.softening, nuisance, recorded - base, found.wandering, FARTHEST)
    after, polished = before.values, None
    if chosen is not None:
        there, frames = _run(found, chosen)
        left = recorded - _channels(found, frames)
        columns = there.columns(found.pick)
        polished = _polish(found, columns, left, np.concatenate([there.bench.centre([name for name, _ in there.slopes]), there.off]))
        limit = np.where(np.arange(polished.count) < polished.count - len(there.unknowns), FARTHEST, np.inf)  # a unit may not take on what is no tolerance
        after = changes.held_out(found.system, polished, found.softening, columns, left, found.wandering, limit).values
    each, total = changes.changes(found.system, before, after)
    values, covariance = (np.zeros(0), np.zeros((0, 0))) if chosen is None or polished is None else _estimate(found, chosen, polished)
    gained = changes.changes(found.system, found.alone, after)[1]
    return Confirmed(each, total, gained, before.values, after, changes.counted(found.system), values, covariance)


def _run(found: TwinAnalysis, chosen: Closed) -> tuple[Standing, Frames]:
    """The full twin with the explanation: where it was run last, if the same numbers are meant and a straight line leads from there."""
    if found.ran is not None and found.ran[0].unknowns == chosen.unknowns and _bend(found, found.ran[0], chosen) < STRAIGHT:
        return found.ran
    there = Standing(found.bench, chosen.unknowns, chosen.values, chosen.jacobian)
    return there, standing.run(there)


def _bend(found: TwinAnalysis, there: Standing, chosen: Closed) -> float:
    """Energy in floors by which the envelope twin's way from a standing to the explanation misses its slopes there."""
    way = chosen.response - (there.envelope - there.bench.nominal)[found.pick]
    straight = np.tensordot(chosen.values - there.values, there.jacobian, 1) if there.jacobian is not None else 0.0
    return float(np.sum(found.system.whiten(way - straight) ** 2))


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


def contributions(found: TwinAnalysis, closed: Closed) -> dict[str, np.ndarray]:
    """(channels, n) whitened: what each effect alone does."""
    if len(closed.support) == 1:
        return {closed.support[0]: found.system.whiten(closed.response)}
    return {setting.id: found.system.whiten(_alone(found.bench, closed, setting)[found.pick]) for setting in closed.settings}


def _alone(bench: Bench, closed: Closed, setting: Setting) -> np.ndarray:
    """(channels, n): what one effect does without the others; where the twin refuses it without them, what it adds to them."""
    with suppress(BadInput):
        return bench.tried([setting])
    with suppress(BadInput):
        return bench.run(closed.settings) - bench.run([other for other in closed.settings if other is not setting])
    return np.zeros_like(bench.nominal)


def held_out_text(found: TwinAnalysis) -> str:
    return f"{FOLDS} stretches of whole segments, each predicted from the others ({found.grid.count} frames of {found.grid.frame_s:g} s)"
