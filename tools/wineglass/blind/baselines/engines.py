"""The baselines: white features of one case -> how large the gap is, and what each explanation weighs."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from wineglass.blind.baselines.training import Group, Training
from wineglass.blind.extra import need
from wineglass.blind.marks import truth_of

Weights = dict[frozenset[str], float]
NONE, OTHER = frozenset({"none"}), frozenset({"other"})
MOST = 3  # effects at once
SHARPNESS = 8.0  # of the weights over the cosine or explained share


@dataclass(frozen=True)
class Found:
    """gap: any number that grows with the gap; weights: of the explanations, given that there is a gap; sum 1"""

    gap: float
    weights: Weights


Baseline = Callable[[np.ndarray, Group], Found]


def nearest_signature(white: np.ndarray, group: Group) -> Found:
    """The direction in which the features moved against those of the training set's singles."""
    cosines = group.signatures @ white / max(float(np.linalg.norm(white)), 1e-12)
    return Found(float(np.linalg.norm(white)), _softmax([(ids, SHARPNESS * abs(value)) for ids, value in zip(group.ids, cosines)]))


def lasso(white: np.ndarray, group: Group) -> Found:
    """Sparse coefficients on all signatures, the penalty at a tenth of the one that leaves nothing."""
    model = need("sklearn.linear_model")
    start = float(np.max(np.abs(group.signatures @ white))) / len(white) if len(group.ids) else 0.0
    if start == 0.0:
        return Found(float(np.linalg.norm(white)), {OTHER: 1.0})
    fitted = model.Lasso(alpha=0.1 * start, fit_intercept=False, max_iter=5000).fit(group.signatures.T, white)
    return _sparse(white, group, fitted.coef_)


def thresholding(white: np.ndarray, group: Group) -> Found:
    """Sequentially thresholded least squares, as sparse identification of dynamics does it."""
    optimisers = need("pysindy").optimizers
    size = float(np.linalg.norm(white))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that nothing is left is an answer
            fitted = optimisers.STLSQ(threshold=0.2 * size, alpha=0.05, max_iter=50).fit(group.signatures.T, white[:, None])
    except ValueError:
        return Found(size, {OTHER: 1.0})
    return _sparse(white, group, np.ravel(fitted.coef_))


def stepwise(white: np.ndarray, group: Group) -> Found:
    """Forward: the signature that explains most, then the next, as long as each takes enough."""
    chosen: list[int] = []
    left, penalty = white, np.log(len(white)) * max(1.0, float(white @ white) / len(white) / 20.0)
    while len(chosen) < MOST and len(group.ids):
        gains = (group.signatures @ left) ** 2
        best = int(np.argmax(gains))
        if gains[best] < penalty or best in chosen:
            break
        chosen.append(best)
        columns = group.signatures[chosen].T
        left = white - columns @ np.linalg.lstsq(columns, white, rcond=None)[0]
    coefficients = np.zeros(len(group.ids))
    if chosen:
        coefficients[chosen] = np.linalg.lstsq(group.signatures[chosen].T, white, rcond=None)[0]
    return _sparse(white, group, coefficients)


def forest(training: Training, seed: int = 1) -> Baseline:
    """A random forest on features of all training cases; what is not in the catalogue is a class, too."""
    trees = need("sklearn.ensemble")
    truths = [truth_of(sheet) for sheet in training.sheets]
    classes = sorted({",".join(sorted(OTHER if "other" in ids else ids)) for ids in truths})
    fitted = trees.RandomForestClassifier(300, min_samples_leaf=2, random_state=seed, n_jobs=1)
    fitted.fit(_squash(training.white), [classes.index(",".join(sorted(OTHER if "other" in ids else ids))) for ids in truths])
    names = [frozenset(classes[index].split(",")) for index in fitted.classes_]

    def answer(white: np.ndarray, group: Group) -> Found:
        weights = dict(zip(names, fitted.predict_proba(_squash(white[None]))[0], strict=True))
        none = weights.pop(NONE, 0.0)
        return Found(1.0 - none, {ids: p / max(1.0 - none, 1e-12) for ids, p in weights.items()} if none < 1.0 else {OTHER: 1.0})

    return answer


UNTAUGHT: dict[str, Baseline] = {"nearest_signature": nearest_signature, "lasso": lasso, "thresholding": thresholding, "stepwise": stepwise}


def baselines(training: Training) -> dict[str, Baseline]:
    return {**UNTAUGHT, "random_forest": forest(training)}


def _sparse(white: np.ndarray, group: Group, coefficients: np.ndarray) -> Found:
    """Energy by effect; the support takes the share of the energy that it explains, parts of it and `other` the rest."""
    size, energy = float(np.linalg.norm(white)), {}
    for ids, value in zip(group.ids, coefficients):
        energy[ids] = energy.get(ids, 0.0) + float(value) ** 2
    ranked = [ids for ids in sorted(energy, key=lambda one: -energy[one]) if energy[ids] > 0.05 * sum(energy.values())][:MOST]
    if not ranked:
        return Found(size, {OTHER: 1.0})
    left = white - coefficients @ group.signatures
    explained = max(0.0, 1.0 - float(left @ left) / max(size**2, 1e-12))
    supports = [frozenset().union(*chosen) for count in range(1, len(ranked) + 1) for chosen in combinations(ranked, count)]
    part = {ids: sum(energy[one] for one in ranked if one <= ids) / sum(energy[one] for one in ranked) for ids in supports}
    return Found(size, _softmax([*((ids, SHARPNESS * explained * value) for ids, value in part.items()), (OTHER, SHARPNESS * (1.0 - explained))]))


def _softmax(scores: list[tuple[frozenset[str], float]]) -> Weights:
    """The best entry of each explanation counts."""
    best: Weights = {}
    for ids, value in scores:
        best[ids] = max(value, best.get(ids, -np.inf))
    if not best:
        return {OTHER: 1.0}
    top = max(best.values())
    total = sum(float(np.exp(value - top)) for value in best.values())
    return {ids: float(np.exp(value - top)) / total for ids, value in best.items()}


def _squash(white: np.ndarray) -> np.ndarray:
    """Large values near each other: trees split better."""
    return np.arcsinh(white)
