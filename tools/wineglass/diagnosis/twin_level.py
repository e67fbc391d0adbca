"""The twin-level engine: slow channels of a described device -> which effects, by the envelope twin, confirmed by the full twin.

docs/DIAGNOSIS.md argues every step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wineglass.device import Device
from wineglass.diagnosis import channels, drive, explain, floors, responses, system
from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.closure import Closed, Closer
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.explain import Explained
from wineglass.diagnosis.floors import Floor
from wineglass.diagnosis.responses import Bench, Responses
from wineglass.diagnosis.system import System
from wineglass.diagnosis.unit import FARTHEST
from wineglass.effects import Setting
from wineglass.recording import Recording
from wineglass.scenario import Run
from wineglass.simulation import in_memory

ENGINE = "twin_level"
QUIET = {"electronics.adc.snr_db": 0.0, "electronics.adc.bits": 32}
"""The twin without converter noise; the thermometer keeps its own, which breaks up the steps of its codes."""
CLOSED_SINGLES, CLOSED_SETS = 6, 6
PARTED = 2  # sets of each size that are also tried without each of their effects
LEAST_EVIDENCE = 4.0  # nats over no effect: a support below that is not closed
SIMPLE_ENOUGH = 0.15  # share of the gap's amplitude that an explanation may leave and still set what forms are worth
SWITCHING = 12  # frames after the loop was opened or closed
HELD_OUT_SLACK = 2.0  # energy: of noise alone
STRONG, SETTLED_SETS = 1e4, 4  # energy beyond which an effect changes what the uncertain values do; so many sets are then closed again
ROUGH_ROUNDS, UNIT_GAIN, ROUGH_GAIN = 5, 10.0, 1e4  # nats: the unit is found when moving it gains no more; before the full twin was run
DAMPING = 10.0  # of a step, in priors: what the data say little about stays where it is
FULL_ROUNDS = 3  # of the full twin at the unit, and of the envelope's moves from each
BEND = 0.03  # of the rate's span: a second difference beyond that is a step
MODEL = 3e-3  # share of an effect's amplitude to which the envelope twin is to be believed
FREEDOM = 10.0  # numbers that a wrong functional form is worth, per channel


def driven_by(recording: Recording, described: Device | None = None) -> Driven:
    return drive.from_recording(recording, described)


def full_twin(driven: Driven, grid: Grid, effects: Sequence[Setting] = (), truth: Device | None = None) -> Frames:
    """Frames of the full twin, firmware in the loop, over the recorded inputs, without the converters' noise. truth: None is the run's."""
    run = driven.run
    quiet = Run(run.scenario, run.device, (truth or run.truth).override(QUIET))
    return channels.read(in_memory(quiet, calibration_block=driven.calibration_block, effects=effects), grid)


@dataclass
class TwinAnalysis:
    """Everything that verdict and report need.

    base: the full twin without effects. pick: the system's channels among those of bench and responses. none: no effect; closed:
    explanations followed on the envelope twin, the best first. held_none (folds, channels): energy left when nuisances are fitted on the other folds.
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

    @property
    def names(self) -> tuple[str, ...]:
        return self.system.names

    def closed_for(self, ids: Iterable[str]) -> Closed | None:
        """The closed explanation with most of these effects and no others: some leave a trace in noise or codes only."""
        wanted = set(ids)
        able = [entry for entry in self.closed if set(entry.support) <= wanted]
        return max(able, key=lambda entry: len(entry.support), default=None)


def analyse(recording: Recording, described: Device | None = None, without: frozenset[str] = frozenset(),
            advance: Callable[[], None] = lambda: None) -> TwinAnalysis:
    """without: effects taken out of the catalogue (for tests of honesty)."""
    driven = driven_by(recording, described)
    grid = channels.grid_of(recording)
    recorded = channels.read(recording, grid)
    bench = Bench(driven, grid, recorded.names)
    rebalancing = drive.loop_at(driven, grid.time_s)
    floor = floors.at_rest(driven, grid, bench.names, frozenset({"rebalance" if on else "open" for on in (rebalancing.any(), rebalancing.all())}))
    pick = system.chosen(bench.names, floor)
    setting = _Setting(_where_it_counts(recorded, rebalancing), _picked(floor, pick), pick, edges_of(recording), jumps(driven, grid))
    bench, _ = _settled(bench, setting, Frames(grid, bench.names, bench.nominal, np.ones_like(bench.nominal, bool)), ROUGH_GAIN, ROUGH_ROUNDS)
    advance()
    bench, base = _on_the_full_twin(bench, setting)
    driven = replace(bench.driven, run=Run(bench.driven.run.scenario, driven.run.device, bench.unit.device))
    bench.driven = driven
    advance()
    found = responses.respond(bench, without)
    advance()
    built = setting.system(bench, base)
    columns = built.whiten(found.values[:, pick, :]) * np.array([c.scale for c in found.columns])[:, None, None]
    table = system.products(built, columns, np.pad(found.centre, (0, len(columns) - len(found.centre))))
    ranking = _ranked(table, found)
    advance()
    closer = Closer(bench, built, found, pick)
    closed = _with_parts(closer, [closer.close(entry) for entry in _worth_closing(ranking)])
    advance()
    counts = {effect: len(variants) for effect, variants in found.variants.items()}
    closed, softening, none = _weighed(built, closed, table, found, counts)
    if closed and float(np.sum(none.left - closed[0].entry.left)) > STRONG:
        closed = [closer.settle(entry) if place < SETTLED_SETS else entry for place, entry in enumerate(closed)]
        closed, softening, none = _weighed(built, closed, table, found, counts)
    held_none = explain.held_out(table, softening, list(found.nuisances))
    _hold_out(closed, held_none, softening)
    return TwinAnalysis(driven, grid, recorded, base, _picked(floor, pick), pick, bench, found, built, table, none, closed, softening, held_none)


@dataclass(frozen=True)
class _Setting:
    """What makes a system out of recorded and twin frames."""

    recorded: Frames
    floor: Floor
    pick: list[int]
    edges_s: list[float]
    jumps: np.ndarray

    def system(self, bench: Bench, base: Frames) -> System:
        names = tuple(bench.names[i] for i in self.pick)
        losses = bench.driven.run.device.noise_floor.drive_level_relative
        return system.build(self.recorded, base, self.floor, names, self.edges_s, self.jumps, regressors(bench.driven, bench, base), losses)


def _settled(bench: Bench, setting: _Setting, base: Frames, enough: float, rounds: int) -> tuple[Bench, Frames]:
    """The bench with the unit that fits the recording best within its tolerances, until moving it gains less than `enough` nats, and the base moved
    to that unit as the envelope twin says. base: frames of some twin of the bench's unit."""
    for _ in range(rounds):
        built = setting.system(bench, base)
        named = responses.uncertainties(bench)
        names = [name for name, _ in named]
        centre = bench.centre(names)
        table = system.products(built, built.whiten(np.array([slope[setting.pick] for _, slope in named])), centre)
        movable = [i for i, name in enumerate(names) if i < len(bench.unit.off) or name == responses.SHELL]
        change, gained = _within_tolerance(table, built, movable)
        if gained < enough:
            break
        shell_off = bench.shell_off + (change[names.index(responses.SHELL)] if responses.SHELL in names else 0.0)
        moved = bench.at(bench.unit.toward(change[: len(bench.unit.off)]), shell_off)
        values = base.values.copy()
        for i, name in enumerate(bench.names):
            values[base.names.index(name)] += moved.nominal[i] - bench.nominal[i]
        bench, base = moved, Frames(base.grid, base.names, values, base.use)
    return bench, base


def _on_the_full_twin(bench: Bench, setting: _Setting) -> tuple[Bench, Frames]:
    """The unit again, with the full twin run at it; once more where it then moved, as the envelope twin is a little off."""
    for _ in range(FULL_ROUNDS):
        base = _with_ideal_thermometer(full_twin(bench.driven, bench.grid, truth=bench.unit.device), bench)
        moved, base = _settled(bench, setting, base, UNIT_GAIN, FULL_ROUNDS)
        if moved is bench:
            break
        bench = moved
    return bench, base


def _within_tolerance(table: system.Products, built: System, movable: list[int]) -> tuple[np.ndarray, float]:
    """By how much (count,) what is uncertain should move, and what moving these gains, in nats, over all others alone. Channels in which much more
    is left than noise count less."""
    softening = np.ones(len(built.names))
    for _ in range(4):
        fitted = explain.explained(table, softening, table.count, [], (), 0.0)
        softening = np.maximum(1.0, fitted.left / np.maximum(built.n_rows, 1))
    gram, costs = table.pooled(softening), []
    gram[movable, movable] += DAMPING
    everything = list(range(table.count))
    for places in (sorted({*everything} - {*movable}), everything):
        change = explain.within(gram, places, -table.about[places], FARTHEST)
        part = gram[np.ix_(places, places)]
        costs.append(0.5 * float(change @ part @ change + change @ change) - float(gram[places, -1] @ change))
    return change, costs[0] - costs[1]


def _hold_out(closed: list[Closed], held_none: np.ndarray, softening: np.ndarray) -> None:
    """An effect earns its place when held-out data are predicted better with it than without, where the latter was followed too."""
    energy: dict[frozenset[str], float] = {frozenset(): float(np.sum(held_none / softening))}
    for entry in closed:
        entry.held = explain.held_out(entry.products, softening, entry.places)
        energy[frozenset(entry.support)] = float(np.sum(entry.held / softening))
    for entry in closed:
        whole = frozenset(entry.support)
        parts = [whole - {effect} for effect in entry.support]
        entry.earned = entry.possible and all(energy[whole] < energy[part] + HELD_OUT_SLACK for part in parts if part in energy)


def _with_ideal_thermometer(base: Frames, bench: Bench) -> Frames:
    """The envelope's thermometer has no codes: the steps of the full twin's are noise."""
    if "temperature_measured" not in base.names or "temperature_measured" not in bench.names:
        return base
    values = base.values.copy()
    values[base.names.index("temperature_measured")] = bench.nominal[bench.names.index("temperature_measured")]
    return Frames(base.grid, base.names, values, base.use)


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
    return Frames(recorded.grid, recorded.names, recorded.values, use)


def _picked(floor: Floor, pick: list[int]) -> Floor:
    return Floor(floor.rms[pick], floor.innovation[pick], floor.coefficients[pick])


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


def _ranked(table: system.Products, found: Responses) -> explain.Ranking:
    """What forms are worth depends on how much is explained, and the other way round: three rounds settle it."""
    softening = np.ones(len(table.generic))
    for _ in range(3):
        ranking = explain.rank(table, found, softening)
        best = ranking.entries[0]
        softening = explain.softening_of(ranking.none, best)
    return ranking


def _worth_closing(ranking: explain.Ranking) -> list[Explained]:
    """The best single effects, and the best sets."""
    def over_none(entry: Explained) -> float:
        return entry.log_evidence + entry.log_generic - ranking.none.log_evidence - ranking.none.log_generic

    able = [entry for entry in ranking.entries if over_none(entry) > LEAST_EVIDENCE]
    singles = [entry for entry in able if len(entry.support) == 1][:CLOSED_SINGLES]
    sets = [entry for entry in able if len(entry.support) > 1][:CLOSED_SETS]
    return [*singles, *sets]


def _with_parts(closer: Closer, closed: list[Closed]) -> list[Closed]:
    """Also what the best sets are without each of their effects: the linear pass may have needed help that the closed one does not."""
    found = {entry.support: entry for entry in closed}

    def cost(entry: Closed) -> float:
        return closer.cost_of(entry)

    for size in (3, 2):
        sets = sorted((entry for entry in found.values() if len(entry.support) == size), key=cost)[:PARTED]
        for entry in sets:
            for effect in entry.support:
                part = closer.without(entry, effect)
                if part.support not in found or cost(part) < cost(found[part.support]):
                    found[part.support] = part
    return list(found.values())


def _weighed(built: System, closed: list[Closed], table: system.Products, found: Responses, counts: dict[str, int]
             ) -> tuple[list[Closed], np.ndarray, Explained]:
    """Evidence of all closures: noise as large as the best one leaves it, forms believed as far as the simplest good one earns it."""
    nuisances = len(found.nuisances)
    ones = np.ones(len(table.generic))
    none = explain.explained(table, ones, nuisances, [], (), 0.0)
    for entry in closed:
        entry.weigh(ones, nuisances, counts)
    best = min(closed, key=lambda c: float(np.sum(c.entry.left)), default=None)
    noise = np.maximum(1.0, built.noise_left(built.data if best is None else built.data - built.whiten(best.response))) ** 2
    softening = _earned(closed, none) * noise
    none = explain.explained(table, softening, nuisances, [], (), 0.0)
    for entry in closed:
        entry.weigh(softening, nuisances, counts)
    return sorted(closed, key=lambda c: -(c.entry.log_evidence + c.entry.log_generic)), softening, none


def _earned(closed: list[Closed], none: Explained) -> np.ndarray:
    """(channels,): 1 + what the simplest good explanation leaves in a channel beyond noise, over the freedom of a wrong form."""
    if not closed:
        return np.ones(len(none.left))
    least = np.min([c.entry.left for c in closed], axis=0)
    whole = float(np.sum(none.left - least))
    for size in (1, 2, 3):
        able = [c for c in closed if len(c.support) == size]
        if not able:
            continue
        best = min(able, key=lambda c: float(np.sum(c.entry.left)))
        if float(np.sum(best.entry.left - least)) <= SIMPLE_ENOUGH**2 * whole or size == 3:
            break
    beyond_noise = np.maximum(0.0, best.entry.left - np.minimum(least, best.entry.left))
    return 1.0 + beyond_noise / FREEDOM + MODEL**2 * np.maximum(0.0, none.left - best.entry.left)
