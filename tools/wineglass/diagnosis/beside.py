"""Is there one more effect beside an explanation? Tried on a linear system about it, where its own unknowns and what is uncertain move along."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from wineglass.diagnosis import explain, system
from wineglass.diagnosis.closure import Closed, Closer, NoNumbersError
from wineglass.diagnosis.explain import Explained
from wineglass.diagnosis.responses import Variant

LARGEST = 3  # effects: what has to be explained by more is something else
TRIED = 3  # single effects that are closed beside the explanation
LEAST_GAIN = 4.0  # nats, their priors included


def beside(closer: Closer, best: Closed, counts: dict[str, int]) -> list[Closed]:
    """The explanation with one more effect each: the most promising ones, and the one beside which the unit is least off its description, because tolerances that
    took on a gap are in no channel's way."""
    if len(best.support) >= LARGEST:
        return []
    built, found = closer.system, closer.responses
    spread, middle = np.array([u.spread for u in best.unknowns]), np.array([u.middle for u in best.unknowns])
    own = built.whiten(best.jacobian * spread[:, None, None])
    table = system.grown(built, closer.table, closer.columns, own, (best.values - middle) / spread, built.data - built.whiten(best.response))
    softening = np.maximum(1.0, best.entry.left / np.maximum(built.n_rows, 1))
    nuisances, behind = len(found.nuisances), list(range(len(closer.columns), table.count))
    alone = explain.explained(table, softening, nuisances, behind, (), 0.0)

    def tried(variant: Variant) -> Explained:
        return explain.explained(table, softening, nuisances, [*behind, *variant.columns], (variant,), explain.prior_of((variant,), counts))

    more = [max((tried(v) for v in variants), key=lambda entry: entry.log_evidence)
            for effect, variants in found.variants.items() if effect not in best.support]
    able = sorted((e for e in more if e.log_evidence > alone.log_evidence + LEAST_GAIN), key=lambda e: -e.log_evidence)
    ordinary = sorted(able, key=lambda entry: explain.strain(entry, nuisances))[:1]
    closed = []
    for entry in {entry.support: entry for entry in [*able[:TRIED], *ordinary]}.values():
        with suppress(NoNumbersError):
            closed.append(closer.beside(best, _alone(entry, nuisances + len(own), nuisances)))
    return closed


def _alone(entry: Explained, first: int, nuisances: int) -> Explained:
    """The entry as one of a system without the explanation's own unknowns."""
    coefficients = np.concatenate([entry.coefficients[:nuisances], entry.coefficients[first:]])
    return Explained(entry.support, entry.variants, entry.log_evidence, entry.log_generic, entry.left, coefficients)
