"""More gyros for the rate-level diagnosis, as other makers' tables look: other sample rates, soaks in stairs, pauses with the power off, a warm-up at constant
room temperature, coarse thermometers, rates with few digits, spikes, noise that grows with temperature.

The forms are again others than the diagnosis' own and than those of rate_level_cases.py: a dead time before a pole, two thermal nodes, Bouc and Wen's
hysteresis, friction with sticking, stretched exponentials. The same interface: draw(seed) -> Case.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from rate_level_cases import Case
from scipy.signal import lfilter

from wineglass.diagnosis.evidence import Evidence

SIZES = (4.0, 12.0, 40.0)  # rms of the effect over the noise of a sample, beyond a static cubic


@dataclass(frozen=True)
class Day:
    """time_s (n,), degc (n,): shell; noise: of a sample [rad/s]"""

    time_s: np.ndarray
    degc: np.ndarray
    noise: float

    @property
    def step_s(self) -> float:
        return float(np.median(np.diff(self.time_s)))

    @property
    def span_s(self) -> float:
        return float(self.time_s[-1] - self.time_s[0])


def _pole(values: np.ndarray, share: float) -> np.ndarray:
    return lfilter([share], [1.0, share - 1.0], values, zi=[(1.0 - share) * values[0]])[0]


# --- days ------------------------------------------------------------------------------------------------------------------


def _chamber(rng: np.random.Generator, places: np.ndarray, degrees: np.ndarray, count: int, step_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Set-points through the chamber's and the gyro's own slowness."""
    time_s = np.arange(count) * step_s
    wanted = np.interp(np.linspace(0.0, 1.0, count), places, degrees + rng.uniform(-3.0, 3.0, len(degrees)))
    return time_s, _pole(_pole(wanted, 1.0 / (0.004 * count)), 1.0 / (0.012 * count))


def stairs(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Soaks at six temperatures, up and down again."""
    degrees = np.array([25, 45, 65, 80, 65, 45, 25, 5, -15, -30, -15, 5, 25], float)
    edges = np.linspace(0, 1, len(degrees) + 1)
    places = np.sort(np.concatenate([edges[:-1], edges[1:] - 0.015]))
    return _chamber(rng, places, np.repeat(degrees, 2), 5200, 5.0)


def saw(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Four cycles, each faster than the one before, ten samples a second."""
    lengths = np.array([1.0, 1.0, 0.8, 0.8, 0.6, 0.6, 0.45, 0.45])
    places = np.concatenate(([0.0], np.cumsum(lengths) / lengths.sum()))
    return _chamber(rng, places, np.array([20, 60, 15, 65, 18, 62, 17, 60, 20], float), 24_000, 0.1)


def from_the_cold(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """One cycle that begins at its coldest point, a sample every two seconds."""
    return _chamber(rng, np.array([0, 0.1, 0.5, 0.6, 0.95, 1]), np.array([-40, -40, 85, 85, -40, -40], float), 3600, 2.0)


def two_days(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Two days in a hut, a sample a minute: sun, wind, a door."""
    time_s = np.arange(2880) * 60.0
    wind = _pole(rng.standard_normal(2880), 0.01) * 6.0
    return time_s, 15.0 + 9.0 * np.sin(2 * np.pi * (time_s / 86_400 - 0.3)) + 2.5 * np.sin(4 * np.pi * time_s / 86_400 + 1.0) + wind


def bench_top(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Constant room temperature, within a few tenths."""
    time_s = np.arange(7200) * 1.0
    return time_s, 23.0 + 0.15 * np.sin(2 * np.pi * time_s / 1500.0) + 0.1 * _pole(rng.standard_normal(7200), 0.005)


DAYS: dict[str, Callable[[np.random.Generator], tuple[np.ndarray, np.ndarray]]] = {
    "stairs": stairs, "four cycles": saw, "one cycle from the cold": from_the_cold, "two days": two_days, "bench top": bench_top}


# --- what is in the catalogue ----------------------------------------------------------------------------------------------


def dead_time(day: Day, rng: np.random.Generator) -> np.ndarray:
    """A part of the bias follows the temperature after a dead time and a pole."""
    tau_s = day.span_s * rng.uniform(0.008, 0.03)
    late = np.interp(day.time_s - 0.4 * tau_s, day.time_s, day.degc)
    return _pole(late, min(1.0, day.step_s / tau_s)) - day.degc


def nodes(day: Day, rng: np.random.Generator) -> np.ndarray:
    """Difference between two nodes that follow each other closely."""
    tau_s = max(4.0 * day.step_s, day.span_s * 0.0008)
    return day.degc - _pole(day.degc, day.step_s / tau_s)


def bouc_wen(day: Day, rng: np.random.Generator) -> np.ndarray:
    """z' = x' (1 - |z|^n (b sign(x' z) + c)), in units of a yield span."""
    width = np.ptp(day.degc) * rng.uniform(0.08, 0.2)
    steps, z, out, power = np.diff(day.degc, prepend=day.degc[0]) / width, 0.0, np.empty(len(day.degc)), rng.uniform(1.0, 2.0)
    for i, step in enumerate(steps):
        z += step * (1.0 - abs(z) ** power * (0.8 * np.sign(step * z) + 0.2))
        out[i] = z
    return out


def friction(day: Day, rng: np.random.Generator) -> np.ndarray:
    """A mount that sticks until the strain is large enough, then slips half of the way."""
    limit, place, out = np.ptp(day.degc) * rng.uniform(0.1, 0.2), day.degc[0], np.empty(len(day.degc))
    for i, now in enumerate(day.degc):
        if abs(now - place) > limit:
            place = now - 0.97 * limit * np.sign(now - place)
        out[i] = now - place
    return out


def stretched(day: Day, rng: np.random.Generator) -> np.ndarray:
    return 1.0 - np.exp(-((day.time_s / (day.span_s * rng.uniform(0.2, 0.8))) ** rng.uniform(0.5, 0.9)))


def steady_drift(day: Day, rng: np.random.Generator) -> np.ndarray:
    return day.time_s + 0.15 * day.time_s**2 / day.span_s


# --- what is in none -------------------------------------------------------------------------------------------------------


def compressor(day: Day, rng: np.random.Generator) -> np.ndarray:
    """Of the chamber: on and off, some fifteen times."""
    period = day.span_s / rng.uniform(11, 19)
    return np.where((day.time_s + 0.2 * period * np.sin(day.time_s / period)) % period < 0.45 * period, 1.0, 0.0)


def humidity(day: Day, rng: np.random.Generator) -> np.ndarray:
    return _pole(_pole(rng.standard_normal(len(day.degc)), 40.0 / len(day.degc)), 40.0 / len(day.degc))


def weld(day: Day, rng: np.random.Generator) -> np.ndarray:
    """The bias jumps once and later half way back."""
    first, second = np.sort(rng.uniform(0.15, 0.85, 2)) * day.span_s
    return 1.0 * (day.time_s > first) - 0.5 * (day.time_s > second)


def heating_only(day: Day, rng: np.random.Generator) -> np.ndarray:
    """Where the chamber's heater blows."""
    return np.sqrt(np.maximum(0.0, np.gradient(day.degc, day.time_s)))


Signal = Callable[[Day, np.random.Generator], np.ndarray]
CATALOGUE: dict[str, tuple[frozenset[str], tuple[Signal, ...]]] = {
    "dead time": (frozenset({"thermometer_lag"}), (dead_time,)),
    "nodes": (frozenset({"thermal_gradient"}), (nodes,)),
    "Bouc-Wen": (frozenset({"thermal_hysteresis"}), (bouc_wen,)),
    "friction": (frozenset({"thermal_hysteresis"}), (friction,)),
    "stretched": (frozenset({"ageing"}), (stretched,)),
    "steady drift": (frozenset({"ageing"}), (steady_drift,)),
    "dead time with drift": (frozenset({"thermometer_lag", "ageing"}), (dead_time, stretched)),
}
FOREIGN: dict[str, tuple[Signal, ...]] = {"compressor": (compressor,), "humidity": (humidity,), "weld": (weld,), "heating only": (heating_only,)}
NEAREST = {"humidity": frozenset({"flicker_noise"})}
TIME_ONLY = ("stretched", "steady drift")


def kinds() -> list[str]:
    return ["null", *CATALOGUE, *FOREIGN]


def draw(seed: int, kind: str | None = None, profile: str | None = None, size: float | None = None) -> Case:
    rng = np.random.default_rng([seed, 78])
    group = rng.choice(["null", "catalogue", "foreign"], p=[0.25, 0.45, 0.3])
    drawn = "null" if group == "null" else str(rng.choice(list(CATALOGUE if group == "catalogue" else FOREIGN)))
    profile = profile or str(rng.choice(list(DAYS)))
    if profile == "bench top" and drawn in CATALOGUE and drawn not in TIME_ONLY:
        drawn = str(rng.choice(TIME_ONLY))
    if profile == "bench top" and drawn == "heating only":
        drawn = "weld"
    kind = kind or drawn
    size = size or float(rng.choice(SIZES))
    time_s, degc = DAYS[profile](rng)
    noise = 10.0 ** rng.uniform(-6, -3)  # from a navigation gyro to a cheap one
    day = Day(time_s, degc, noise)
    truth, signals = CATALOGUE.get(kind, (frozenset(), FOREIGN.get(kind, ())))
    rate = sum((_scaled(signal(day, rng), size, day) for signal in signals), _static(day, rng))
    rate = rate + _noise(day, rng)
    return Case(seed, kind, profile, size, truth, _written(day, rate, rng, f"{kind}, {profile}, {size:g} times the noise, seed {seed}"))


def _static(day: Day, rng: np.random.Generator) -> np.ndarray:
    """A smooth curve of some hundred times the noise, a cubic or nearly one."""
    x = (day.degc - 25.0) / 60.0
    return day.noise * rng.uniform(20, 300) * (rng.normal() + rng.normal() * x + 0.5 * rng.normal() * x**2 + 0.2 * rng.normal() * np.sin(x))


def _scaled(signal: np.ndarray, size: float, day: Day) -> np.ndarray:
    rest = signal - np.polynomial.Polynomial.fit(day.degc, signal, 3)(day.degc)
    return signal * size * day.noise / max(float(np.std(rest)), 1e-12 * float(np.max(np.abs(signal))) + 1e-300)


def _noise(day: Day, rng: np.random.Generator) -> np.ndarray:
    """White, up to half as much again when hot; sometimes a few spikes."""
    hot = (day.degc - day.degc.min()) / max(1e-9, float(np.ptp(day.degc)))
    noise = rng.standard_normal(len(day.degc)) * (1.0 + rng.uniform(0.0, 0.5) * hot)
    if rng.random() < 0.2:
        noise[rng.integers(0, len(noise), 8)] *= 8.0
    return day.noise * noise


def _written(day: Day, rate: np.ndarray, rng: np.random.Generator, source: str) -> Evidence:
    """As a logger writes it down: coarse thermometer, few digits, uneven times, missing rows, sometimes a pause."""
    step = float(rng.choice([1e-4, 0.01, 0.0625, 0.25]))
    measured = np.round((day.degc + 0.01 * rng.standard_normal(len(rate))) / step) * step
    digits = day.noise * float(rng.choice([1e-3, 0.1, 0.5]))
    keep = rng.random(len(rate)) > rng.choice([0.0, 0.02])
    if rng.random() < 0.25:
        start = rng.uniform(0.2, 0.7)
        keep &= (day.time_s < start * day.span_s) | (day.time_s > (start + 0.04) * day.span_s)
    time_s = day.time_s + rng.uniform(0, 0.2) * day.step_s * rng.random(len(rate))
    return Evidence(source=source, sha256="0" * 64, channel="rate", time_s=time_s[keep], temperature_degc=measured[keep],
                    rate_rad_s=(np.round(rate / digits) * digits)[keep])
