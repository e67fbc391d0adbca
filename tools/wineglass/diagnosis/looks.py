"""One look at a recording: all explanations about one unit, closed on the envelope twin, laws bent where that is worth it, and weighed."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from wineglass import effects
from wineglass.diagnosis import changes, explain, forms, responses, stretches, system
from wineglass.diagnosis.beside import LARGEST, beside
from wineglass.diagnosis.channels import Frames
from wineglass.diagnosis.closure import Closed, Closer, NoNumbersError
from wineglass.diagnosis.explain import Explained, Support
from wineglass.diagnosis.responses import Bench, Responses
from wineglass.diagnosis.standing import Standing
from wineglass.diagnosis.system import System
from wineglass.diagnosis.task import Task

CLOSED_SINGLES, CLOSED_SETS = 4, 3
ORDINARY = 3  # single effects beside which the unit is least off its description
MOST_BENT = 2  # single effects, and explanations of any size, the best first, whose forms may bend
MOST_STARTS = 2  # explanations beside which something may come and go
PARTED = 1  # sets of each size that are also tried without each of their effects
LEAST_EVIDENCE = 4.0  # nats over no effect: a support below that is not closed
SIMPLE_ENOUGH = 0.15  # share of the gap's amplitude that an explanation may leave and still set what forms are worth
LOOK_AGAIN, BETTER = 50.0, 3.0  # nats over no effect, and over what was followed, from which on an explanation is followed on the full twin
NEAR = 10.0  # energy per frame and channel: a bent law that leaves less is worth another run of the full twin
FAR_LESS = 0.3  # of the energy that what was followed leaves: what leaves less is worth following, too
MODEL = 3e-3  # share of an effect's amplitude to which the envelope twin is to be believed
UNHEARD = 1e12  # softening of a channel that does not count
FREEDOM = 10.0  # numbers that a wrong functional form is worth, per channel


Law = tuple[Support, frozenset[tuple[str, str]]]
"""An explanation's effects, and the forms in which their laws are bent."""


def law_of(closed: Closed) -> Law:
    return closed.support, frozenset((u.effect, u.name) for u in closed.unknowns if u.role == "form")


@dataclass(frozen=True)
class Look:
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
    def hint(self) -> float:
        """Nats that a discrepancy of no known kind gains where no effect is, in channels that do not speak briefly only."""
        unheard = np.where(changes.brief(changes.counted(self.system)), UNHEARD, 1.0)
        return explain.explained(self.table, unheard, len(self.found.nuisances), [], (), 0.0, self.found.tolerances).log_generic

    @property
    def least(self) -> float:
        """Energy per frame in the channel where the best explanation leaves most."""
        return min((float(np.max(self._per_frame(entry))) for entry in self.closed), default=np.inf)

    def _per_frame(self, closed: Closed) -> np.ndarray:
        """(channels,): energy left."""
        return closed.entry.left / np.maximum(self.system.n_rows, 1)

    def promising(self, followed: set[Law]) -> Closed | None:
        """What to follow on the full twin next, of what no bound holds back: of all single effects the one that leaves least; then the best of what was followed, if
        its law has bent since and leaves little; then what does better; then what leaves far less, because it is only there that it can do better."""
        able = [entry for entry in self.closed if entry.possible and self.over_none(entry) > LOOK_AGAIN]
        if not followed:
            return min(able, key=lambda entry: (len(entry.support), float(np.sum(entry.entry.left))), default=None)
        supports = {support for support, _ in followed}
        so_far, new = [entry for entry in self.closed if entry.support in supports], [entry for entry in able if entry.support not in supports]
        best = max(so_far, key=self.over_none, default=None)
        if best is not None and best.possible and law_of(best) not in followed and np.max(self._per_frame(best)) < NEAR:
            return best
        if new and (best is None or self.over_none(new[0]) > BETTER + self.over_none(best)):
            return new[0]
        least = min((self._beyond_noise(entry) for entry in so_far), default=np.inf)
        return min((entry for entry in new if self._beyond_noise(entry) < FAR_LESS * least), key=self._beyond_noise, default=None)

    def without(self, refuted: Closed) -> Look:
        """The look where an explanation is none, because the full twin does not bear out what the envelope twin promised of it."""
        return replace(self, closed=[entry for entry in self.closed if entry.support != refuted.support])

    def _beyond_noise(self, closed: Closed) -> float:
        """Energy left."""
        return float(np.sum(np.maximum(0.0, closed.entry.left - self.system.n_rows)))


def look(bench: Bench, base: Frames, task: Task, known: tuple[Closed, Standing] | None = None, largest: int = LARGEST, settled: bool = False,
         bend: bool = True) -> Look:
    """base: the twin's frames at the bench's unit, without effects. known: an explanation, and where it stands about this bench; settled: it leaves no gap.
    largest: set of effects that is closed; bend: laws may, where that is worth it."""
    found = responses.respond(bench, task.without if largest else frozenset(effect.id for effect in effects.catalogue()), bend=bend)
    task.advance()
    built = task.system(bench, base, unknown=True)
    counts = {effect: len(variants) for effect, variants in found.variants.items()}
    closer = Closer(bench, built, found, task.pick)
    table = closer.table
    closed = _closed(closer, counts, known, largest, settled, bend)
    task.advance()
    weighed, softening, none = _weighed(built, _with_parts(closer, closed), table, found, counts, known[0].support if known is not None else None)
    return Look(bench, base, found, built, table, none, weighed, softening, settled)


def _closed(closer: Closer, counts: dict[str, int], known: tuple[Closed, Standing] | None, largest: int, settled: bool, bend: bool) -> list[Closed]:
    """Explanations, one for each set of effects. Laws bend of the one that was followed, where it leaves more than noise, and of others where all do. The rest
    as for `look`."""
    found, closed = closer.responses, dict[Support, Closed]()
    if known is not None:
        best, there = known
        assert there.jacobian is not None
        followed = forms.pruned(closer, closer.resume(best.support, best.variants, best.unknowns, there.values, there.jacobian))
        closed = {**(_exchanged(closer, followed, counts) if settled else {}), **_with_one_more(closer, followed, counts, settled)}
    for entry in _worth_closing(_ranked(closer.table, found), len(found.nuisances)) if largest else []:
        if entry.support not in closed and len(entry.support) <= largest:
            with suppress(NoNumbersError):
                closed[entry.support] = forms.pruned(closer, closer.close(entry))
    own = [closed[known[0].support]] if known is not None else []
    able = _leaving(closer, closed)
    for start in _starts(closer, [*own, *able], largest, known is None) if largest and (able or not closed) else []:
        closed |= _cheapest(closer, closed, {entry.support: entry for entry in stretches.beside(closer, start)})
    able = _leaving(closer, closed)
    for straight in {entry.support: entry for entry in [*own, *able]}.values() if bend else []:
        bent = forms.bent(closer, straight)
        if bent is not straight:
            alone = settled or known is None or bent.support != known[0].support
            closed |= _cheapest(closer, closed, _with_one_more(closer, bent, counts, alone))
    return [forms.thinned(closer, entry) for entry in closed.values()] if settled else list(closed.values())


def _starts(closer: Closer, able: list[Closed], largest: int, fresh: bool) -> list[Closed]:
    """Explanations beside which something may come and go: none, if nothing was followed yet, and the best few."""
    few = list({entry.support: entry for entry in able if len(entry.support) <= largest and stretches.able(entry)}.values())[:MOST_STARTS]
    return [closer.nothing(), *few] if fresh else few


def _leaving(closer: Closer, closed: dict[Support, Closed]) -> list[Closed]:
    """The best explanations, and the best single effects, where all leave more than noise."""
    order = sorted(closed.values(), key=closer.cost_of)
    if not order or not forms.leaves(closer, order[0]):
        return []
    return [*order[:MOST_BENT], *[entry for entry in order if len(entry.support) == 1][:MOST_BENT]]


def _cheapest(closer: Closer, so_far: dict[Support, Closed], more: dict[Support, Closed]) -> dict[Support, Closed]:
    """Of the latter those that are new, or better."""
    return {support: entry for support, entry in more.items() if support not in so_far or closer.cost_of(entry) < closer.cost_of(so_far[support])}


def _with_one_more(closer: Closer, closed: Closed, counts: dict[str, int], alone: bool) -> dict[Support, Closed]:
    """An explanation, and, unless it is to stay alone, what it is with one more effect beside it."""
    closed.weigh(np.ones(len(closer.system.names)), len(closer.responses.nuisances), counts)
    more = [] if alone else beside(closer, closed, counts)
    return {entry.support: entry for entry in [closed, *more]}


def _exchanged(closer: Closer, closed: Closed, counts: dict[str, int]) -> dict[Support, Closed]:
    """What a set would be with another effect in the place of each of its own: one of them may have a twin. Of a single effect all others are closed anyway."""
    found = dict[Support, Closed]()
    for effect in closed.support if len(closed.support) > 1 else ():
        with suppress(NoNumbersError):
            less = closer.without(closed, effect)
            less.weigh(np.ones(len(closer.system.names)), len(closer.responses.nuisances), counts)
            found |= _cheapest(closer, found, {entry.support: entry for entry in beside(closer, less, counts)})
    return found


def _ranked(table: system.Products, found: Responses) -> explain.Ranking:
    """What forms are worth depends on how much is explained, and the other way round: three rounds settle it."""
    softening = np.ones(len(table.generic))
    for _ in range(2):
        ranking = explain.rank(table, found, softening, shortlist=True)
        softening = explain.softening_of(ranking.none, ranking.entries[0])
    return explain.rank(table, found, softening)


def _worth_closing(ranking: explain.Ranking, nuisances: int) -> list[Explained]:
    """The best single effects, those beside which the unit is an ordinary one, and the best sets."""
    def over_none(entry: Explained) -> float:
        return entry.log_evidence + entry.log_generic - ranking.none.log_evidence - ranking.none.log_generic

    able = [entry for entry in ranking.entries if over_none(entry) > LEAST_EVIDENCE]
    singles, sets = [entry for entry in able if len(entry.support) == 1], [entry for entry in able if len(entry.support) > 1]
    ordinary = sorted(singles, key=lambda entry: explain.strain(entry, nuisances))[:ORDINARY]
    return list({entry.support: entry for entry in [*singles[:CLOSED_SINGLES], *ordinary, *sets[:CLOSED_SETS]]}.values())


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


def _weighed(built: System, closed: list[Closed], table: system.Products, found: Responses, counts: dict[str, int], followed: Support | None
             ) -> tuple[list[Closed], np.ndarray, Explained]:
    """Evidence of all closures: noise as large as the best one leaves it, forms believed as far as the simplest good one earns it. followed: what the full twin
    was run with."""
    nuisances = len(found.nuisances)
    ones = np.ones(len(table.generic))
    none = explain.explained(table, ones, nuisances, [], (), 0.0, found.tolerances)
    for entry in closed:
        entry.weigh(ones, nuisances, counts, found.tolerances)
    best = min(closed, key=lambda c: float(np.sum(c.entry.left)), default=None)
    noise = np.maximum(1.0, built.noise_left(built.data if best is None else built.data - built.whiten(best.response))) ** 2
    simplest = _simplest(closed, none)
    softening = _earned(closed, simplest, none) * noise
    none = explain.explained(table, softening, nuisances, [], (), 0.0, found.tolerances)
    for entry in closed:
        entry.weigh(softening, nuisances, counts, found.tolerances)
    if simplest is not None and followed is not None and set(simplest.support) <= set(followed):
        for entry in closed:
            if set(entry.support) > set(simplest.support):
                entry.entry = replace(entry.entry, log_evidence=entry.entry.log_evidence + _more(entry, simplest, softening, noise * built.n_rows))
    return sorted(closed, key=lambda c: -(c.entry.log_evidence + c.entry.log_generic)), softening, none


def _simplest(closed: list[Closed], none: Explained) -> Closed | None:
    """The explanation of fewest effects that leaves little; of as many, the one that leaves least."""
    if not closed:
        return None
    least = np.min([c.entry.left for c in closed], axis=0)
    whole = float(np.sum(none.left - least))
    for size in (1, 2, 3):
        able = [c for c in closed if len(c.support) == size]
        if not able:
            continue
        best = min(able, key=lambda c: float(np.sum(c.entry.left)))
        if float(np.sum(best.entry.left - least)) <= SIMPLE_ENOUGH**2 * whole or size == 3:
            break
    return best


def _earned(closed: list[Closed], simplest: Closed | None, none: Explained) -> np.ndarray:
    """(channels,): 1 + what the simplest good explanation leaves in a channel beyond noise, over the freedom of a wrong form."""
    if simplest is None:
        return np.ones(len(none.left))
    left = simplest.entry.left
    beyond_noise = np.maximum(0.0, left - np.min([c.entry.left for c in closed], axis=0))
    return 1.0 + beyond_noise / FREEDOM + MODEL**2 * np.maximum(0.0, none.left - left)


def _more(entry: Closed, simplest: Closed, softening: np.ndarray, noise: np.ndarray) -> float:
    """Nats that one more effect beside an explanation earns beyond what the softening grants: how wrong a form is nobody knows, so that what is left of a
    discrepancy counts by its ratio, however large it was."""
    unknown = FREEDOM + (explain.FLOOR_KNOWN - 1.0) * noise
    before, after = (np.maximum(0.0, c.entry.left - noise) + unknown for c in (simplest, entry))
    granted = 0.5 * (simplest.entry.left - entry.entry.left) / softening
    return float(np.sum(np.maximum(0.0, 0.5 * FREEDOM * np.log(before / after) - granted)))
