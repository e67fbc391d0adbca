"""Pieces of which the generator's laws are made: lags, hysteresis, slow noise. Arrays are (n,), evenly spaced."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter

FLICKER_SPACING = 4.0


def lag(values: np.ndarray, step_s: float, time_constant_s: float) -> np.ndarray:
    """First-order lag of an input that is straight between its samples, exact; settled at the start."""
    if time_constant_s <= 0.0:
        return values
    decay = float(np.exp(-step_s / time_constant_s))
    share = time_constant_s / step_s * -float(np.expm1(-step_s / time_constant_s))
    newest, older = 1.0 - share, share - decay
    start = [(1.0 - newest) * values[0]]
    return lfilter([newest, older], [1.0, -decay], values, zi=start)[0]


def lags(values: np.ndarray, step_s: float, time_constants_s: Sequence[float]) -> np.ndarray:
    """Several lags one after the other."""
    for time_constant_s in time_constants_s:
        values = lag(values, step_s, time_constant_s)
    return values


def diffusion(values: np.ndarray, step_s: float, time_constant_s: float, poles: int = 6) -> np.ndarray:
    """Heat through a slab: poles at 1, 9, 25 ... of the first, as those of the heat equation, with the wanted delay in all."""
    ratios = 1.0 / (2.0 * np.arange(poles) + 1.0) ** 2
    return lags(values, step_s, list(time_constant_s * ratios / ratios.sum()))


def slope(values: np.ndarray, step_s: float) -> np.ndarray:
    """Time derivative."""
    return np.gradient(values, step_s)


def play(values: np.ndarray, half_width: float) -> np.ndarray:
    """Play operator (backlash) of a half width, at rest in the middle of its gap at the start."""
    return plays(values, np.array([half_width]))[:, 0]


def plays(values: np.ndarray, half_widths: np.ndarray) -> np.ndarray:
    """Several plays of the same input; (n, number of plays)."""
    out = np.empty((len(values), len(half_widths)))
    state = np.full(len(half_widths), values[0])
    for i, value in enumerate(values):
        state = np.minimum(np.maximum(state, value - half_widths), value + half_widths)
        out[i] = state
    return out


def preisach(values: np.ndarray, low: float, high: float, cells: int = 12) -> np.ndarray:
    """Mean of the relays of a triangular grid between `low` and `high`, -1 .. 1, weights falling away from the diagonal; demagnetised start."""
    grid = np.linspace(low, high, cells + 1)
    up, down = np.meshgrid(grid, grid, indexing="ij")
    exists = up > down
    up, down = up[exists], down[exists]
    weight = np.exp(-2.0 * (up - down) / (high - low))
    weight /= weight.sum()
    state = np.where(up + down < 2.0 * values[0], 1.0, -1.0)
    out = np.empty(len(values))
    for i, value in enumerate(values):
        state = np.where(value >= up, 1.0, np.where(value <= down, -1.0, state))
        out[i] = state @ weight
    return out


def wander(random: np.random.Generator, count: int, step_s: float, time_constant_s: float) -> np.ndarray:
    """Ornstein-Uhlenbeck process of unit variance."""
    decay = float(np.exp(-step_s / time_constant_s))
    start = random.standard_normal()
    return lfilter([np.sqrt(1.0 - decay**2)], [1.0, -decay], random.standard_normal(count), zi=[decay * start])[0]


def flicker(random: np.random.Generator, count: int, step_s: float, floor: float) -> np.ndarray:
    """1/f noise whose Allan deviation is flat at `floor`: wanders of equal size, time constants a factor of 4 apart.

    With r between neighbours the density is s^2/(f ln r), and the Allan variance of h/f is 2 ln(2) h: at r = 4 the floor is s itself."""
    longest = 4.0 * count * step_s
    constants = [2.0 * step_s]
    while constants[-1] < longest:
        constants.append(constants[-1] * FLICKER_SPACING)
    total = sum((wander(random, count, step_s, constant) for constant in constants), np.zeros(count))
    size = floor * np.sqrt(np.log(FLICKER_SPACING) / (2.0 * np.log(2.0)))
    return size * (total - total[0])


def telegraph(random: np.random.Generator, count: int, step_s: float, dwell_s: float) -> np.ndarray:
    """Random telegraph signal -1/+1 with a mean dwell time."""
    flips = random.random(count) < 1.0 - np.exp(-step_s / dwell_s)
    return np.where(np.cumsum(flips) % 2 == 0, -1.0, 1.0)
