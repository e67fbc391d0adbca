"""What one recording asks: its frames, their floor, the channels that speak and where; what may explain it, and where the twin is not to be believed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wineglass.diagnosis import channels, drive, floors, system
from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.floors import Floor
from wineglass.diagnosis.responses import Bench
from wineglass.diagnosis.system import System
from wineglass.recording import Recording

SWITCHING = 12  # frames after the loop was opened or closed
BEND = 0.03  # of the rate's span: a second difference beyond that is a step


@dataclass(frozen=True)
class Task:
    """What makes a system out of recorded and twin frames."""

    recorded: Frames
    floor: Floor
    pick: list[int]
    edges_s: list[float]
    jumps: np.ndarray
    aside: np.ndarray
    """(n,): frames in the loop that was in use for the shorter time"""
    without: frozenset[str] = frozenset()
    """effects taken out of the catalogue (for tests of honesty)"""
    advance: Callable[[], None] = lambda: None
    """called as work goes on"""

    def system(self, bench: Bench, base: Frames, unknown: bool = False) -> System:
        """unknown: with what an effect of no known kind may follow."""
        names = tuple(bench.names[i] for i in self.pick)
        losses = bench.driven.run.device.noise_floor.drive_level_relative
        followed = regressors(bench.driven, bench, base) if unknown else None
        return system.build(self.recorded, base, self.floor, names, self.edges_s, self.jumps, followed, losses, self.aside)


def asked(recorded: Frames, driven: Driven, recording: Recording, floor: Floor, pick: list[int], without: frozenset[str], advance: Callable[[], None]) -> Task:
    """floor: of all channels; pick: those that speak."""
    rebalancing = drive.loop_at(driven, recorded.grid.time_s)
    aside = rebalancing if np.mean(rebalancing) < 0.5 else ~rebalancing
    chosen = Floor(floor.rms[pick], floor.innovation[pick], floor.coefficients[pick])
    return Task(_where_it_counts(recorded, rebalancing), chosen, pick, edges_of(recording), jumps(driven, recorded.grid), aside, without, advance)


def _where_it_counts(recorded: Frames, rebalancing: np.ndarray) -> Frames:
    """Channels masked where the loop in use leaves them nothing to say, and where it was just changed."""
    changing = np.zeros(len(rebalancing), bool)
    for place in np.flatnonzero(np.diff(rebalancing)):
        changing[max(0, place - 1) : place + 1 + SWITCHING] = True
    use = recorded.use.copy()
    for i, name in enumerate(recorded.names):
        loop = floors.counts_in(name)
        if loop is not None:
            use[i] &= (rebalancing == (loop == "rebalance")) & ~changing
    return replace(recorded, use=use)


def edges_of(recording: Recording) -> list[float]:
    """Times [s] at which a segment begins."""
    return [event.sample / recording.counter_rate_hz for event in recording.events if event.kind == "segment"]


def jumps(driven: Driven, grid: Grid) -> np.ndarray:
    """(n,): frames in which the true rate steps, and their neighbours."""
    parts = 12
    fine = driven.run.scenario.rate.at((grid.first + (np.arange(grid.count * parts) + 0.5) / parts) * grid.frame_s)
    span = float(np.ptp(fine))
    if span == 0.0:
        return np.zeros(grid.count, bool)
    bend = np.abs(np.diff(fine, 2, prepend=fine[:1], append=fine[-1:])).reshape(grid.count, parts).max(axis=1) > BEND * span
    return bend | np.roll(bend, 1) | np.roll(bend, -1)


def regressors(driven: Driven, bench: Bench, base: Frames) -> np.ndarray:
    """(m, n): what an effect of no known kind may follow: temperature, its speed, rate, amplitude, and the slow channels themselves."""
    time_s = bench.grid.time_s
    scenario, reference = driven.run.scenario, driven.run.device.resonator.reference_temperature_degc
    shift = _unit(scenario.temperature.at(time_s) - reference)
    rate = _unit(scenario.rate.at(time_s))
    speed = np.gradient(shift)
    own = [base[name] for name in channels.BASEBAND if name in base.names and name != "drive_frequency"]
    rows = [shift, shift**2, shift**3, speed, np.gradient(speed), rate, rate**2, rate**3, rate * shift, *own]
    return np.array([_unit(row) for row in rows if np.ptp(row) > 0.0])


def _unit(values: np.ndarray) -> np.ndarray:
    return values / max(float(np.max(np.abs(values))), 1e-300)
