"""What a training set teaches: how nulls scatter, and how every variant of every effect moves the features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wineglass.blind.extra import need
from wineglass.blind.sheet import NULLS, Sheet

LEAST_NULLS = 8
LIMIT = 1e3  # a feature this many scatters away says no more by being further


@dataclass(frozen=True)
class Group:
    """Recordings of one device, protocol and loop.

    middle, scale: (f,) of nulls; whiten: (f, f) makes standardised nulls white; signatures: (s, f) unit rows in white features of `ids`"""

    middle: np.ndarray
    scale: np.ndarray
    whiten: np.ndarray
    ids: tuple[frozenset[str], ...]
    signatures: np.ndarray

    def white(self, features: np.ndarray) -> np.ndarray:
        """(f,) or (n, f) -> the same, white on nulls."""
        return np.clip((features - self.middle) / self.scale, -LIMIT, LIMIT) @ self.whiten


@dataclass(frozen=True)
class Training:
    """features: (n, f); sheets: n; groups: by Sheet.group, and "" of all together"""

    features: np.ndarray
    sheets: tuple[Sheet, ...]
    groups: dict[str, Group]

    def group(self, name: str) -> Group:
        return self.groups.get(name, self.groups[""])

    @property
    def white(self) -> np.ndarray:
        return np.array([self.group(sheet.group).white(row) for row, sheet in zip(self.features, self.sheets)])


def learn(features: np.ndarray, sheets: list[Sheet]) -> Training:
    names = sorted({sheet.group for sheet in sheets})
    everything = _group(features, sheets)
    groups = {"": everything}
    for name in names:
        index = [i for i, sheet in enumerate(sheets) if sheet.group == name]
        if sum(sheets[i].tier in NULLS for i in index) >= LEAST_NULLS:
            groups[name] = _group(features[index], [sheets[i] for i in index])
    return Training(features, tuple(sheets), groups)


def _group(features: np.ndarray, sheets: list[Sheet]) -> Group:
    covariance = need("sklearn.covariance")
    nulls = features[[sheet.tier in NULLS for sheet in sheets]]
    if len(nulls) < 2:
        nulls = features
    middle = np.median(nulls, axis=0)
    spread = 1.4826 * np.median(np.abs(nulls - middle), axis=0)
    scale = np.where(spread > 0, spread, np.where(nulls.std(axis=0) > 0, nulls.std(axis=0), np.maximum(1e-9, 1e-6 * np.abs(middle))))
    standard = np.clip((nulls - middle) / scale, -10.0, 10.0)
    fitted = covariance.LedoitWolf(assume_centered=True).fit(standard)
    values, vectors = np.linalg.eigh(fitted.covariance_)
    whiten = vectors / np.sqrt(np.maximum(values, 1e-6))
    group = Group(middle, scale, whiten, (), np.zeros((0, features.shape[1])))
    ids, signatures = _signatures(group.white(features), sheets)
    return Group(middle, scale, whiten, ids, signatures)


def _signatures(white: np.ndarray, sheets: list[Sheet]) -> tuple[tuple[frozenset[str], ...], np.ndarray]:
    """One direction per variant: the one that its singles share, whatever their signs."""
    rows: dict[tuple[str, str], list[np.ndarray]] = {}
    for row, sheet in zip(white, sheets):
        if sheet.tier == "single":
            rows.setdefault((sheet.effects[0].id, sheet.effects[0].variant), []).append(row)
    found = [np.linalg.svd(np.array(each), full_matrices=False)[2][0] for each in rows.values()]
    return tuple(frozenset({id}) for id, _ in rows), np.array(found).reshape(-1, white.shape[1])
