"""Could anything else have made this gap? Plain laws - a channel that follows a constant, time, temperature, its speed, rate, amplitude, or a product of them -
are laid on what an explanation does. If as few of them do the same as the explanation has numbers of its own, the recording shows nothing that only this
explanation foretells: whatever obeys such a law would look like it."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from wineglass.diagnosis import curves, task
from wineglass.diagnosis.closure import Closed
from wineglass.diagnosis.twin_level import TwinAnalysis

ENOUGH = 0.1  # of the amplitude of what the explanation does, that plain laws may leave
NOISE = 4.0  # energy: less is nothing
MOST = 5  # laws that are tried
LEAST_LENGTH = 1e-3  # of a law, whitened: below it the recording does not show it


BY_DEFINITION = frozenset({"thermal_gradient", "ageing", "thermal_hysteresis"})
"""Effects that are nothing but a law of the bias: whatever obeys it is called so"""


def imitable(found: TwinAnalysis, closed: Closed) -> bool:
    """Do as few plain laws as the explanation has numbers, what is uncertain moving along? Not asked of effects that are such a law by definition."""
    if set(closed.support) <= BY_DEFINITION:
        return False
    numbers = sum(u.role != "form" for u in closed.unknowns) + len({(u.effect, curves.is_point(u.name)) for u in closed.unknowns if u.role == "form"})
    return laws_needed(found, closed, min(MOST, numbers)) <= numbers


def laws_needed(found: TwinAnalysis, closed: Closed, most: int = MOST) -> int:
    """Plain laws that do what an explanation does, the one that does most taken first, and again; most + 1: so many are not enough."""
    built = found.system
    known = built.whiten(found.responses.values[list(found.responses.nuisances)][:, found.pick, :]).reshape(len(found.responses.nuisances), -1)
    laws, wanted = _laws(found), built.whiten(closed.response).ravel()
    factor = cho_factor(known @ known.T + np.eye(len(known)))
    across, along = known @ laws.T, known @ wanted
    gram = laws @ laws.T - across.T @ cho_solve(factor, across)
    match = laws @ wanted - across.T @ cho_solve(factor, along)
    whole = float(wanted @ wanted - along @ cho_solve(factor, along))
    return _picked(gram, match, whole, most)


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
