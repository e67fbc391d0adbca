"""What a loop is worth: crossover, margins, bandwidth, overshoot, noise bandwidth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from wineglass.loop_design.model import Loop

Response = Callable[[np.ndarray], np.ndarray]

_GRID_POINTS = 1500
_STEP_TICKS = 20_000


@dataclass(frozen=True)
class Margins:
    """crossover_hz: highest |L| = 1; nan margins: the loop gain never gets there. sensitivity_peak: largest |1/(1 + L)|"""

    stable: bool
    crossover_hz: float
    phase_margin_deg: float
    gain_margin_db: float
    phase_crossover_hz: float
    sensitivity_peak: float


@dataclass(frozen=True)
class Step:
    """overshoot: beyond the final value, of it; settling_s: to within 1 % for good"""

    overshoot: float
    settling_s: float


def grid_hz(loop: Loop) -> np.ndarray:
    """Positive frequencies up to half the loop rate, logarithmic, from a thousandth of a hertz."""
    return np.geomspace(1e-3, 0.5 * loop.schedule.loop_rate_hz, _GRID_POINTS)


def margins(loop: Loop) -> Margins:
    """Worst of both signs of the frequency."""
    grid = grid_hz(loop)
    found = [_one_side(lambda f, sign=sign: loop.open_loop(sign * np.asarray(f)), grid) for sign in (1.0, -1.0)]
    crossover, phase = min((side[0] for side in found), key=lambda item: _or_large(item[1]))
    phase_crossover, gain = min((side[1] for side in found), key=lambda item: _or_large(item[1]))
    return Margins(loop.stable, crossover, phase, gain, phase_crossover, max(side[2] for side in found))


def _or_large(value: float) -> float:
    return math.inf if math.isnan(value) else value


def _one_side(open_loop: Response, grid: np.ndarray) -> tuple[tuple[float, float], tuple[float, float], float]:
    values = open_loop(grid)
    peak = float(np.max(np.abs(1.0 / (1.0 + values))))
    return _phase_margin(open_loop, grid, values), _gain_margin(open_loop, grid, values), peak


def _phase_margin(open_loop: Response, grid: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """(crossover, angle of -L there), of the crossover with the least angle."""
    found = []
    size = np.log(np.abs(values))
    for i in np.flatnonzero(np.signbit(size[1:]) != np.signbit(size[:-1])):
        f = brentq(lambda x: math.log(abs(complex(open_loop(np.array(x))))), grid[i], grid[i + 1], xtol=1e-9)
        found.append((f, abs(math.degrees(np.angle(-complex(open_loop(np.array(f))))))))
    return min(found, key=lambda item: item[1], default=(math.nan, math.nan))


def _gain_margin(open_loop: Response, grid: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """(frequency, margin in dB) where L is real and negative, of the least margin by size."""
    found = []
    imaginary = values.imag
    for i in np.flatnonzero(np.signbit(imaginary[1:]) != np.signbit(imaginary[:-1])):
        f = brentq(lambda x: complex(open_loop(np.array(x))).imag, grid[i], grid[i + 1], xtol=1e-9)
        real = complex(open_loop(np.array(f))).real
        if real < 0.0:
            found.append((f, -20.0 * math.log10(-real)))
    return min(found, key=lambda item: abs(item[1]), default=(math.nan, math.nan))


def bandwidth_hz(response: Response, limit_hz: float) -> float:
    """First frequency at which |response| is 3 dB below its value at rest; nan: not below limit_hz."""
    grid = np.geomspace(1e-2, limit_hz, _GRID_POINTS // 5)
    level = abs(complex(response(np.array(1e-6)))) / math.sqrt(2.0)
    below = np.flatnonzero(np.abs(response(grid)) < level)
    if len(below) == 0 or below[0] == 0:
        return math.nan
    return float(brentq(lambda f: abs(complex(response(np.array(f)))) - level, grid[below[0] - 1], grid[below[0]]))


def noise_bandwidth_hz(response: Response, limit_hz: float) -> float:
    """Width of the rectangle with the area of |response / response(0)|^2, up to limit_hz."""
    f = np.linspace(1e-6, limit_hz, _GRID_POINTS)
    gain = np.abs(response(f) / complex(response(np.array(1e-6)))) ** 2
    return float(np.trapezoid(gain, f))


def step(loop: Loop) -> Step:
    """Answer of the loop's force to a step of what it has to balance, applied like a force, tick by tick."""
    closed, values = loop.closed, np.empty(_STEP_TICKS)
    state = np.zeros(len(closed.a), complex)
    for k in range(_STEP_TICKS):
        values[k] = -(closed.c @ state).real
        state = closed.a @ state + closed.b
    outside = np.flatnonzero(np.abs(values - 1.0) > 0.01)
    return Step(max(0.0, float(np.max(values)) - 1.0), float((outside[-1] + 1 if len(outside) else 0) * loop.schedule.tick_s))
