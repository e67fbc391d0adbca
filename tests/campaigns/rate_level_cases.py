"""Gyros that the rate-level diagnosis has to be honest about: time, temperature, rate, and what really is in them.

Nothing here is the diagnosis' own formula: lags are heat conduction in a bar or two poles, hysteresis is a Preisach plane of relays, a stack of
plays or a state that new extremes move, ageing is exponential, a power or the logarithm of time; static curves are splines or polynomials. A third of the
cases is in no catalogue.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.signal import lfilter

from wineglass.diagnosis.evidence import Evidence

SIGMA = 2e-4  # rad/s, white noise of a sample
SIZES = (2.0, 6.0, 20.0, 60.0)  # rms of the effect over SIGMA


@dataclass(frozen=True)
class Case:
    """truth: effects that are in it; empty and `kind` not "null": something of no catalogue"""

    seed: int
    kind: str
    profile: str
    size: float
    truth: frozenset[str]
    evidence: Evidence

    @property
    def foreign(self) -> bool:
        return not self.truth and self.kind != "null"


Signal = Callable[["Day", np.random.Generator], np.ndarray]


@dataclass(frozen=True)
class Day:
    """time_s (n,), degc (n,): of the shell; static: the shell's bias curve"""

    time_s: np.ndarray
    degc: np.ndarray
    static: Callable[[np.ndarray], np.ndarray]

    @property
    def step_s(self) -> float:
        return float(self.time_s[1] - self.time_s[0])

    @property
    def span_s(self) -> float:
        return float(self.time_s[-1])


# --- days ------------------------------------------------------------------------------------------------------------------


def _knots(rng: np.random.Generator, places: list[float], degrees: list[float], count: int, step_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Ramps with rounded corners."""
    time_s = np.arange(count) * step_s
    jitter = np.concatenate(([0.0], rng.uniform(-0.02, 0.02, len(places) - 2), [0.0]))
    ramps = np.interp(time_s / time_s[-1], np.array(places) + jitter, np.array(degrees) + rng.uniform(-4, 4, len(degrees)))
    b = 1.0 - np.exp(-1.0 / (0.006 * count))
    for _ in range(3):
        ramps = lfilter([b], [1.0, b - 1.0], ramps, zi=[(1.0 - b) * ramps[0]])[0]
    return time_s, ramps


PROFILES = {
    "one cycle": lambda rng: _knots(rng, [0, 0.3, 0.75, 1], [45, -20, 75, 25], 3000, 1.0),
    "one cycle with pauses": lambda rng: _knots(rng, [0, 0.1, 0.35, 0.5, 0.8, 0.9, 1], [25, 25, 70, 70, -30, -30, -5], 3000, 2.0),
    "two speeds": lambda rng: _knots(rng, [0, 0.2, 0.55, 0.75, 0.83, 0.93, 1], [25, -20, 75, 25, -20, 75, 25], 4000, 1.0),
    "three cycles": lambda rng: _knots(rng, [0, 0.15, 0.35, 0.5, 0.66, 0.78, 0.9, 1], [20, 70, -30, 65, -25, 70, -30, 20], 4000, 1.0),
    "one branch": lambda rng: _knots(rng, [0, 0.08, 0.92, 1], [-20, -20, 70, 70], 2000, 1.0),
    "noon and night": lambda rng: (np.arange(2400) * 30.0, 24.0 + rng.uniform(3, 8) * np.sin(np.arange(2400) * 30.0 * 2 * np.pi / rng.uniform(25e3, 45e3))),
}


def _static(rng: np.random.Generator) -> Callable[[np.ndarray], np.ndarray]:
    """A cubic, or a monotone spline that a cubic follows to about a hundredth of its span."""
    if rng.random() < 0.7:
        a = rng.normal(0, 1, 4) * np.array([5e-3, 1e-4, 2e-6, 1.5e-8])
        return lambda degc: np.polynomial.polynomial.polyval(degc - 25.0, a)
    a = rng.normal(0, 1, 4) * np.array([5e-3, 1e-4, 2e-6, 1.5e-8])
    knots = np.linspace(-60, 110, 35)
    return PchipInterpolator(knots, np.polynomial.polynomial.polyval(knots - 25.0, a), extrapolate=True)


# --- what is in the catalogue ----------------------------------------------------------------------------------------------


def bar(day: Day, rng: np.random.Generator) -> np.ndarray:
    """Temperature at the far end of a conducting bar of twelve cells (n,); implicit steps."""
    cells = 12
    tau_s = day.span_s * rng.uniform(0.006, 0.05)
    speed = day.step_s * cells**2 / (2.5 * tau_s)
    band = np.diag(np.full(cells, 1 + 2 * speed)) - speed * (np.eye(cells, k=1) + np.eye(cells, k=-1))
    band[-1, -1] = 1 + speed
    back = np.linalg.inv(band)
    state, out = np.full(cells, day.degc[0]), np.empty(len(day.degc))
    for i, outer in enumerate(day.degc):
        state = back[:, 0] * speed * outer + back @ state
        out[i] = state[-1]
    return out


def poles(day: Day, rng: np.random.Generator) -> np.ndarray:
    """Two poles in a row (n,)."""
    late = day.degc
    for tau_s in day.span_s * rng.uniform(0.006, 0.06) * np.array([1.0, rng.uniform(0.1, 0.8)]):
        keep = np.exp(-day.step_s / tau_s)
        late = lfilter([1 - keep], [1, -keep], late, zi=[keep * late[0]])[0]
    return late


def late_bias(follow: Callable[[Day, np.random.Generator], np.ndarray]) -> Signal:
    """A share of the bias is set by a temperature further in."""
    return lambda day, rng: follow(day, rng) - day.degc


def late_curve(follow: Callable[[Day, np.random.Generator], np.ndarray]) -> Signal:
    """All of the bias is: the thermometer is early."""
    return lambda day, rng: day.static(follow(day, rng)) - day.static(day.degc)


def gradient(day: Day, rng: np.random.Generator) -> np.ndarray:
    slope = np.gradient(day.degc, day.step_s)
    return slope * (1.0 + rng.uniform(0.0, 0.15) * (day.degc - 25.0) / 50.0)


def plays(day: Day, rng: np.random.Generator) -> np.ndarray:
    widths = np.linspace(1.0, 0.5 * np.ptp(day.degc), 25)
    weights = np.exp(-widths / (np.ptp(day.degc) * rng.uniform(0.05, 0.4)))
    state, out = np.full(len(widths), day.degc[0]), np.empty(len(day.degc))
    for i, now in enumerate(day.degc):
        state = np.clip(state, now - widths, now + widths)
        out[i] = weights @ (now - state)
    return out


def preisach(day: Day, rng: np.random.Generator) -> np.ndarray:
    """Relays with thresholds all over the triangle up >= down, begun down below and up above the first temperature."""
    low, high = day.degc.min() - 1, day.degc.max() + 1
    up, down = np.sort(rng.uniform(low, high, (2, 1500)), axis=0)[::-1]
    weight = np.exp(-(up - down) / (0.3 * (high - low)))
    state, out = np.where(day.degc[0] > 0.5 * (up + down), 1.0, -1.0), np.empty(len(day.degc))
    for i, now in enumerate(day.degc):
        state = np.where(now > up, 1.0, np.where(now < down, -1.0, state))
        out[i] = weight @ state
    reversible = np.polynomial.Polynomial.fit(day.degc, out, 3)
    return out - reversible(day.degc)


def extremes(day: Day, rng: np.random.Generator) -> np.ndarray:
    """A mount that sets when it gets hotter or colder than ever."""
    hot, cold = np.maximum.accumulate(day.degc) - day.degc[0], day.degc[0] - np.minimum.accumulate(day.degc)
    return hot + rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.0) * cold


def logarithmic(day: Day, rng: np.random.Generator) -> np.ndarray:
    return np.log1p(day.time_s / (day.span_s * 10 ** rng.uniform(-2, 0)))


def exponential(day: Day, rng: np.random.Generator) -> np.ndarray:
    return 1.0 - np.exp(-day.time_s / (day.span_s * rng.uniform(0.15, 1.0)))


def power(day: Day, rng: np.random.Generator) -> np.ndarray:
    return (day.time_s / day.span_s) ** rng.uniform(0.4, 1.5)


# --- what is in none -------------------------------------------------------------------------------------------------------


def steps(day: Day, rng: np.random.Generator) -> np.ndarray:
    places = rng.uniform(0.08, 0.92, rng.integers(2, 6)) * day.span_s
    return np.sum([rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5) * (day.time_s > at) for at in places], axis=0)


def telegraph(day: Day, rng: np.random.Generator) -> np.ndarray:
    stay = day.span_s / rng.uniform(8, 40)
    flips = np.cumsum(rng.random(len(day.time_s)) < day.step_s / stay)
    return np.where(flips % 2 == 0, 1.0, -1.0)


def humps(day: Day, rng: np.random.Generator) -> np.ndarray:
    return np.sin(2 * np.pi * (day.time_s / day.span_s * rng.uniform(2.0, 7.0) + rng.random()))


def one_hump(day: Day, rng: np.random.Generator) -> np.ndarray:
    return np.exp(-0.5 * ((day.time_s / day.span_s - rng.uniform(0.2, 0.8)) / rng.uniform(0.03, 0.12)) ** 2)


def acceleration(day: Day, rng: np.random.Generator) -> np.ndarray:
    return np.gradient(np.gradient(day.degc, day.step_s), day.step_s)


def speed_squared(day: Day, rng: np.random.Generator) -> np.ndarray:
    return np.gradient(day.degc, day.step_s) ** 2


def slow_times_temperature(day: Day, rng: np.random.Generator) -> np.ndarray:
    """The slope over temperature wanders with time."""
    return (day.degc - day.degc.mean()) * np.sin(2 * np.pi * (day.time_s / day.span_s * rng.uniform(0.4, 1.5) + rng.random()))


def walk(day: Day, rng: np.random.Generator) -> np.ndarray:
    return np.cumsum(rng.standard_normal(len(day.time_s)))


CATALOGUE: dict[str, tuple[frozenset[str], tuple[Signal, ...]]] = {
    "lag, bar": (frozenset({"thermometer_lag"}), (late_bias(bar),)),
    "lag, two poles": (frozenset({"thermometer_lag"}), (late_bias(poles),)),
    "lag of the curve": (frozenset({"thermometer_lag"}), (late_curve(poles),)),
    "gradient": (frozenset({"thermal_gradient"}), (gradient,)),
    "hysteresis, plays": (frozenset({"thermal_hysteresis"}), (plays,)),
    "hysteresis, relays": (frozenset({"thermal_hysteresis"}), (preisach,)),
    "hysteresis, extremes": (frozenset({"thermal_hysteresis"}), (extremes,)),
    "ageing, logarithm": (frozenset({"ageing"}), (logarithmic,)),
    "ageing, exponential": (frozenset({"ageing"}), (exponential,)),
    "ageing, power": (frozenset({"ageing"}), (power,)),
    "lag with ageing": (frozenset({"thermometer_lag", "ageing"}), (late_bias(poles), power)),
    "gradient with ageing": (frozenset({"thermal_gradient", "ageing"}), (gradient, exponential)),
}
FOREIGN: dict[str, tuple[Signal, ...]] = {
    "steps": (steps,), "telegraph": (telegraph,), "humps": (humps,), "one hump": (one_hump,), "second derivative": (acceleration,),
    "speed squared": (speed_squared,), "wandering slope": (slow_times_temperature,),
    "random walk": (walk,),  # flicker_noise is the catalogue's nearest: naming that is no mistake
}
NEAREST = {"random walk": frozenset({"flicker_noise"})}


def kinds() -> list[str]:
    return ["null", *CATALOGUE, *FOREIGN]


def draw(seed: int, kind: str | None = None, profile: str | None = None, size: float | None = None) -> Case:
    """A case; what is not given is drawn. A fifth are nulls, a third is foreign."""
    rng = np.random.default_rng([seed, 77])
    group = rng.choice(["null", "catalogue", "foreign"], p=[0.2, 0.47, 0.33])
    drawn = "null" if group == "null" else str(rng.choice(list(CATALOGUE if group == "catalogue" else FOREIGN)))
    kind = kind or drawn
    profile = profile or str(rng.choice(list(PROFILES), p=[0.22, 0.16, 0.25, 0.15, 0.11, 0.11]))
    size = size or float(rng.choice(SIZES))
    time_s, degc = PROFILES[profile](rng)
    day = Day(time_s, degc, _static(rng))
    truth, signals = CATALOGUE.get(kind, (frozenset(), FOREIGN.get(kind, ())))
    rate = day.static(degc) + sum((_scaled(signal(day, rng), size, day) for signal in signals), np.zeros(len(time_s)))
    rate = rate + _noise(len(time_s), rng)
    measured = degc + 0.01 * rng.standard_normal(len(degc))
    evidence = Evidence(source=f"{kind}, {profile}, {size:g} times the noise, seed {seed}", sha256="0" * 64, channel="rate", time_s=time_s,
                        temperature_degc=measured, rate_rad_s=rate)
    return Case(seed, kind, profile, size, truth, evidence)


def _scaled(signal: np.ndarray, size: float, day: Day) -> np.ndarray:
    """To an rms of `size` times the noise beyond what a static cubic takes."""
    rest = signal - np.polynomial.Polynomial.fit(day.degc, signal, 3)(day.degc)
    return signal * size * SIGMA / max(float(np.std(rest)), 1e-12 * float(np.max(np.abs(signal))) + 1e-300)


def _noise(count: int, rng: np.random.Generator) -> np.ndarray:
    """White, and an autoregressive part of at most its size."""
    keep = np.exp(-1.0 / rng.uniform(20, 300))
    slow = lfilter([np.sqrt(1 - keep**2)], [1, -keep], rng.standard_normal(count + 2000))[2000:]
    return SIGMA * (rng.standard_normal(count) + rng.uniform(0, 0.8) * slow)
