"""Rate-level recordings with known truth. The functional forms are not those that the diagnosis fits: a two-pole lag, logarithmic ageing with
its own time constant, a Prandtl-Ishlinskii hysteresis with graded weights, a static curve written in powers, noise by recursion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import odeint

from wineglass.diagnosis.evidence import Evidence

STEP_S = 1.0
SIGMA = 2e-4
Signal = Callable[[np.ndarray, np.ndarray, np.random.Generator], np.ndarray]


def one_cycle(count: int = 3600) -> tuple[np.ndarray, np.ndarray]:
    """Down, up, half way down: like a chamber, rounded."""
    time_s = np.arange(count) * STEP_S
    corners = np.interp(time_s / time_s[-1], [0, 0.3, 0.75, 1], [45, -20, 75, 25])
    kernel = np.hanning(121) / np.hanning(121).sum()
    return time_s, np.convolve(np.pad(corners, 60, mode="edge"), kernel, "valid")


def two_cycles(count: int = 4800) -> tuple[np.ndarray, np.ndarray]:
    """A slow cycle and one of about a third of its length, over the same temperatures."""
    time_s = np.arange(count) * STEP_S
    corners = np.interp(time_s / time_s[-1], [0, 0.2, 0.55, 0.75, 0.83, 0.93, 1], [25, -20, 75, 25, -20, 75, 25])
    kernel = np.hanning(91) / np.hanning(91).sum()
    return time_s, np.convolve(np.pad(corners, 45, mode="edge"), kernel, "valid")


def static_curve(rng: np.random.Generator) -> Signal:
    a = rng.normal(0, 1, 4) * np.array([5e-3, 1e-4, 2e-6, 1.5e-8])
    return lambda time_s, degc, _: a[0] + a[1] * (degc - 25) + a[2] * (degc - 25) ** 2 + a[3] * (degc - 25) ** 3


def gauss_markov(time_s: np.ndarray, sigma: float, tau_s: float, rng: np.random.Generator) -> np.ndarray:
    kept = np.exp(-STEP_S / tau_s)
    value, out = sigma * rng.standard_normal(), np.empty(len(time_s))
    for i, fresh in enumerate(rng.standard_normal(len(time_s))):
        out[i] = value
        value = kept * value + sigma * np.sqrt(1 - kept**2) * fresh
    return out


def two_pole(time_s: np.ndarray, degc: np.ndarray, first_s: float, second_s: float) -> np.ndarray:
    """Both poles in a row, by a general solver on a tenth of the samples."""
    def slope(state, now):
        return [(np.interp(now, time_s, degc) - state[0]) / first_s, (state[0] - state[1]) / second_s]

    coarse = time_s[::10]
    return np.interp(time_s, coarse, odeint(slope, [degc[0], degc[0]], coarse, hmax=20.0)[:, 1])


def lag(size: float) -> Signal:
    """A share of the bias follows a temperature behind two poles."""
    return lambda t, degc, rng: size / 40.0 * (two_pole(t, degc, 180.0 * rng.uniform(0.7, 1.4), 60.0) - degc)


def drift(size: float) -> Signal:
    return lambda t, degc, rng: size * np.log1p(t / 700.0) / np.log1p(t[-1] / 700.0)


def gradient(size: float) -> Signal:
    return lambda t, degc, rng: size / 0.06 * np.gradient(degc, t)


def hysteresis(size: float) -> Signal:
    """Plays of twelve half widths with falling weights, begun relaxed."""
    def signal(t, degc, rng):
        widths = np.linspace(2.0, 40.0, 12)
        weights = np.exp(-widths / 15.0)
        state, out = np.full(12, degc[0]), np.empty(len(degc))
        for i, now in enumerate(degc):
            state = np.clip(state, now - widths, now + widths)
            out[i] = weights @ (now - state)
        return size * out / np.ptp(out)
    return signal


def steps(size: float) -> Signal:
    """Not in the catalogue: the bias jumps a few times, at random."""
    def signal(t, degc, rng):
        times = np.sort(rng.uniform(0.1, 0.9, 4)) * t[-1]
        return size * np.sum([np.sign(rng.standard_normal()) * (t > at) for at in times], axis=0)
    return signal


def humps(size: float) -> Signal:
    """Not in the catalogue: slow waves in time."""
    return lambda t, degc, rng: size * np.sin(2 * np.pi * (t / t[-1] * rng.uniform(3.2, 5.5) + rng.uniform()))


def make(signals: list[Signal], seed: int, profile=one_cycle, markov: float = 0.5) -> Evidence:
    """markov: size of the Gauss-Markov noise, in units of the white one."""
    rng = np.random.default_rng(seed)
    time_s, degc = profile()
    rate = sum((signal(time_s, degc, rng) for signal in signals), static_curve(rng)(time_s, degc, rng))
    rate = rate + SIGMA * rng.standard_normal(len(time_s)) + gauss_markov(time_s, markov * SIGMA, rng.uniform(20, 300), rng)
    measured = degc + 0.01 * rng.standard_normal(len(time_s))
    return Evidence(source=f"synthetic, seed {seed}", sha256="", channel="rate", time_s=time_s, temperature_degc=measured, rate_rad_s=rate)
