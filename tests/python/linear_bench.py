"""A bench whose twin is linear: effects and what is uncertain add known columns, so that every fit has a closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.floors import ORDER, Floor
from wineglass.diagnosis.system import FOLDS, System
from wineglass.effects import Setting

Columns = dict[tuple[str, str], np.ndarray]


@dataclass(frozen=True)
class LinearUnit:
    """off (m,): what is uncertain, in standard deviations. Its device is nothing but that."""

    off: np.ndarray

    @property
    def device(self) -> np.ndarray:
        return self.off

    def toward(self, change: np.ndarray) -> LinearUnit:
        return LinearUnit(self.off + change)


@dataclass
class LinearBench:
    """columns: (effect, parameter) -> (channels, n) for a strength of one; `time_s` cuts its effect off before that moment, and a stretch
    that lasts for some time before and after it. known: what one
    standard deviation of everything uncertain does."""

    grid: Grid
    names: tuple[str, ...]
    columns: Columns
    known: list[tuple[str, np.ndarray]] = field(default_factory=list)
    unit: LinearUnit | None = None
    shell_off: float = 0.0
    runs: int = 0
    driven: None = None
    shell_degc: np.ndarray = field(default_factory=lambda: np.zeros(1))

    def __post_init__(self) -> None:
        self.unit = self.unit or LinearUnit(np.zeros(len(self.known)))

    @property
    def measured_degc(self) -> np.ndarray:
        return self.shell_degc

    @property
    def nominal(self) -> np.ndarray:
        assert self.unit is not None
        return sum((by * column for by, (_, column) in zip(self.unit.off, self.known, strict=True)), np.zeros((len(self.names), self.grid.count)))

    def run(self, settings: Sequence[Setting] = ()) -> np.ndarray:
        self.runs += 1
        found = self.nominal
        for setting in settings:
            found = found + self._on(setting.values) * sum(value * self.columns[setting.id, name] for name, value in setting.values.items() if (setting.id, name) in self.columns)
        return found

    def _on(self, values: dict[str, float]) -> np.ndarray:
        """(n,): part of each frame in which the effect acts."""
        begin_s = self.grid.time_s - 0.5 * self.grid.frame_s
        stretches = [(values[f"begin_{i}_s"], values[f"lasts_{i}_s"]) for i in range(1, 5) if values.get(f"lasts_{i}_s")]
        stretches += [(values["time_s"], values["lasts_s"])] if values.get("lasts_s") else []
        if not stretches:
            return begin_s >= values.get("time_s", -np.inf) - 1e-9
        inside = [np.minimum(begin_s + self.grid.frame_s, begin + lasts) - np.maximum(begin_s, begin) for begin, lasts in stretches]
        return np.sum(np.clip(inside, 0.0, None), axis=0) / self.grid.frame_s

    def tried(self, settings: Sequence[Setting]) -> np.ndarray:
        return self.run(settings) - self.nominal

    def at(self, unit: LinearUnit, shell_off: float) -> LinearBench:
        return replace(self, unit=unit, shell_off=shell_off)

    def centre(self, nuisances: Sequence[str], unit: LinearUnit | None = None) -> np.ndarray:
        chosen = unit or self.unit
        assert chosen is not None and len(nuisances) == len(chosen.off)
        return chosen.off

    def frames(self, settings: Sequence[Setting] = ()) -> Frames:
        values = self.run(settings)
        return Frames(self.grid, self.names, values, np.ones_like(values, bool))


def uncertainties(bench: LinearBench, settings: Sequence[Setting] = (), unit: LinearUnit | None = None) -> list[tuple[str, np.ndarray]]:
    """In place of responses.uncertainties, which turns the knobs of a device."""
    return bench.known


def system_of(grid: Grid, names: tuple[str, ...], data: np.ndarray) -> System:
    """data (channels, n), in floors: white noise of size one in every channel, all frames sound, nothing unknown asked for."""
    channels = len(names)
    floor = Floor(np.ones(channels), np.ones(channels), np.zeros((channels, ORDER)))
    basis = tuple(np.zeros((grid.count, 0)) for _ in names)
    return System(grid, names, floor, np.ones_like(data), np.arange(grid.count) * FOLDS // grid.count, basis, data)


def ridge(columns: np.ndarray, data: np.ndarray, middle: np.ndarray | None = None) -> np.ndarray:
    """Coefficients (k,) of columns (k, ...) with normal priors of unit size about `middle`: least squares with one more row for each prior."""
    rows, middle = columns.reshape(len(columns), -1), np.zeros(len(columns)) if middle is None else middle
    return np.linalg.lstsq(np.vstack([rows.T, np.eye(len(rows))]), np.concatenate([data.ravel(), middle]), rcond=None)[0]
