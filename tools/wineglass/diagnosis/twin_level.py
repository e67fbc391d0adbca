"""The twin-level engine: slow channels of a described device -> which effects, by the envelope twin, confirmed by the full twin.

docs/DIAGNOSIS.md argues every step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wineglass import effects
from wineglass.device import Device
from wineglass.diagnosis import changes, channels, drive, explain, floors, forms, noisy, responses, standing, system
from wineglass.diagnosis.beside import LARGEST, beside
from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.closure import Closed, Closer, NoNumbersError, possible
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.explain import Explained, Support
from wineglass.diagnosis.floors import Floor
from wineglass.diagnosis.noise_level import NoiseEvidence
from wineglass.diagnosis.responses import Bench, Responses
from wineglass.diagnosis.standing import Standing
from wineglass.diagnosis.system import System
from wineglass.diagnosis.unit import FARTHEST
from wineglass.errors import BadInput
from wineglass.recording import Recording
from wineglass.scenario import Run

ENGINE = "twin_level"
CLOSED_SINGLES, CLOSED_SETS = 4, 3
ORDINARY = 3  # single effects beside which the unit is least off its description
BENT = 4  # explanations, the best first, whose forms may bend
PARTED = 1  # sets of each size that are also tried without each of their effects
LEAST_EVIDENCE = 4.0  # nats over no effect: a support below that is not closed
SIMPLE_ENOUGH = 0.15  # share of the gap's amplitude that an explanation may leave and still set what forms are worth
SWITCHING = 12  # frames after the loop was opened or closed
HOPELESS = 30.0  # energy per frame that a unit without effects may leave and still be worth another run of the full twin
HELD_OUT_SLACK = 2.0  # energy: of noise alone
FAR_OFF = 2.0  # standard deviations
FOLLOWED, NEARLY_ALL = 3, 3.0  # single effects, until one leaves so little energy per frame in every channel
QUIET_ENOUGH, STARTS = 1.5, 2  # energy per frame and channel that tolerances may leave; single effects to begin with
LOOKS, LOOK_AGAIN, BETTER = 3, 50.0, 3.0  # nats over no effect, from which on all explanations are looked at again about the full twin with the best one
BEND = 0.03  # of the rate's span: a second difference beyond that is a step
MODEL = 3e-3  # share of an effect's amplitude to which the envelope twin is to be believed
FREEDOM = 10.0  # numbers that a wrong functional form is worth, per channel


def driven_by(recording: Recording, described: Device | None = None) -> Driven:
    return drive.from_recording(recording, described)


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
    added = None
    if noise is not None and named:
        added = noise.added(named - {noisy.FLICKER}) if named - {noisy.FLICKER} else None
        driven = noisy.device_with(driven, noise.added(named & {noisy.FLICKER}))
        recorded = noisy.undisturbed(recorded, driven, noise) if noisy.DROPPED in named else recorded
        recorded = noisy.without_beats(recorded, recording, noise) if noisy.BEATING & named else recorded
    bench = Bench(driven, grid, recorded.names)
    rebalancing = drive.loop_at(driven, grid.time_s)
    floor = floors.at_rest(driven, grid, bench.names, frozenset({"rebalance" if on else "open" for on in (rebalancing.any(), rebalancing.all())}), added)
    pick = system.chosen(bench.names, floor)
    aside = rebalancing if np.mean(rebalancing) < 0.5 else ~rebalancing
    setting = _Setting(_where_it_counts(recorded, rebalancing), _picked(floor, pick), pick, edges_of(recording), jumps(driven, grid), aside)
    found = standing.exactly(standing.roughly(Standing(bench), setting)[0], setting, HOPELESS)
    there, base = found.standing, found.frames
    advance()
    look = _explained(there, base, bench, setting, without, advance) if _has_a_gap(there, base, setting) else _look(there.bench, base, setting, without, advance, largest=0)
    bench, seen, table, none, closed, softening = look.bench, look.found, look.table, look.none, look.closed, look.softening
    held_none = explain.held_out(table, softening, list(seen.nuisances), FARTHEST)
    _hold_out(closed, held_none, softening)
    bench.driven = replace(bench.driven, run=Run(bench.driven.run.scenario, driven.run.device, bench.unit.device))
    return TwinAnalysis(bench.driven, grid, recorded, look.base, _picked(floor, pick), pick, bench, seen, look.system, table, none, closed, softening, held_none, look.ran)


def _has_a_gap(there: Standing, frames: Frames, setting: _Setting) -> bool:
    """Is any channel further from the full twin on held-out data than its floor? Where none is there is nothing (more) to explain."""
    built = setting.system(there.bench, frames)
    wandering = responses.wandering([name for name, _ in there.slopes])
    left = np.array([setting.recorded[name] - frames[name] for name in built.names])
    left = left - changes.folded(built, standing.linear(there, setting, built), np.ones(len(built.names)), there.columns(setting.pick), wandering, FARTHEST)
    return changes.changes(built, left, left)[1].fraction is not None


def _explained(there: Standing, base: Frames, nominal: Bench, setting: _Setting, without: frozenset[str], advance: Callable[[], None]) -> _Look:
    """The last look, after the best explanations were followed on the full twin. there: the unit that the recording asks for, base: the twin's frames of it."""
    look, followed = None, set()
    if float(np.max(standing.energy_left(there, setting, base))) >= QUIET_ENOUGH:
        places = [lambda: (there.bench, base), lambda: (nominal, _frames_of(nominal, there, base))]
        look, followed = _from_singles(places, setting, without, advance)
    look = look or _look(there.bench, base, setting, without, advance)
    spent = 1 if followed else 0
    while not look.settled and spent < LOOKS and (best := look.promising(followed)) is not None:
        look = _followed(best, Standing(look.bench, best.unknowns, best.values, best.jacobian), setting, without, advance) or look
        followed.add(best.support)
        spent += 1
    return look


@dataclass(frozen=True)
class _Start:
    """An explanation, where it is to be followed from, and what the envelope twin says that it leaves (channels,)."""

    closed: Closed
    standing: Standing
    left: np.ndarray

    @property
    def possible(self) -> bool:
        return possible(self.standing.unknowns, self.standing.values)


def _frames_of(described: Bench, there: Standing, base: Frames) -> Frames:
    """The full twin's frames of the described unit: run again, where another one is too far from it for the envelope twin to say the difference."""
    far = float(np.max(np.abs(there.bench.unit.off), initial=0.0)) >= FAR_OFF
    return standing.run(Standing(described)) if far else standing.at_bench(there, base, described)


def _from_singles(places: list[Callable[[], tuple[Bench, Frames]]], setting: _Setting, without: frozenset[str], advance: Callable[[], None]
                  ) -> tuple[_Look | None, set[Support]]:
    """The look that leaves least after a single effect was followed on the full twin, and which were. places: units with the full twin's frames there, so that
    what the envelope misses favours none: the unit that the recording asks for, and the described one, because a unit that has taken on a gap hides its cause."""
    starts: list[_Start] = []
    for place in places:
        starts += _starts(*place(), setting, without, advance)
        if any(start.possible and np.max(start.left) < QUIET_ENOUGH for start in starts):
            break
    best, followed = None, set[Support]()
    for start in sorted(starts, key=lambda start: (not start.possible, float(np.sum(start.left)))):
        if len(followed) == FOLLOWED or (best is not None and (best.settled or best.least < NEARLY_ALL)):
            break
        if start.closed.support in followed:
            continue
        followed.add(start.closed.support)
        look = _followed(start.closed, start.standing, setting, without, advance)
        if look is not None and (best is None or look.settled or look.least < best.least):
            best = look
    return best, followed


def _starts(bench: Bench, frames: Frames, setting: _Setting, without: frozenset[str], advance: Callable[[], None]) -> Iterator[_Start]:
    look = _look(bench, frames, setting, without, advance, largest=1, bend=False)
    ordinary = sorted(look.closed, key=lambda closed: _strain(closed.entry, len(look.found.nuisances)))[:ORDINARY]
    for entry in {closed.support: closed for closed in [*look.closed[:STARTS], *ordinary]}.values():
        start = Standing(bench, entry.unknowns, entry.values, entry.jacobian)
        with suppress(BadInput):  # closed where the twin refused a little more
            there, near = standing.roughly(start, setting, standing.with_effects(start, frames))
            yield _Start(entry, there, standing.energy_left(there, setting, near))


def _followed(closed: Closed, start: Standing, setting: _Setting, without: frozenset[str], advance: Callable[[], None]) -> _Look | None:
    """All explanations, about where the full twin puts this one; where it leaves no gap no sets are asked for that hold more. None: the full twin refuses it."""
    try:
        found = standing.exactly(start, setting)
        there, frames = found.standing, found.frames
        settled = not _has_a_gap(there, frames, setting)
        base = standing.without_effects(there, frames)
        look = _look(there.bench, base, setting, without, advance, (closed, there), largest=1 if settled else LARGEST, settled=settled)
        return replace(look, ran=found.ran)
    except (BadInput, NoNumbersError):
        return None


@dataclass(frozen=True)
class _Look:
    """All explanations about one bench: base: the twin's frames there without effects; softening (channels,); closed: the best first; settled: the one that
    was followed leaves no gap; ran: where the full twin was run with it, and its frames."""

    bench: Bench
    base: Frames
    found: Responses
    system: System
    table: system.Products
    none: Explained
    closed: list[Closed]
    softening: np.ndarray
    settled: bool
    ran: tuple[Standing, Frames] | None = None

    def over_none(self, closed: Closed) -> float:
        return closed.entry.log_evidence + closed.entry.log_generic - self.none.log_evidence - self.none.log_generic

    @property
    def least(self) -> float:
        """Energy per frame in the channel where the best explanation leaves most."""
        per_frame = [float(np.max(entry.entry.left / np.maximum(self.system.n_rows, 1))) for entry in self.closed]
        return min(per_frame, default=np.inf)

    def promising(self, followed: set[Support]) -> Closed | None:
        """What to follow on the full twin next: of all single effects the one that leaves least; then what does better than that."""
        able = [entry for entry in self.closed if self.over_none(entry) > LOOK_AGAIN]
        if not followed:
            return min(able, key=lambda entry: (len(entry.support), float(np.sum(entry.entry.left))), default=None)
        so_far = max((self.over_none(entry) for entry in self.closed if entry.support in followed), default=-np.inf)
        best = able[0] if able and self.over_none(able[0]) > so_far + BETTER else None
        return None if best is None or best.support in followed else best


def _look(bench: Bench, base: Frames, setting: _Setting, without: frozenset[str], advance: Callable[[], None],
          known: tuple[Closed, Standing] | None = None, largest: int = LARGEST, settled: bool = False, bend: bool = True) -> _Look:
    """base: the twin's frames at the bench's unit, without effects. known: an explanation, and where it stands about this bench; settled: it leaves no gap.
    largest: set of effects that is closed; bend: laws may, where that is worth it."""
    found = responses.respond(bench, without if largest else frozenset(effect.id for effect in effects.catalogue()), bend=bend)
    advance()
    built = setting.system(bench, base, unknown=True)
    columns = built.whiten(found.values[:, setting.pick, :]) * np.array([c.scale for c in found.columns])[:, None, None]
    table = system.products(built, columns, np.pad(found.centre, (0, len(columns) - len(found.centre))))
    counts = {effect: len(variants) for effect, variants in found.variants.items()}
    closer = Closer(bench, built, found, setting.pick)
    closed = _closed(closer, columns, table, counts, known, largest, settled, bend)
    advance()
    weighed, softening, none = _weighed(built, _with_parts(closer, closed), table, found, counts)
    return _Look(bench, base, found, built, table, none, weighed, softening, settled)


def _closed(closer: Closer, columns: np.ndarray, table: system.Products, counts: dict[str, int], known: tuple[Closed, Standing] | None, largest: int,
            settled: bool, bend: bool) -> list[Closed]:
    """Explanations, one for each set of effects. Laws bend of the one that was followed, where it leaves more than noise, and of others where all do. The rest
    as for `_look`."""
    found, closed = closer.responses, dict[Support, Closed]()
    if known is not None:
        best, there = known
        assert there.jacobian is not None
        followed = closer.resume(best.support, best.variants, best.unknowns, there.values, there.jacobian)
        closed = _with_one_more(closer, followed, columns, counts, settled)
    for entry in _worth_closing(_ranked(table, found), len(found.nuisances)) if largest else []:
        if entry.support not in closed and len(entry.support) <= largest:
            with suppress(NoNumbersError):
                closed[entry.support] = closer.close(entry)
    order = sorted(closed.values(), key=closer.cost_of)[:BENT]
    own = [closed[known[0].support]] if known is not None else []
    all_leave = bool(order) and forms.leaves(closer, order[0])
    for straight in {entry.support: entry for entry in [*own, *(order if all_leave else [])]}.values() if bend else []:
        bent = forms.bent(closer, straight)
        if bent is not straight:
            more = known is not None and bent.support == known[0].support
            closed |= _cheapest(closer, closed, _with_one_more(closer, bent, columns, counts, settled or not more))
    return list(closed.values())


def _cheapest(closer: Closer, so_far: dict[Support, Closed], more: dict[Support, Closed]) -> dict[Support, Closed]:
    """Of the latter those that are new, or better."""
    return {support: entry for support, entry in more.items() if support not in so_far or closer.cost_of(entry) < closer.cost_of(so_far[support])}


def _with_one_more(closer: Closer, closed: Closed, columns: np.ndarray, counts: dict[str, int], settled: bool) -> dict[Support, Closed]:
    """An explanation, and what it is with one more effect beside it."""
    closed.weigh(np.ones(len(closer.system.names)), len(closer.responses.nuisances), counts)
    more = [] if settled else beside(closer, closed, closer.responses, columns, counts)
    return {entry.support: entry for entry in [closed, *more]}


@dataclass(frozen=True)
class _Setting:
    """What makes a system out of recorded and twin frames."""

    recorded: Frames
    floor: Floor
    pick: list[int]
    edges_s: list[float]
    jumps: np.ndarray
    aside: np.ndarray
    """(n,): frames in the loop that was in use for the shorter time"""

    def system(self, bench: Bench, base: Frames, unknown: bool = False) -> System:
        """unknown: with what an effect of no known kind may follow."""
        names = tuple(bench.names[i] for i in self.pick)
        losses = bench.driven.run.device.noise_floor.drive_level_relative
        followed = regressors(bench.driven, bench, base) if unknown else None
        return system.build(self.recorded, base, self.floor, names, self.edges_s, self.jumps, followed, losses, self.aside)


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


def _worth_closing(ranking: explain.Ranking, nuisances: int) -> list[Explained]:
    """The best single effects, those beside which the unit is an ordinary one, and the best sets."""
    def over_none(entry: Explained) -> float:
        return entry.log_evidence + entry.log_generic - ranking.none.log_evidence - ranking.none.log_generic

    able = [entry for entry in ranking.entries if over_none(entry) > LEAST_EVIDENCE]
    singles, sets = [entry for entry in able if len(entry.support) == 1], [entry for entry in able if len(entry.support) > 1]
    ordinary = sorted(singles, key=lambda entry: _strain(entry, nuisances))[:ORDINARY]
    return [*singles[:CLOSED_SINGLES], *(entry for entry in ordinary if entry not in singles[:CLOSED_SINGLES]), *sets[:CLOSED_SETS]]


def _strain(entry: Explained, nuisances: int) -> float:
    """How far from its description a unit has to be beside an explanation: half the energy of its priors."""
    return 0.5 * float(np.sum(entry.coefficients[:nuisances] ** 2))


def _with_parts(closer: Closer, closed: list[Closed]) -> list[Closed]:
    """Also what the best sets are without each of their effects: the linear pass may have needed help that the closed one does not."""
    found = {entry.support: entry for entry in closed}

    def cost(entry: Closed) -> float:
        return closer.cost_of(entry)

    for size in (3, 2):
        sets = sorted((entry for entry in found.values() if len(entry.support) == size), key=cost)[:PARTED]
        for entry in sets:
            for effect in entry.support:
                try:
                    part = closer.without(entry, effect)
                except NoNumbersError:
                    continue
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
