"""Where the twins stand: a unit within its tolerances, with an explanation's effects or without, moved until the full twin leaves no more than it must.

The envelope twin gives the slopes, the full twin what is left: Gauss-Newton, in which an error of the slopes costs another round and no truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from wineglass.device import Device
from wineglass.diagnosis import channels, explain, responses, system
from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.responses import Bench
from wineglass.diagnosis.system import System
from wineglass.diagnosis.unit import FARTHEST
from wineglass.diagnosis.unknowns import Unknown, differences, settings_of, within_bounds
from wineglass.effects import Setting
from wineglass.errors import BadInput
from wineglass.scenario import Run
from wineglass.simulation import in_memory

QUIET = {"electronics.adc.snr_db": 0.0, "electronics.adc.bits": 32}
"""The twin without converter noise; the thermometer keeps its own, which breaks up the steps of its codes."""
ROUGH_ROUNDS, ROUGH_GAIN = 5, 1e4  # of the envelope alone, and the nats that a round must gain
FULL_ROUNDS, GAIN = 3, 10.0  # of the full twin, and of the envelope's moves from each
CHECKED = 60.0  # nats: moves that gain more are checked by another run of the full twin
LEAST_GAIN = 0.02  # of the energy left beyond noise: less is not worth a round
SLOW = 0.3  # of the round before: a round that gains more is taken with fresh slopes
SHORTEST = 0.05  # part of a step that is still tried
DAMPING = 10.0  # of a step, in priors: what the data say little about stays where it is


Slopes = list[tuple[str, np.ndarray]]


class Judged(Protocol):
    """What makes a system out of the frames of a twin; pick: its channels among the bench's."""

    pick: list[int]

    def system(self, bench: Bench, base: Frames) -> System: ...


@dataclass(frozen=True)
class Standing:
    """unknowns, values (k,), jacobian (k, channels of the system, n): of an explanation; none of them without effects. near: slopes of near by,
    which will do."""

    bench: Bench
    unknowns: list[Unknown] = field(default_factory=list)
    values: np.ndarray = field(default_factory=lambda: np.zeros(0))
    jacobian: np.ndarray | None = None
    near: Slopes | None = None

    @property
    def settings(self) -> list[Setting]:
        return settings_of(self.unknowns, self.values)

    @property
    def spread(self) -> np.ndarray:
        return np.array([u.spread for u in self.unknowns])

    @property
    def off(self) -> np.ndarray:
        """(k,): of the values, in spreads from their priors' middles."""
        return (self.values - np.array([u.middle for u in self.unknowns])) / self.spread if self.unknowns else np.zeros(0)

    @cached_property
    def limits(self) -> np.ndarray:
        """(slopes and unknowns,): how many spreads from its prior's middle anything may be: a unit as far as units are, a shape as near to where it begins;
        strengths go as far as physics allows."""
        return np.array([*[FARTHEST] * len(self.slopes), *[FARTHEST if u.role == "shape" else np.inf for u in self.unknowns]])

    @cached_property
    def envelope(self) -> np.ndarray:
        """(channels of the bench, n)."""
        return self.bench.run(self.settings) if self.unknowns else self.bench.nominal

    def columns(self, pick: list[int]) -> np.ndarray:
        """(k, channels, n): slopes, and behind them what one spread of every unknown does. pick: channels of the system among the bench's."""
        slopes = np.array([slope[pick] for _, slope in self.slopes])
        return slopes if self.jacobian is None else np.concatenate([slopes, self.jacobian * self.spread[:, None, None]])

    @cached_property
    def slopes(self) -> Slopes:
        """What one standard deviation of everything uncertain does here, (channels of the bench, n) each."""
        return self.near or responses.uncertainties(self.bench, self.settings, self.bench.unit if self.unknowns else None)


def full_twin(driven: Driven, grid: Grid, effects: Sequence[Setting] = (), truth: Device | None = None) -> Frames:
    """Frames of the full twin, firmware in the loop, over the recorded inputs, without the converters' noise. truth: None is the run's."""
    run = driven.run
    quiet = Run(run.scenario, run.device, (truth or run.truth).override(QUIET))
    return channels.read(in_memory(quiet, calibration_block=driven.calibration_block, effects=effects), grid)


def roughly(standing: Standing, setting: Judged, frames: Frames | None = None) -> tuple[Standing, Frames]:
    """By the envelope twin alone. frames: of a full twin there, as far as known; None: the envelope's own."""
    bench = standing.bench
    frames = frames or Frames(bench.grid, bench.names, standing.envelope, np.ones_like(bench.nominal, bool))
    return _moved(_Here(standing, setting, frames), ROUGH_GAIN, ROUGH_ROUNDS)[:2]


def with_effects(standing: Standing, frames: Frames) -> Frames:
    """What the full twin would show with the effects, from its frames there without them."""
    return _shifted(frames, standing.bench, standing.envelope - standing.bench.nominal)


def energy_left(standing: Standing, setting: Judged, frames: Frames) -> np.ndarray:
    """(channels,): per frame, in floors, once the last linear step within the tolerances is taken, too."""
    return _Here(standing, setting, frames).energy_left


@dataclass(frozen=True)
class Exact:
    """frames: the full twin's, as far as the last step to the standing is the envelope's; ran: where it was run last, and its own frames, if that step was small."""

    standing: Standing
    frames: Frames
    ran: tuple[Standing, Frames] | None


def exactly(standing: Standing, setting: Judged, hopeless: float = np.inf) -> Exact:
    """By the full twin. A step that the next run does not confirm is taken back. hopeless: energy per frame of a channel, left once the last linear step is
    taken, beyond which something else is needed than another round."""
    before: tuple[Standing, Frames] | None = None
    least = np.inf
    for _ in range(FULL_ROUNDS):
        frames = run(standing)
        here = _Here(standing, setting, frames)
        cost = here.cost(np.ones(len(here.built.names)))
        if before is not None and cost > least:
            return Exact(*before, before)
        before, least = (standing, frames), cost
        moved, frames, gained = _moved(here, GAIN, FULL_ROUNDS)
        standing = standing if moved is standing else replace(moved, near=None)
        if gained < CHECKED or float(np.max(here.energy_left)) > hopeless:
            break
    assert before is not None
    return Exact(standing, frames, before if gained < CHECKED else None)


@dataclass(frozen=True)
class _Here:
    """A standing, the frames of a twin there, and the linear system about it."""

    standing: Standing
    setting: Judged
    frames: Frames

    @cached_property
    def built(self) -> System:
        return self.setting.system(self.standing.bench, self.frames)

    @cached_property
    def table(self) -> system.Products:
        return linear(self.standing, self.setting, self.built)

    @property
    def names(self) -> list[str]:
        return [name for name, _ in self.standing.slopes]

    @property
    def fixed(self) -> list[int]:
        """What stays where it is: what wanders, and the clock of the rate table."""
        return [i for i, name in enumerate(self.names) if i >= len(self.standing.bench.unit.off) and name != responses.SHELL]

    @property
    def energy_left(self) -> np.ndarray:
        """(channels,): per frame, in floors, once the next linear step within the tolerances is taken, too."""
        change = explain.within(self.table.pooled(np.ones(len(self.built.names))), list(range(self.table.count)), -self.table.about, self.standing.limits)
        return self.table.left(change) / np.maximum(self.built.n_rows, 1)

    def cost(self, softening: np.ndarray) -> float:
        """Half the energy left, and the priors': only what is fixed is at its best."""
        gram, fixed = self.table.pooled(softening), self.fixed
        return 0.5 * float(gram[-1, -1]) + _gain(gram, fixed, explain.within(gram, fixed, -self.table.about[fixed], self.standing.limits[fixed]))

    def cost_with(self, softening: np.ndarray, fixed: np.ndarray) -> float:
        """The same where what is fixed has these coefficients."""
        columns = [self.standing.slopes[i][1][self.setting.pick] for i in self.fixed]
        moved = np.einsum("k,kcn->cn", fixed, np.array(columns)) if columns else 0.0
        left = np.sum((self.built.data - self.built.whiten(moved * np.ones_like(self.built.data))) ** 2, axis=1)
        off = np.concatenate([self.standing.bench.centre(self.names), self.standing.off])
        return 0.5 * float(np.sum(left / softening) + fixed @ fixed + off @ off)


def _gain(gram: np.ndarray, places: list[int], change: np.ndarray) -> float:
    """What coefficients add to half the energy and to the priors'."""
    return 0.5 * float(change @ gram[np.ix_(places, places)] @ change + change @ change) - float(gram[places, -1] @ change)


def run(standing: Standing) -> Frames:
    """The full twin there. The envelope's thermometer has no codes: their steps are noise, and stay out."""
    bench = standing.bench
    frames = full_twin(bench.driven, bench.grid, standing.settings, bench.unit.device)
    if "temperature_measured" in frames.names and "temperature_measured" in bench.names:
        frames.values[frames.names.index("temperature_measured")] = standing.envelope[bench.names.index("temperature_measured")]
    return frames


def without_effects(standing: Standing, frames: Frames) -> Frames:
    """What the full twin would show there without the effects, as far as the envelope twin is to be believed that near."""
    return _shifted(frames, standing.bench, standing.bench.nominal - standing.envelope)


def at_bench(standing: Standing, frames: Frames, bench: Bench) -> Frames:
    """Frames of the full twin without effects, moved to another unit as the envelope twin says."""
    return _shifted(frames, bench, bench.nominal - standing.bench.nominal)


def _shifted(frames: Frames, bench: Bench, by: np.ndarray) -> Frames:
    values = frames.values.copy()
    for name, row in zip(bench.names, by, strict=True):
        values[frames.names.index(name)] += row
    return replace(frames, values=values)


def _moved(here: _Here, enough: float, rounds: int) -> tuple[Standing, Frames, float]:
    """Until moving gains less than `enough` nats; the frames are moved along as the envelope twin says. Slopes are computed anew when the old ones
    no longer lead far. Also what was gained in all."""
    before, total = np.inf, 0.0
    for _ in range(rounds):
        step = _step(here)
        if step.gain < max(enough, LEAST_GAIN * step.left):
            break
        further = _further(here, step) if here.standing.near is None or step.gain <= SLOW * before else None
        if further is None and here.standing.near is not None:
            here = replace(here, standing=replace(here.standing, near=None))
            step = _step(here)
            further = _further(here, step)
        if further is None:
            break
        here, gained = further
        before, total = step.gain, total + gained
    return here.standing, here.frames, total


def _further(here: _Here, step: _Step) -> tuple[_Here, float] | None:
    """After the step, or a part of it, that leaves less, and by how much; None where no part does: along a ridge a linear system promises much."""
    cost, stride = here.cost(step.softening), 1.0
    while stride > SHORTEST:
        try:
            moved = replace(_along(here.standing, here.names, stride * step.change), near=here.standing.slopes)
            there = _Here(moved, here.setting, _shifted(here.frames, moved.bench, moved.envelope - here.standing.envelope))
        except BadInput:  # beyond what physics allows
            stride *= 0.3
            continue
        left = there.cost_with(step.softening, step.change[here.fixed])
        if left < cost:
            return _Here(_with_jacobian(moved, here.setting.pick), here.setting, there.frames), cost - left
        stride *= 0.3
    return None


def linear(standing: Standing, setting: Judged, built: System) -> system.Products:
    """What is uncertain, and behind it the explanation's unknowns."""
    about = np.concatenate([standing.bench.centre([name for name, _ in standing.slopes]), standing.off])
    return system.products(built, built.whiten(standing.columns(setting.pick)), about)


def _along(standing: Standing, names: list[str], change: np.ndarray) -> Standing:
    """The Jacobian stays that of before."""
    bench = standing.bench
    shell_off = bench.shell_off + (change[names.index(responses.SHELL)] if responses.SHELL in names else 0.0)
    moved = replace(standing, bench=bench.at(bench.unit.toward(change[: len(bench.unit.off)]), shell_off))
    if standing.jacobian is None:
        return moved
    return replace(moved, values=within_bounds(standing.unknowns, standing.values + change[len(names) :] * standing.spread))


def _with_jacobian(standing: Standing, pick: list[int]) -> Standing:
    """With the one of where it is now."""
    if standing.jacobian is None:
        return standing
    here = (standing.envelope - standing.bench.nominal)[pick]
    return replace(standing, jacobian=differences(standing.bench, pick, standing.unknowns, standing.values, here))


@dataclass(frozen=True)
class _Step:
    """change (count,): by how much what is uncertain should move; gain: of moving what is not fixed, left: beyond noise, both in nats and as far as a
    linear system knows. Channels in which much more is left than noise count less: softening (channels,)."""

    change: np.ndarray
    gain: float
    left: float
    softening: np.ndarray


def _step(here: _Here) -> _Step:
    built, table, fixed = here.built, here.table, here.fixed
    softening = np.ones(len(built.names))
    for _ in range(4):
        fitted = explain.explained(table, softening, table.count, [], (), 0.0)
        softening = np.maximum(1.0, fitted.left / np.maximum(built.n_rows, 1))
    gram, everything = table.pooled(softening), list(range(table.count))
    movable = sorted({*everything} - {*fixed})
    gram[movable, movable] += DAMPING
    changes = [explain.within(gram, places, -table.about[places], here.standing.limits[places]) for places in (fixed, everything)]
    costs = [_gain(gram, places, change) for places, change in zip((fixed, everything), changes, strict=True)]
    excess = 0.5 * float(gram[-1, -1]) + costs[1] - 0.5 * float(np.sum(built.n_rows / softening))
    return _Step(changes[1], costs[0] - costs[1], max(0.0, excess), softening)
