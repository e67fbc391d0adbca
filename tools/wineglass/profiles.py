"""What a scenario does to the device over time: temperature and rate profiles, closed forms evaluated on arrays of times.

Times are in seconds from the start of the run, arrays of any shape. Outside their knots, profiles made of knots hold the end values."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from wineglass.fields import Section, quantity

RAD_PER_DEG = math.pi / 180.0


class _Knots:
    """Straight lines between (time, value) pairs."""

    def __init__(self, times_s: list[float], values: list[float]):
        self.times_s, self.values = np.asarray(times_s, float), np.asarray(values, float)

    def at(self, t_s: np.ndarray) -> np.ndarray:
        return np.interp(t_s, self.times_s, self.values)

    def slope_over(self, start_s: np.ndarray, end_s: np.ndarray) -> np.ndarray:
        """Mean slope over each interval: the change is kept whole also where a knot lies inside."""
        return (self.at(end_s) - self.at(start_s)) / (end_s - start_s)


def _check_knots(times_s: list[float], values: list[float], names: str) -> None:
    if len(times_s) != len(values) or not times_s:
        raise ValueError(f"{names} need the same length, at least one entry")
    if np.any(np.diff(times_s) <= 0.0):
        raise ValueError("times_s must increase from entry to entry")


def _edges(times_s: list[float], values: list[float], start: float, edge_s: float) -> _Knots:
    """Steps at the given times, each a straight edge that begins at its time."""
    knot_times, knot_values, value = [0.0], [start], start
    for time, target in zip(times_s, values):
        knot_times += [time, time + edge_s]
        knot_values += [value, target]
        value = target
    return _Knots(knot_times, knot_values)


class _Profile(Section):
    @property
    def boundaries_s(self) -> list[float]:
        """Times at which the profile goes over into another segment [s]; none where it has no knots."""
        knots = getattr(self, "knots", None)
        return [] if knots is None else [float(time) for time in knots.times_s]


# --- temperature ---------------------------------------------------------------------------------------------------


class _Temperature(_Profile):
    acts_on: Literal["chamber", "shell"] = Field(
        "chamber", description="chamber: the shell follows with its lag; shell: the shell's own temperature is imposed")

    def at(self, t_s: np.ndarray) -> np.ndarray:
        """Temperature [degC], shape of t_s."""
        raise NotImplementedError


class ConstantTemperature(_Temperature):
    kind: Literal["constant"] = "constant"
    value_degc: float = quantity(25.0, "degC", "temperature", ge=-100, le=200)

    def at(self, t_s: np.ndarray) -> np.ndarray:
        return np.full(np.shape(t_s), self.value_degc)


class SineTemperature(_Temperature):
    kind: Literal["sine"] = "sine"
    mean_degc: float = quantity(25.0, "degC", "middle", ge=-100, le=200)
    amplitude_degc: float = quantity(..., "degC", "amplitude", ge=0, le=150)
    period_s: float = quantity(..., "s", "period", gt=0)
    phase_deg: float = quantity(0.0, "deg", "phase at the start")

    def at(self, t_s: np.ndarray) -> np.ndarray:
        angle = 2.0 * np.pi * np.asarray(t_s) / self.period_s + self.phase_deg * RAD_PER_DEG
        return self.mean_degc + self.amplitude_degc * np.sin(angle)


class Ramp(Section):
    """One stretch of a ramp list: to a temperature, in a given time or at a given speed; without a target it dwells."""

    to_degc: float | None = quantity(None, "degC", "temperature at the end; left out: dwell", ge=-100, le=200)
    duration_s: float | None = quantity(None, "s", "time it takes", gt=0)
    speed_degc_per_min: float | None = quantity(None, "degC/min", "instead of duration_s: speed of the change", gt=0)

    @model_validator(mode="after")
    def _determined(self) -> Ramp:
        if (self.duration_s is None) == (self.speed_degc_per_min is None):
            raise ValueError("give either duration_s or speed_degc_per_min")
        if self.to_degc is None and self.duration_s is None:
            raise ValueError("a dwell needs duration_s")
        return self

    def seconds_from(self, degc: float) -> float:
        if self.duration_s is not None:
            return self.duration_s
        assert self.to_degc is not None and self.speed_degc_per_min is not None
        return abs(self.to_degc - degc) / self.speed_degc_per_min * 60.0


class RampTemperature(_Temperature):
    kind: Literal["ramps"] = "ramps"
    start_degc: float = quantity(25.0, "degC", "temperature at the start", ge=-100, le=200)
    ramps: list[Ramp] = quantity(..., "", "stretches, one after the other", min_length=1)

    @cached_property
    def knots(self) -> _Knots:
        times, values = [0.0], [self.start_degc]
        for ramp in self.ramps:
            seconds = ramp.seconds_from(values[-1])
            if seconds > 0:
                times.append(times[-1] + seconds)
                values.append(values[-1] if ramp.to_degc is None else ramp.to_degc)
        return _Knots(times, values)

    @property
    def end_s(self) -> float:
        return float(self.knots.times_s[-1])

    def at(self, t_s: np.ndarray) -> np.ndarray:
        return self.knots.at(t_s)


class StepTemperature(_Temperature):
    kind: Literal["steps"] = "steps"
    start_degc: float = quantity(25.0, "degC", "temperature before the first step", ge=-100, le=200)
    times_s: list[float] = quantity(..., "s", "when each step begins")
    values_degc: list[float] = quantity(..., "degC", "temperature after each step")
    edge_s: float = quantity(1.0, "s", "time a step takes", gt=0)

    @model_validator(mode="after")
    def _ordered(self) -> StepTemperature:
        _check_knots(self.times_s, self.values_degc, "times_s and values_degc")
        _check_edges(self.times_s, self.edge_s)
        return self

    @cached_property
    def knots(self) -> _Knots:
        return _edges(self.times_s, self.values_degc, self.start_degc, self.edge_s)

    def at(self, t_s: np.ndarray) -> np.ndarray:
        return self.knots.at(t_s)


class TableTemperature(_Temperature):
    kind: Literal["table"] = "table"
    times_s: list[float] = quantity(..., "s", "knots")
    values_degc: list[float] = quantity(..., "degC", "temperature at each knot, straight lines in between")

    @model_validator(mode="after")
    def _ordered(self) -> TableTemperature:
        _check_knots(self.times_s, self.values_degc, "times_s and values_degc")
        return self

    @cached_property
    def knots(self) -> _Knots:
        return _Knots(self.times_s, self.values_degc)

    def at(self, t_s: np.ndarray) -> np.ndarray:
        return self.knots.at(t_s)


class CsvTemperature(_Temperature):
    """Knots from a CSV file with a header `name[unit]`; the scenario's reader puts them into a table."""

    kind: Literal["csv"] = "csv"
    path: str = quantity(..., "", "file, relative to the scenario")
    time_column: str = quantity("time", "", "column of the time")
    temperature_column: str = quantity("temperature", "", "column of the temperature")


Temperature = Annotated[
    ConstantTemperature | SineTemperature | RampTemperature | StepTemperature | TableTemperature | CsvTemperature,
    Field(discriminator="kind"),
]


# --- rate ----------------------------------------------------------------------------------------------------------


class _Rate(_Profile):
    def at(self, t_s: np.ndarray) -> np.ndarray:
        """Rate [rad/s], shape of t_s."""
        raise NotImplementedError

    def slope_over(self, start_s: np.ndarray, end_s: np.ndarray) -> np.ndarray:
        """Angular acceleration [rad/s^2] of each interval: the derivative at its middle, or the mean where the profile has knots."""
        raise NotImplementedError


class ConstantRate(_Rate):
    kind: Literal["constant"] = "constant"
    value_deg_s: float = quantity(0.0, "deg/s", "rate", ge=-1000, le=1000)

    def at(self, t_s: np.ndarray) -> np.ndarray:
        return np.full(np.shape(t_s), self.value_deg_s * RAD_PER_DEG)

    def slope_over(self, start_s: np.ndarray, end_s: np.ndarray) -> np.ndarray:
        return np.zeros(np.shape(start_s))


class SineRate(_Rate):
    kind: Literal["sine"] = "sine"
    mean_deg_s: float = quantity(0.0, "deg/s", "middle", ge=-1000, le=1000)
    amplitude_deg_s: float = quantity(..., "deg/s", "amplitude", ge=0, le=1000)
    frequency_hz: float = quantity(..., "Hz", "frequency", gt=0, le=1000)
    phase_deg: float = quantity(0.0, "deg", "phase at the start")

    def _angle(self, t_s: np.ndarray) -> np.ndarray:
        return 2.0 * np.pi * self.frequency_hz * np.asarray(t_s) + self.phase_deg * RAD_PER_DEG

    def at(self, t_s: np.ndarray) -> np.ndarray:
        return (self.mean_deg_s + self.amplitude_deg_s * np.sin(self._angle(t_s))) * RAD_PER_DEG

    def slope_over(self, start_s: np.ndarray, end_s: np.ndarray) -> np.ndarray:
        speed = 2.0 * np.pi * self.frequency_hz * self.amplitude_deg_s * RAD_PER_DEG
        return speed * np.cos(self._angle(0.5 * (np.asarray(start_s) + end_s)))


class StepRate(_Rate):
    kind: Literal["steps"] = "steps"
    start_deg_s: float = quantity(0.0, "deg/s", "rate before the first step", ge=-1000, le=1000)
    times_s: list[float] = quantity(..., "s", "when each step begins")
    values_deg_s: list[float] = quantity(..., "deg/s", "rate after each step")
    edge_s: float = quantity(0.05, "s", "time a step takes; the table's acceleration acts as the Euler force", gt=0)

    @model_validator(mode="after")
    def _ordered(self) -> StepRate:
        _check_knots(self.times_s, self.values_deg_s, "times_s and values_deg_s")
        _check_edges(self.times_s, self.edge_s)
        return self

    @cached_property
    def knots(self) -> _Knots:
        rates = [value * RAD_PER_DEG for value in self.values_deg_s]
        return _edges(self.times_s, rates, self.start_deg_s * RAD_PER_DEG, self.edge_s)

    def at(self, t_s: np.ndarray) -> np.ndarray:
        return self.knots.at(t_s)

    def slope_over(self, start_s: np.ndarray, end_s: np.ndarray) -> np.ndarray:
        return self.knots.slope_over(start_s, end_s)


class ChirpRate(_Rate):
    kind: Literal["chirp"] = "chirp"
    amplitude_deg_s: float = quantity(..., "deg/s", "amplitude", ge=0, le=1000)
    start_hz: float = quantity(..., "Hz", "frequency at begin_s", gt=0, le=1000)
    end_hz: float = quantity(..., "Hz", "frequency at the end", gt=0, le=1000)
    begin_s: float = quantity(0.0, "s", "zero rate until then", ge=0)
    duration_s: float = quantity(..., "s", "length; the frequency changes linearly, the rate is zero afterwards", gt=0)

    def _angle(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angle [rad], its speed [rad/s], and where the chirp is on."""
        elapsed = np.asarray(t_s) - self.begin_s
        sweep = (self.end_hz - self.start_hz) / self.duration_s
        on = (elapsed >= 0) & (elapsed < self.duration_s)
        return 2 * np.pi * (self.start_hz + 0.5 * sweep * elapsed) * elapsed, 2 * np.pi * (self.start_hz + sweep * elapsed), on

    def at(self, t_s: np.ndarray) -> np.ndarray:
        angle, _, on = self._angle(t_s)
        return np.where(on, self.amplitude_deg_s * RAD_PER_DEG * np.sin(angle), 0.0)

    def slope_over(self, start_s: np.ndarray, end_s: np.ndarray) -> np.ndarray:
        angle, speed, on = self._angle(0.5 * (np.asarray(start_s) + end_s))
        return np.where(on, self.amplitude_deg_s * RAD_PER_DEG * speed * np.cos(angle), 0.0)


class TableRate(_Rate):
    kind: Literal["table"] = "table"
    times_s: list[float] = quantity(..., "s", "knots")
    values_deg_s: list[float] = quantity(..., "deg/s", "rate at each knot, straight lines in between")

    @model_validator(mode="after")
    def _ordered(self) -> TableRate:
        _check_knots(self.times_s, self.values_deg_s, "times_s and values_deg_s")
        return self

    @cached_property
    def knots(self) -> _Knots:
        return _Knots(self.times_s, [value * RAD_PER_DEG for value in self.values_deg_s])

    def at(self, t_s: np.ndarray) -> np.ndarray:
        return self.knots.at(t_s)

    def slope_over(self, start_s: np.ndarray, end_s: np.ndarray) -> np.ndarray:
        return self.knots.slope_over(start_s, end_s)


class SumRate(_Rate):
    """Several profiles at once: steps here, a chirp there."""

    kind: Literal["sum"] = "sum"
    parts: list[Annotated[ConstantRate | SineRate | StepRate | ChirpRate | TableRate, Field(discriminator="kind")]] = quantity(
        ..., "", "profiles whose rates add up", min_length=1)

    @property
    def boundaries_s(self) -> list[float]:
        return sorted({time for part in self.parts for time in part.boundaries_s})

    def at(self, t_s: np.ndarray) -> np.ndarray:
        return np.sum([part.at(t_s) for part in self.parts], axis=0)

    def slope_over(self, start_s: np.ndarray, end_s: np.ndarray) -> np.ndarray:
        return np.sum([part.slope_over(start_s, end_s) for part in self.parts], axis=0)


Rate = Annotated[ConstantRate | SineRate | StepRate | ChirpRate | TableRate | SumRate, Field(discriminator="kind")]


def _check_edges(times_s: list[float], edge_s: float) -> None:
    if times_s[0] < 0 or any(later - earlier < edge_s for earlier, later in zip(times_s, times_s[1:])):
        raise ValueError("steps must be at least edge_s apart and begin at 0 or later")
