"""Forms: an effect's law may bend away from the one that its record states. Tried on an explanation that leaves something, effect by effect."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from wineglass import effects
from wineglass.diagnosis import curves, explain, system
from wineglass.diagnosis.closure import Closed, Closer, NoNumbersError
from wineglass.diagnosis.responses import REACH, Bench
from wineglass.diagnosis.unknowns import Unknown, differences, freed, held

LEFT = 0.2  # of the noise's energy in a channel: with less than that beyond it, no form has to bend
LEAST_GAIN = 10.0  # nats, in units of what is left
MOST_KEPT = 0.4  # of what is left in the channel that gains most from a bent law: a wrong effect's curve removes some of everything


def bent(closer: Closer, closed: Closed) -> Closed:
    """The explanation with as many of its effects bent as are worth it, the most rewarding first; itself, if none is."""
    while leaves(closer, closed):
        best = max((_gain(closer, closed, forms) for forms in _left_out(closer, closed)), key=lambda found: found[0], default=None)
        if best is None or best[0] < LEAST_GAIN:
            break
        _, forms, jacobian = best
        values = np.concatenate([closed.values, np.zeros(len(forms))])
        followed = None
        with suppress(NoNumbersError):
            straight = _held(closed, forms)
            followed = closer.resume(closed.support, closed.variants, [*straight, *forms], values, np.concatenate([closed.jacobian, jacobian]))
        if followed is None or closer.cost_of(followed) > closer.cost_of(closed) - LEAST_GAIN:
            break
        closed = followed
    return pruned(closer, closed)


def pruned(closer: Closer, closed: Closed) -> Closed:
    """The explanation without the forms that it does not need: one that bent first may have stood for one that bent later, or for another unit, and what is
    not needed predicts nothing. A form stays where it is worth something on all data, and held-out data are foretold better with it."""
    tried: set[tuple[Unknown, ...]] = set()
    while groups := [group for group in _taken(closed) if tuple(closed.unknowns[i] for i in group) not in tried]:
        gram = closed.products.pooled(np.maximum(1.0, _per_frame(closer, closed)))
        first = len(closer.nuisance)
        least = max(groups, key=lambda group: _evidence(gram, [i for i in closed.places if i - first not in group]))
        tried.add(tuple(closed.unknowns[i] for i in least))
        kept = [i for i in range(len(closed.unknowns)) if i not in least]
        with suppress(NoNumbersError):
            unknowns = _freed(closed, least)
            less = closer.resume(closed.support, closed.variants, [unknowns[i] for i in kept], closed.values[kept], closed.jacobian[kept])
            if not _needed(closer, closed, less):
                closed = less
    return closed


def thinned(closer: Closer, closed: Closed) -> Closed:
    """The explanation without the strengths that say nothing, the first one of each effect kept: two effects that do the same are to be told apart by what
    they do, not by how many numbers their records have."""
    softening = np.maximum(1.0, _per_frame(closer, closed))
    for gone in reversed(_beside_the_first(closed)):
        kept = [i for i in range(len(closed.unknowns)) if i != gone]
        with suppress(NoNumbersError):
            less = closer.resume(closed.support, closed.variants, [closed.unknowns[i] for i in kept], closed.values[kept], closed.jacobian[kept])
            if _evidence(less.products.pooled(softening), less.places) >= _evidence(closed.products.pooled(softening), closed.places):
                closed = less
    return closed


def _beside_the_first(closed: Closed) -> list[int]:
    """Places of the strengths of effects that have one before them, and no curve that stands on them."""
    seen = {u.effect for u in closed.unknowns if u.held}
    found = []
    for place, unknown in enumerate(closed.unknowns):
        if unknown.role == "strength" and unknown.effect in seen and not unknown.held:
            found.append(place)
        if unknown.role != "shape":
            seen.add(unknown.effect)
    return found


def _held(closed: Closed, forms: list[Unknown]) -> list[Unknown]:
    """The explanation's unknowns, those of a polynomial that gets a curve beside it held where they are: a curve can be any polynomial, and together they have no
    best values."""
    bends = {form.effect for form in forms if curves.is_point(form.name)}
    return [held(u, float(value)) if u.effect in bends and u.role == "strength" else u
            for u, value in zip(closed.unknowns, closed.values, strict=True)]


def _freed(closed: Closed, gone: list[int]) -> list[Unknown]:
    """The explanation's unknowns, those of a polynomial free again that has lost its curve."""
    straight = {closed.unknowns[i].effect for i in gone if curves.is_point(closed.unknowns[i].name)}
    return [freed(u) if u.effect in straight else u for u in closed.unknowns]


def _needed(closer: Closer, whole: Closed, less: Closed) -> bool:
    """Is the whole worth more than what is less, and does it foretell more?"""
    left = np.maximum(1.0, _per_frame(closer, whole))
    if closer.cost_of(less) < closer.cost_of(whole) + LEAST_GAIN * float(np.max(left, initial=1.0)):
        return False
    foretold, missed = (float(np.sum(explain.held_out(entry.products, left, entry.places) / left)) for entry in (whole, less))
    return foretold < missed


def _taken(closed: Closed) -> list[list[int]]:
    """Places of the forms that an explanation has among its unknowns, those of one effect that go together."""
    groups: dict[tuple[str, bool], list[int]] = {}
    for place, unknown in enumerate(closed.unknowns):
        if unknown.role == "form":
            groups.setdefault((unknown.effect, curves.is_point(unknown.name)), []).append(place)
    return list(groups.values())


def leaves(closer: Closer, closed: Closed) -> bool:
    """Is more left than noise in any channel?"""
    return bool(np.any(_excess(closer, closed, _per_frame(closer, closed)) > 0.0))


def _left_out(closer: Closer, closed: Closed) -> list[list[Unknown]]:
    """Forms that the explanation does not have yet, those of one effect that go together; a curve, which can be anything, after the others."""
    taken = {(u.effect, u.name) for u in closed.unknowns}
    found = []
    for effect in closed.support:
        forms = [u for u in forms_of(effect, closer.bench) if (u.effect, u.name) not in taken]
        numbers, curve = [u for u in forms if not curves.is_point(u.name)], [u for u in forms if curves.is_point(u.name)]
        found += [part for part in (numbers, curve) if part]
    return found


def forms_of(effect: str, bench: Bench) -> list[Unknown]:
    """All that the recording can show something of."""
    record = effects.find(effect)
    hidden = {p.name for p in curves.points(record)} - {p.name for p in curves.seen(record, bench.shell_degc)}
    return [Unknown(effect, p.name, "form", 0.0, 0.0, REACH * p.typical, p.low, p.high) for p in record.parameters if p.form and p.name not in hidden]


def _per_frame(closer: Closer, closed: Closed) -> np.ndarray:
    """(channels,): energy left, nuisances and unknowns at their best."""
    return _per_frame_of(closed.products, closer)


def _per_frame_of(table: system.Products, closer: Closer) -> np.ndarray:
    coefficients, _ = explain.posterior_mean(table.pooled(np.ones(len(closer.system.names))), list(range(table.count)))
    return table.left(coefficients) / np.maximum(closer.system.n_rows, 1)


def _excess(closer: Closer, closed: Closed, left: np.ndarray) -> np.ndarray:
    """(channels,): of the energy left per frame, what is beyond noise, as large as the fastest changes show it; 0 where that is little."""
    noise = closer.system.noise_left(closer.system.data - closer.system.whiten(closed.response)) ** 2
    return np.where(left > (1.0 + LEFT) * noise, left - noise, 0.0)


def _gain(closer: Closer, closed: Closed, forms: list[Unknown]) -> tuple[float, list[Unknown], np.ndarray]:
    """Nats that these forms promise on the linear system about the explanation, in units of what it leaves; the forms, and their Jacobian."""
    unknowns = closed.unknowns + forms
    values = np.concatenate([closed.values, np.zeros(len(forms))])
    jacobian = differences(closer.bench, closer.pick, unknowns, values, closed.response, len(closed.unknowns))
    if not np.all(np.isfinite(jacobian)):
        return -np.inf, [], jacobian
    built = closer.system
    spread = np.array([u.spread for u in unknowns])
    middle = np.array([u.middle for u in unknowns])
    own = built.whiten(np.concatenate([closed.jacobian, jacobian]) * spread[:, None, None])
    table = system.grown(built, closer.table, closer.nuisance, own, (values - middle) / spread, built.data - built.whiten(closed.response))
    left = _per_frame(closer, closed)
    before, after = _excess(closer, closed, left), _excess(closer, closed, _per_frame_of(table, closer))
    if np.all((before == 0.0) | (after > MOST_KEPT * before)):
        return -np.inf, forms, jacobian
    gram = table.pooled(np.maximum(1.0, left))
    everything = list(range(table.count))
    return _evidence(gram, everything) - _evidence(gram, everything[: -len(forms)]), forms, jacobian


def _evidence(gram: np.ndarray, places: list[int]) -> float:
    """Log, of columns."""
    coefficients, determinant = explain.posterior_mean(gram, places)
    return -0.5 * (float(gram[-1, -1] - gram[places, -1] @ coefficients) + determinant)
