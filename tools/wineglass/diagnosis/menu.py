"""What to run next, at twin level: both explanations through the protocol `full`, and where in it they would differ most.

The second explanation may adjust its parameters, and all nuisances, to imitate the first: what then still differs is the separation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wineglass import protocols, scenario
from wineglass.diagnosis import responses
from wineglass.diagnosis.channels import Grid
from wineglass.diagnosis.closure import Closed
from wineglass.diagnosis.responses import Bench
from wineglass.diagnosis.twin_level import TwinAnalysis
from wineglass.diagnosis.unknowns import SHAPE_STEP, settings_of
from wineglass.errors import BadInput

WORDS = {"rate": "rate steps", "chirp": "a rate chirp", "amplitude": "amplitude steps", "ring": "a ring-down with the drive off",
         "test": "forces on the sense axis", "free": "forces on the sense axis with the loop open"}
THERMAL = "thermal cycles at two speeds"
ENOUGH = 3.0  # nats


@dataclass(frozen=True)
class Proposal:
    run: str
    separation: float
    why: str


def propose(found: TwinAnalysis, first: Closed, second: Closed) -> Proposal:
    run = scenario.prepare(protocols.scenario("full", device=found.driven.run.device, loop=found.driven.run.scenario.mode.loop))
    run = scenario.Run(run.scenario, found.driven.run.device, found.driven.run.truth)
    bench = Bench(replace(found.driven, run=run, temperature_from="chamber_temperature"), _grid(found, run), found.names)
    try:
        left = _difference(found, bench, first, second)
    except BadInput:
        return Proposal("protocol full", ENOUGH, "there one of the explanations, as it stands, is beyond what the twin can run; a unit would show which")
    per_frame = 0.5 * np.sum(left**2, axis=0)
    energies = _by_kind(run.scenario, bench.grid, per_frame)
    total = float(per_frame.sum())
    best = max(energies, key=lambda kind: energies[kind])
    if total < ENOUGH:
        return Proposal("no experiment of the protocols separates these; calibrate one of them on the bench by itself", total,
                        "in every excitation of the protocol full they do the same")
    return Proposal(f"{best} (protocol full, or its segments with {best})", total, f"{energies[best] / total:.0%} of what would differ is there")


def _grid(found: TwinAnalysis, run: scenario.Run) -> Grid:
    return Grid(found.grid.frame_s, 8, int(run.scenario.duration_s / found.grid.frame_s) - 9)


def _difference(found: TwinAnalysis, bench: Bench, first: Closed, second: Closed) -> np.ndarray:
    """(channels, n) in units of the floor: what the second explanation cannot imitate of the first."""
    target = bench.run(first.settings) - bench.run(second.settings)
    at = bench.run(second.settings)
    columns = [response for _, response in responses.uncertainties(bench)]
    for i, unknown in enumerate(second.unknowns):
        moved = second.values.copy()
        step = SHAPE_STEP * unknown.spread
        moved[i] += step
        columns.append((bench.run(settings_of(second.unknowns, moved)) - at) / SHAPE_STEP)
    scale = found.system.floor.rms[:, None]
    rows = np.array([column / scale for column in columns]).reshape(len(columns), -1)
    wanted = (target / scale).ravel()
    inner = rows @ rows.T + np.eye(len(rows))
    return (wanted - np.linalg.lstsq(inner, rows @ wanted, rcond=None)[0] @ rows).reshape(target.shape)


def _by_kind(run: scenario.Scenario, grid: Grid, per_frame: np.ndarray) -> dict[str, float]:
    energies: dict[str, float] = {}
    for segment in run.segment:
        kind = WORDS.get(segment.name.split("_")[0], THERMAL)
        here = (grid.time_s >= segment.begin_s) & (grid.time_s < segment.end_s)
        energies[kind] = energies.get(kind, 0.0) + float(per_frame[here].sum())
    return energies
