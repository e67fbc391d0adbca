"""The twin-level engine: slow channels of a described device -> which effects, by the envelope twin, confirmed by the full twin.

docs/DIAGNOSIS.md argues every step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wineglass.device import Device
from wineglass.diagnosis import channels, drive, explain, floors, follow, noisy, responses, seen_stairs, standing, system, task
from wineglass.diagnosis.changes import Left
from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.closure import Closed
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.explain import Explained
from wineglass.diagnosis.floors import Floor
from wineglass.diagnosis.noise_level import NoiseEvidence
from wineglass.diagnosis.responses import STAIRS, Bench, Responses
from wineglass.diagnosis.standing import Standing
from wineglass.diagnosis.system import System
from wineglass.diagnosis.unit import FARTHEST
from wineglass.diagnosis.vocabulary import FLICKER
from wineglass.recording import Recording
from wineglass.scenario import Run

ENGINE = "twin_level"
HOPELESS = 30.0  # energy per frame that a unit without effects may leave and still be worth another run of the full twin
HELD_OUT_SLACK = 2.0  # energy: of noise alone


def driven_by(recording: Recording, described: Device | None = None) -> Driven:
    return drive.from_recording(recording, described)


@dataclass
class TwinAnalysis:
    """Everything that verdict and report need.

    base: the full twin without effects. pick: the system's channels among those of bench and responses. none: no effect; closed:
    explanations followed on the envelope twin, the best first. held_none (folds, channels): energy left when nuisances are fitted on the other folds.
    alone: what the unit that the recording asks for leaves without any effect, held out; an explanation may stand about another unit.
    """

    driven: Driven
    grid: Grid
    recorded: Frames
    base: Frames
    floor: Floor
    pick: list[int]
    bench: Bench
    responses: Responses
    system: System
    table: system.Products
    none: Explained
    closed: list[Closed]
    softening: np.ndarray
    held_none: np.ndarray
    alone: Left
    ran: tuple[Standing, Frames] | None
    """where the full twin was run last with an explanation, and its frames"""

    @property
    def names(self) -> tuple[str, ...]:
        return self.system.names

    @cached_property
    def wandering(self) -> frozenset[int]:
        """Places of nuisances that are noise of a described floor."""
        return responses.wandering([self.responses.columns[i].name for i in self.responses.nuisances])

    def closed_for(self, ids: Iterable[str]) -> Closed | None:
        """The closed explanation with most of these effects and no others: some leave a trace in noise or codes only."""
        wanted = set(ids)
        able = [entry for entry in self.closed if set(entry.support) <= wanted]
        return max(able, key=lambda entry: len(entry.support), default=None)


def analyse(recording: Recording, described: Device | None = None, without: frozenset[str] = frozenset(),
            advance: Callable[[], None] = lambda: None, noise: NoiseEvidence | None = None) -> TwinAnalysis:
    """without: effects taken out of the catalogue (for tests of honesty). noise: what spectra and events say, if they were looked at."""
    driven = driven_by(recording, described)
    grid = channels.grid_of(recording)
    recorded = channels.read(recording, grid)
    named = frozenset(noise.named if noise is not None else ()) - without
    without |= noisy.unseen_bends(named)
    added = None
    if noise is not None and named:
        added = noise.added(named - {FLICKER}) if named - {FLICKER} else None
        driven = noisy.device_with(driven, noise.added(named & {FLICKER}))
        recorded = noisy.undisturbed(recorded, driven, noise) if noisy.DROPPED in named else recorded
        recorded = noisy.with_beats(recorded) if noisy.BENT & named else recorded
        recorded = noisy.without_beats(recorded, recording, noise) if noisy.BEATING & named else recorded
    stairs = noise.stairs if noise is not None else None
    bench = Bench(driven, grid, recorded.names, stairs=stairs)
    if stairs is not None and STAIRS not in without:
        driven = seen_stairs.with_known_zero(driven, bench, recorded, stairs)
        bench = Bench(driven, grid, recorded.names, stairs=stairs)
    loops = drive.loop_at(driven, grid.time_s)
    floor = floors.at_rest(driven, grid, bench.names, frozenset({"rebalance" if on else "open" for on in (loops.any(), loops.all())}), added)
    asked = task.asked(recorded, driven, recording, floor, system.chosen(bench.names, floor), without, advance)
    found = standing.exactly(standing.roughly(Standing(bench), asked)[0], asked, HOPELESS)
    advance()
    last, alone = follow.last_look(found.standing, found.frames, bench, asked)
    held_none = explain.held_out(last.table, last.softening, list(last.found.nuisances), FARTHEST)
    _hold_out(last.closed, held_none, last.softening)
    bench = last.bench
    bench.driven = replace(bench.driven, run=Run(bench.driven.run.scenario, driven.run.device, bench.unit.device))
    return TwinAnalysis(bench.driven, grid, recorded, last.base, asked.floor, asked.pick, bench, last.found, last.system, last.table, last.none, last.closed,
                        last.softening, held_none, alone, last.ran)


def _hold_out(closed: list[Closed], held_none: np.ndarray, softening: np.ndarray) -> None:
    """An effect earns its place when held-out data are predicted better with it than without, where the latter was followed too."""
    energy: dict[frozenset[str], float] = {frozenset(): float(np.sum(held_none / softening))}
    for entry in closed:
        limit = np.where(np.arange(entry.products.count) < entry.products.count - len(entry.unknowns), FARTHEST, np.inf)  # a unit may not take on what is no tolerance
        entry.held = explain.held_out(entry.products, softening, entry.places, limit)
        energy[frozenset(entry.support)] = float(np.sum(entry.held / softening))
    for entry in closed:
        whole = frozenset(entry.support)
        parts = [whole - {effect} for effect in entry.support]
        entry.earned = entry.possible and all(energy[whole] < energy[part] + HELD_OUT_SLACK for part in parts if part in energy)
