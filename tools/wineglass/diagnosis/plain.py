"""Could anything else have made this gap? Plain laws - a channel that follows a constant, time, temperature, its speed, rate, amplitude, or a product of them -
are laid on what an explanation does. If as few of them do the same as the explanation has numbers of its own, the recording shows nothing that only this
explanation foretells: whatever obeys such a law would look like it."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from wineglass.diagnosis import confirmation, curves, task
from wineglass.diagnosis.closure import Closed
from wineglass.diagnosis.twin_level import TwinAnalysis

ENOUGH = 0.1  # of the amplitude of what the explanation does, that plain laws may leave
NOISE = 4.0  # energy: less is nothing
MOST = 5  # laws that are tried
LEAST_LENGTH = 1e-3  # of a law, whitened: below it the recording does not show it


BY_DEFINITION = frozenset({"thermal_gradient", "ageing", "thermal_hysteresis"})
"""Effects that are nothing but a law of the bias: whatever obeys it is called so"""
LATE = frozenset({"thermal_gradient"})
"""... unless the law is bent: a bias that follows the speed late follows the shell's temperature over that of something else, wherever that is"""


def imitated(found: TwinAnalysis, closed: Closed) -> frozenset[str]:
    """Effects of an explanation that as few plain laws do as each has numbers, what is uncertain moving along: all of them, where that is so of them together,
    and every one of which it is so alone. Not asked of effects that are such a law by definition; one that has to be bent is not."""
    bent = frozenset(u.effect for u in closed.unknowns if u.role == "form" and u.effect in LATE)
    return bent | _as_few(found, closed)


def _as_few(found: TwinAnalysis, closed: Closed) -> frozenset[str]:
    if set(closed.support) <= BY_DEFINITION:
        return frozenset()
    laws = _Laws(found)
    if laws.needed(found.system.whiten(closed.response), _numbers(closed, closed.support)) <= _numbers(closed, closed.support):
        return frozenset(closed.support)
    if len(closed.support) == 1:
        return frozenset()
    parts = {effect: part for effect, part in confirmation.contributions(found, closed).items() if effect not in BY_DEFINITION}
    return frozenset(effect for effect, part in parts.items() if laws.needed(part, _numbers(closed, (effect,))) <= _numbers(closed, (effect,)))


def _numbers(closed: Closed, effects: Collection[str]) -> int:
    """That these effects have in an explanation; a bent law of one effect counts once."""
    straight = sum(u.effect in effects and u.role != "form" for u in closed.unknowns)
    bent = {(u.effect, curves.is_point(u.name)) for u in closed.unknowns if u.effect in effects and u.role == "form"}
    return min(MOST, straight + len(bent))


class _Laws:
    """Plain laws in every channel, what is uncertain moving along."""

    def __init__(self, found: TwinAnalysis):
        self._known = found.system.whiten(found.responses.values[list(found.responses.nuisances)][:, found.pick, :]).reshape(len(found.responses.nuisances), -1)
        self._rows = _laws(found)
        self._factor = cho_factor(self._known @ self._known.T + np.eye(len(self._known)))
        self._across = self._known @ self._rows.T
        self._gram = self._rows @ self._rows.T - self._across.T @ cho_solve(self._factor, self._across)

    def needed(self, white: np.ndarray, most: int) -> int:
        """Laws that do what (channels, n), whitened, does, the one that does most taken first, and again; most + 1: so many are not enough."""
        wanted = white.ravel()
        along = self._known @ wanted
        behind = cho_solve(self._factor, along)
        return _picked(self._gram, self._rows @ wanted - self._across.T @ behind, float(wanted @ wanted - along @ behind), most)


def _picked(gram: np.ndarray, match: np.ndarray, whole: float, most: int) -> int:
    """gram (k, k), match (k,): products of the laws with each other and with what is wanted, whose own is whole."""
    length = np.sqrt(np.maximum(np.diagonal(gram), 0.0))
    able, chosen, rest = np.flatnonzero(length > LEAST_LENGTH), list[int](), match
    for count in range(1, min(most, len(able)) + 1):
        chosen.append(int(able[np.argmax(np.abs(rest[able]) / length[able])]))
        sizes = np.linalg.lstsq(gram[np.ix_(chosen, chosen)], match[chosen], rcond=None)[0]
        rest = match - gram[:, chosen] @ sizes
        if whole - float(match[chosen] @ sizes) <= max(NOISE, ENOUGH**2 * whole):
            return count
    return most + 1


def _laws(found: TwinAnalysis) -> np.ndarray:
    """(k, channels x n), whitened: in each channel each of them."""
    n, count = found.grid.count, len(found.names)
    rows = np.concatenate([np.ones((1, n)), np.linspace(-1.0, 1.0, n)[None], task.regressors(found.driven, found.bench, found.base)])
    laws = np.zeros((count, len(rows), count, n))
    for channel in range(count):
        laws[channel, :, channel] = rows
    return found.system.whiten(laws.reshape(-1, count, n)).reshape(count * len(rows), -1)
