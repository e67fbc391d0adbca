"""Marginal likelihood of every support, variant and noise model, from one Gram matrix per noise model.

Coefficients have standard normal priors (their sizes are in the columns); the noise's size is known to about a tenth, so a Student density
comes out. All of it is closed form; the supports are enumerated, not searched.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np
from scipy.special import gammaln, logsumexp

from wineglass.diagnosis.columns import Design, Variant
from wineglass.diagnosis.noise_models import CLASSES, NoiseModel, whiten

MAX_EFFECTS = 3
INCLUSION_PRIOR = 0.08
FEW = 10  # effects: where a device description offers more, sets hold two at most, and all together are expected as often
FREEDOM = 120.0  # of the prior on the noise's size
UNLIKELY_NATS = 8.0  # a variant this much worse than the best is left out of larger supports
TWINS = ({"coriolis_gain", "rate_reference"}, {"cross_damping", "thermometer_error"})  # never asked for together


@dataclass(frozen=True)
class Candidate:
    """One support with one variant of each of its effects. columns: all of its columns; target: index of the static curve."""

    support: tuple[str, ...]
    variants: tuple[Variant, ...]
    static: int
    columns: tuple[int, ...]
    log_prior: float


def enumerate_candidates(
    design: Design, without: frozenset[str] = frozenset(), sizes: range = range(MAX_EFFECTS + 1), kept: dict[str, list[Variant]] | None = None
) -> list[Candidate]:
    """sizes: how many effects at a time; kept: of these effects, only these variants."""
    names = [name for name in design.effects if name not in without]
    inclusion = INCLUSION_PRIOR * min(1.0, FEW / max(1, len(names)))
    found = []
    for size in sizes:
        for support in combinations(names, size):
            if any(twins <= set(support) for twins in TWINS):
                continue
            options = [design.effects[name] for name in support]
            prior = size * np.log(inclusion / (1.0 - inclusion)) - sum(np.log(len(o)) for o in options)
            chosen = [kept[name] if kept is not None else design.effects[name] for name in support]
            found += [_candidate(design, support, variants, prior) for variants in product(*chosen)]
    return found


def _candidate(design: Design, support: tuple[str, ...], variants: tuple[Variant, ...], prior: float) -> Candidate:
    static = next((v.static for v in variants if v.static is not None), 0)
    columns = design.statics[static] + tuple(c for v in variants for c in v.columns)
    if "cross_damping" in support:
        columns += design.cross[static]
    return Candidate(support, variants, static, columns, float(prior))


@dataclass(frozen=True)
class Scores:
    """log_evidence (candidates, noise models), with all priors."""

    candidates: list[Candidate]
    noise: list[NoiseModel]
    log_evidence: np.ndarray

    @cached_property
    def supports(self) -> list[tuple[str, ...]]:
        return list(dict.fromkeys(c.support for c in self.candidates))

    @cached_property
    def by_support(self) -> np.ndarray:
        """(supports, classes): log evidence of each support with each class of remainder."""
        rows = {support: [] for support in self.supports}
        for i, candidate in enumerate(self.candidates):
            rows[candidate.support].append(i)
        kinds = [[j for j, m in enumerate(self.noise) if m.kind == kind] for kind in CLASSES]
        return np.array([[logsumexp(self.log_evidence[np.ix_(r, k)]) if k else -np.inf for k in kinds] for r in rows.values()])


def score(design: Design, noise: list[NoiseModel], white: float, candidates: list[Candidate], rows: np.ndarray | None = None) -> Scores:
    """rows: blocks to use, None: all."""
    rows = np.arange(len(design.target)) if rows is None else rows
    groups = _groups(candidates)
    matrix = np.column_stack([design.matrix[rows], design.static_targets[:, rows].T]) / white
    first_target = design.matrix.shape[1]
    log_evidence = np.empty((len(candidates), len(noise)))
    log_priors = np.array([c.log_prior for c in candidates])
    for j, model in enumerate(noise):
        factor, log_determinant = model.whitener(rows)
        whitened = whiten(factor, matrix)
        gram = whitened.T @ whitened
        for members, columns, targets in groups:
            value = _evidence(gram, columns, first_target + targets, len(rows), log_determinant)
            log_evidence[members, j] = value + log_priors[members] + model.log_prior
    return Scores(candidates, noise, log_evidence)


def score_all(design: Design, noise: list[NoiseModel], white: float, without: frozenset[str] = frozenset()) -> Scores:
    """All supports; those of three effects only with variants that count for something in a smaller one."""
    if len(design.effects) > FEW:
        return score(design, noise, white, enumerate_candidates(design, without, range(3)))
    few = score(design, noise, white, enumerate_candidates(design, without, range(min(MAX_EFFECTS, 3))))
    likely: dict[str, list[Variant]] = {name: [] for name in design.effects}
    best = few.log_evidence.max(axis=1)
    for support in few.supports:
        rows = [i for i, c in enumerate(few.candidates) if c.support == support]
        top = best[rows].max()
        for i in rows:
            if best[i] >= top - UNLIKELY_NATS:
                for name, variant in zip(support, few.candidates[i].variants):
                    likely[name] += [] if variant in likely[name] else [variant]
    many = score(design, noise, white, enumerate_candidates(design, without, range(3, MAX_EFFECTS + 1), likely))
    return Scores([*few.candidates, *many.candidates], noise, np.vstack([few.log_evidence, many.log_evidence]))


def _groups(candidates: list[Candidate]) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Candidates with equally many columns together: (their indices (m,), columns (m, k), static curves (m,))"""
    by_size: dict[int, list[int]] = {}
    for i, candidate in enumerate(candidates):
        by_size.setdefault(len(candidate.columns), []).append(i)
    return [
        (np.array(members), np.array([candidates[i].columns for i in members], int).reshape(len(members), size),
         np.array([candidates[i].static for i in members]))
        for size, members in by_size.items()
    ]


def _evidence(gram: np.ndarray, columns: np.ndarray, targets: np.ndarray, count: int, log_determinant: float) -> np.ndarray:
    squares = gram[targets, targets]
    log_posterior_determinant = np.zeros(len(columns))
    if columns.shape[1]:
        inner = gram[columns[:, :, None], columns[:, None, :]] + np.eye(columns.shape[1])
        factor = np.linalg.cholesky(inner)
        projected = np.linalg.solve(factor, gram[columns, targets[:, None]][:, :, None])[:, :, 0]
        squares = squares - np.sum(projected**2, axis=1)
        log_posterior_determinant = 2.0 * np.sum(np.log(np.diagonal(factor, axis1=1, axis2=2)), axis=1)
    total = FREEDOM + count
    constant = gammaln(0.5 * total) - gammaln(0.5 * FREEDOM) - 0.5 * count * np.log(np.pi * FREEDOM)
    return constant - 0.5 * (log_determinant + log_posterior_determinant + total * np.log1p(np.maximum(squares, 0.0) / FREEDOM))


@dataclass(frozen=True)
class Fit:
    """Coefficients of one candidate under one noise model, from `rows`: mean (k,), covariance (k, k), weight in the mixture."""

    candidate: Candidate
    mean: np.ndarray
    covariance: np.ndarray
    weight: float
    noise: NoiseModel


def fits(design: Design, scores: Scores, white: float, support: tuple[str, ...], rows: np.ndarray, least: float = 0.01) -> list[Fit]:
    """The mixture for one support: every (variant, noise model) with at least `least` of the best one's weight."""
    members = [i for i, c in enumerate(scores.candidates) if c.support == support]
    block = scores.log_evidence[members]
    weights = np.exp(block - block.max())
    found = []
    whitened: dict[int, np.ndarray] = {}
    for place, j in zip(*np.nonzero(weights >= least)):
        candidate = scores.candidates[members[place]]
        if j not in whitened:
            matrix = np.column_stack([design.matrix[rows], design.static_targets[:, rows].T]) / white
            whitened[j] = whiten(scores.noise[j].whitener(rows)[0], matrix)
        columns = whitened[j][:, list(candidate.columns)]
        target = whitened[j][:, design.matrix.shape[1] + candidate.static]
        covariance = np.linalg.inv(columns.T @ columns + np.eye(columns.shape[1]))
        mean = covariance @ (columns.T @ target)
        rest = target @ target - mean @ (columns.T @ target)
        size = (FREEDOM + max(rest, 0.0)) / (FREEDOM + len(rows))
        found.append(Fit(candidate, mean, covariance * size, float(weights[place, j]), scores.noise[j]))
    total = sum(f.weight for f in found)
    return [Fit(f.candidate, f.mean, f.covariance, f.weight / total, f.noise) for f in found]


def residual(design: Design, mixture: list[Fit]) -> np.ndarray:
    """Data minus the mixture's mean prediction, all blocks (n,) [rad/s]."""
    total = np.zeros(len(design.target))
    for fit in mixture:
        total += fit.weight * (design.static_targets[fit.candidate.static] - design.matrix[:, list(fit.candidate.columns)] @ fit.mean)
    return total


def variance(design: Design, mixture: list[Fit]) -> np.ndarray:
    """Of the mixture's prediction (n,) [rad^2/s^2], for what the coefficients are uncertain."""
    middle = design.static_targets[0] - residual(design, mixture)
    total = np.zeros(len(design.target))
    for fit in mixture:
        columns = design.matrix[:, list(fit.candidate.columns)]
        apart = design.static_targets[0] - design.static_targets[fit.candidate.static] + columns @ fit.mean - middle
        total += fit.weight * (np.einsum("ij,jk,ik->i", columns, fit.covariance, columns, optimize=True) + apart**2)
    return total
