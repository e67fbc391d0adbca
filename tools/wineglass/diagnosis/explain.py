"""Which sets of effects explain the system: marginal likelihoods in closed form, all sets up to three, and what stays unexplained.

* Nuisances are integrated over within their tolerances; so are the strengths, with priors of some ten typical sizes.
* Functional forms are only roughly those of nature. A channel in which an effect explains an energy E (in units of noise) is believed to one part in
  FORM of its amplitude only: its products are divided by 1 + FORM^2 E.
* What is left is held against a generic discrepancy in each channel: smooth in time, or following temperature, rate or amplitude. A set of effects
  with such a discrepancy is known and unknown together.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import lsq_linear

from wineglass.diagnosis.responses import Responses, Variant
from wineglass.diagnosis.system import FOLDS, Products
from wineglass.diagnosis.unit import FARTHEST

FORM = 0.03
BEYOND = 20.0  # nats per standard deviation that a unit would have to be further off than any unit is
INCLUSION = 0.02
GENERIC_PRIOR = 0.003  # that a channel holds a discrepancy of no known kind
FLOOR_KNOWN = 1.15  # the floor's variance comes from a short run: it is known to a seventh
GENERIC_SIZES = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
KEPT_VARIANTS = 2
KEPT_PAIRS = 40
SHORTLIST = 6
JITTER = 1e-12  # relative
Support = tuple[str, ...]


@dataclass(frozen=True)
class Explained:
    """One set of effects: log evidence with priors, without and with a generic discrepancy; coefficients (nuisances first), counted from zero."""

    support: Support
    variants: tuple[Variant, ...]
    log_evidence: float
    log_generic: float
    left: np.ndarray
    """(channels,) energy left"""
    coefficients: np.ndarray


def prior_of(variants: Iterable[Variant], counts: dict[str, int]) -> float:
    return sum(float(np.log(INCLUSION / (1.0 - INCLUSION)) - np.log(counts[v.effect])) for v in variants)


def explained(products: Products, softening: np.ndarray, nuisances: int, columns: list[int], variants: tuple[Variant, ...], log_prior: float, tolerances: int = 0
              ) -> Explained:
    """columns: places of the effects' columns in the products; the first `nuisances` are the nuisances', the first `tolerances` of them a unit's."""
    places = [*range(nuisances), *columns]
    block = products.everywhere(places)
    gram = products.with_priors(block, places, softening)
    coefficients, log_determinant = posterior_mean(gram, list(range(len(places))))
    evidence = -0.5 * (float(gram[-1, -1] - gram[:-1, -1] @ coefficients) + log_determinant) + log_prior
    off = np.abs(products.about[:tolerances] + coefficients[:tolerances])
    evidence -= BEYOND * float(np.sum(np.maximum(0.0, off - FARTHEST)))
    combination = np.append(-coefficients, 1.0)
    generic = sum(_generic(basis[:, [*places, -1]] @ combination, softening[c]) for c, basis in enumerate(products.generic))
    support = tuple(sorted({v.effect for v in variants}))
    return Explained(support, variants, evidence, float(generic), (block @ combination) @ combination, products.about[places] + coefficients)


def posterior_mean(gram: np.ndarray, places: list[int]) -> tuple[np.ndarray, float]:
    """Coefficients of `places` with normal priors of unit size, and log det(1 + their products)."""
    part = gram[np.ix_(places, places)]
    size = np.sqrt(np.maximum(np.diagonal(part), 1e-12))
    precision = 1.0 / size**2 + JITTER
    factor = cho_factor(part / np.outer(size, size) + np.diag(precision))
    determinant = 2.0 * float(np.sum(np.log(np.diagonal(factor[0])))) - float(np.sum(np.log(precision)))
    return cho_solve(factor, gram[places, -1] / size) / size, determinant


def within(gram: np.ndarray, places: list[int], middle: np.ndarray, limit: float | np.ndarray) -> np.ndarray:
    """Coefficients of `places` that stay within limit (one, or of each) standard deviations of their priors' middles: bounded least squares, priors included."""
    found, _ = posterior_mean(gram, places)
    part = gram[np.ix_(places, places)]
    size = np.sqrt(np.maximum(np.diagonal(part), 1e-12))
    inner, target = part / np.outer(size, size) + np.diag(1.0 / size**2 + JITTER), gram[places, -1] / size
    bounded = np.zeros(len(places), bool)
    while np.any(beyond := (np.abs(found - middle) > limit * (1.0 + 1e-9)) & ~bounded):  # few ever are: only these need the slow solution
        bounded |= beyond
        found = _bounded(inner, target, bounded, (middle - limit) * size, (middle + limit) * size) / size
    return found


def _bounded(inner: np.ndarray, target: np.ndarray, bounded: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The least of x (inner/2) x - target x where some stay between low and high, and the others are at their best beside them."""
    free, found = ~bounded, np.zeros(len(target))
    beside = np.linalg.solve(inner[np.ix_(free, free)], np.column_stack([inner[np.ix_(free, bounded)], target[free]]))
    reduced = inner[np.ix_(bounded, bounded)] - inner[np.ix_(bounded, free)] @ beside[:, :-1]
    factor = np.linalg.cholesky(0.5 * (reduced + reduced.T))
    projected = solve_triangular(factor, target[bounded] - inner[np.ix_(bounded, free)] @ beside[:, -1], lower=True)
    found[bounded] = lsq_linear(factor.T, projected, bounds=(low[bounded], high[bounded]), method="bvls").x
    found[free] = beside[:, -1] - beside[:, :-1] @ found[bounded]
    return found


def _generic(projection: np.ndarray, softening: float) -> float:
    """Log of (1 - p) + p BF for one channel, with BF averaged over sizes of the discrepancy."""
    energy = float(projection @ projection) / softening / FLOOR_KNOWN
    size = np.array(GENERIC_SIZES) ** 2
    factors = -0.5 * len(projection) * np.log1p(size) + 0.5 * size / (1.0 + size) * energy
    log_factor = float(np.logaddexp.reduce(factors)) - np.log(len(size))
    return float(np.logaddexp(np.log1p(-GENERIC_PRIOR), np.log(GENERIC_PRIOR) + log_factor))


@dataclass(frozen=True)
class Ranking:
    """Supports in order of evidence (with a generic discrepancy allowed), best first, one entry per support."""

    entries: list[Explained]
    none: Explained

    def best(self, size: int) -> list[Explained]:
        return [entry for entry in self.entries if len(entry.support) == size]


def rank(products: Products, responses: Responses, softening: np.ndarray, shortlist: bool = False) -> Ranking:
    """All single effects with all variants; pairs and triples with the variants that do best. shortlist: the few best alone are looked at closely, to know how
    much can be explained."""
    nuisances = len(responses.nuisances)
    reduced = _Reduced(products.pooled(softening), nuisances)
    counts = {effect: len(variants) for effect, variants in responses.variants.items()}

    def entry(variants: tuple[Variant, ...]) -> Explained:
        columns = [c for v in variants for c in v.columns]
        return explained(products, softening, nuisances, columns, variants, prior_of(variants, counts), responses.tolerances)

    kept: list[Variant] = []
    singles: dict[tuple[Variant, ...], float] = {}
    everything = [variant for variants in responses.variants.values() for variant in variants]
    alone = dict(zip(everything, reduced.evidence([v.columns for v in everything]), strict=True))
    first = max(everything, key=lambda v: alone[v] - np.log(counts[v.effect]))
    beside = dict(zip(everything, reduced.evidence([tuple(dict.fromkeys(first.columns + v.columns)) for v in everything]), strict=True))
    for effect, variants in responses.variants.items():
        order = sorted(variants, key=lambda v: -alone[v])[:KEPT_VARIANTS] + sorted(variants, key=lambda v: -beside[v])[:1]
        chosen = list(dict.fromkeys(order))
        kept += chosen
        singles |= {(v,): alone[v] + prior_of((v,), counts) for v in chosen}
    pairs = _scored(reduced, [(a, b) for a, b in combinations(kept, 2) if a.effect != b.effect], counts)
    best_pairs = sorted(pairs, key=lambda p: -pairs[p])[:KEPT_PAIRS]
    triples = _scored(reduced, _grown(best_pairs, kept), counts)
    order = sorted((singles | pairs | triples).items(), key=lambda item: -item[1])
    entries = [entry(variants) for variants in ([v for v, _ in order[:SHORTLIST]] if shortlist else _one_per_support(order))]
    return Ranking(sorted(entries, key=lambda e: -(e.log_evidence + e.log_generic)), entry(()))


def _grown(pairs: list[tuple[Variant, ...]], kept: list[Variant]) -> list[tuple[Variant, ...]]:
    found: dict[frozenset[Variant], tuple[Variant, ...]] = {}
    for a, b in pairs:
        for c in kept:
            if c.effect not in (a.effect, b.effect):
                found.setdefault(frozenset((a, b, c)), (a, b, c))
    return list(found.values())


def _one_per_support(order: list[tuple[tuple[Variant, ...], float]], limit: int = 24) -> list[tuple[Variant, ...]]:
    """The best choice of variants for the best supports, and for every single effect."""
    found: dict[frozenset[str], tuple[Variant, ...]] = {}
    for variants, _ in order:
        support = frozenset(v.effect for v in variants)
        if support not in found and (len(found) < limit or len(support) == 1):
            found[support] = variants
    return list(found.values())


def _scored(reduced: _Reduced, sets: list[tuple[Variant, ...]], counts: dict[str, int]) -> dict[tuple[Variant, ...], float]:
    values = reduced.evidence([tuple(c for v in variants for c in v.columns) for variants in sets])
    return {variants: float(value) + prior_of(variants, counts) for variants, value in zip(sets, values, strict=True)}


class _Reduced:
    """Products of the effects' columns with the nuisances integrated out."""

    def __init__(self, gram: np.ndarray, nuisances: int):
        n = nuisances
        self._size = np.sqrt(np.maximum(np.diagonal(gram), 1e-12))
        self._size[-1] = 1.0
        gram = gram / np.outer(self._size, self._size)
        factor = cho_factor(gram[:n, :n] + np.diag(self._precision(np.arange(n))))
        self._gram = gram - gram[:, :n] @ cho_solve(factor, gram[:n, :])

    def _precision(self, columns: np.ndarray) -> np.ndarray:
        """Of the priors, for columns of length one; a little more keeps twins of twins solvable."""
        return 1.0 / self._size[columns] ** 2 + JITTER

    def evidence(self, sets: list[tuple[int, ...]]) -> np.ndarray:
        """Log marginal likelihood of each set of columns over none."""
        values = np.empty(len(sets))
        by_size: dict[int, list[int]] = {}
        for i, columns in enumerate(sets):
            by_size.setdefault(len(columns), []).append(i)
        for size, members in by_size.items():
            columns = np.array([sets[i] for i in members], int).reshape(len(members), size)
            precision = self._precision(columns)
            inner = self._gram[columns[:, :, None], columns[:, None, :]] + precision[:, :, None] * np.eye(size)
            factor = np.linalg.cholesky(inner)
            projected = np.linalg.solve(factor, self._gram[columns, -1][:, :, None])[:, :, 0]
            determinant = 2.0 * np.sum(np.log(np.diagonal(factor, axis1=1, axis2=2)), axis=1) - np.sum(np.log(precision), axis=1)
            values[members] = 0.5 * (np.sum(projected**2, axis=1) - determinant)
        return values


def strain(entry: Explained, nuisances: int) -> float:
    """How far from its description a unit has to be beside an explanation: half the energy of its priors."""
    return 0.5 * float(np.sum(entry.coefficients[:nuisances] ** 2))


def softening_of(none: Explained, best: Explained) -> np.ndarray:
    """(channels,): how far the channels' products are to be believed, from the energy that the best explanation explains there."""
    return 1.0 + FORM**2 * np.maximum(0.0, none.left - best.left)


def held_out(products: Products, softening: np.ndarray, places: list[int], limit: float | np.ndarray | None = None) -> np.ndarray:
    """(folds, channels): energy left in each fold when `places` are fitted on the others. limit (one, or of each): none may be further from its prior's middle."""
    left = np.empty(products.gram.shape[:2])
    for fold in range(FOLDS):
        gram = products.pooled(softening, [f for f in range(FOLDS) if f != fold])
        combination = np.zeros(products.count + 1)
        fitted = posterior_mean(gram, places)[0] if limit is None else within(gram, places, -products.about[places], limit)
        combination[places] = -fitted
        combination[-1] = 1.0
        left[fold] = (products.gram[fold] @ combination) @ combination
    return left
