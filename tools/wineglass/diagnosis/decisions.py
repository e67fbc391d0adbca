"""From probabilities to a verdict: what is named, held to what it removes on held-out data, to what would imitate it, and to what is beside it.

decide() reads the probabilities; every question after that may change the outcome, and the probabilities with it. The questions of held-out data are a list: the
first that has an answer gives it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wineglass.diagnosis import hypotheses, plain
from wineglass.diagnosis.closure import Closed
from wineglass.diagnosis.confirmation import Confirmed
from wineglass.diagnosis.hypotheses import SETTLED, Hypotheses, Ids
from wineglass.diagnosis.noise_level import SURE, NoiseEvidence
from wineglass.diagnosis.noisy import FED
from wineglass.diagnosis.twin_level import TwinAnalysis
from wineglass.diagnosis.vocabulary import FLICKER, NONE, OTHER

UNKNOWN_ABOVE = 0.5
NAMED_BESIDE = 0.7  # of an effect beside something unknown, which may be all of it
WANDERS = 0.5  # that what nothing foretells is a bias that wanders: one is as likely as the other
IMITATED = 0.33  # of an explanation that as few plain laws would imitate as it has numbers: that it is something unknown
NEARLY_REMOVED, NEARLY_OF_SEVERAL = 0.93, 0.95  # by a single effect, and by several: what is left may be their own laws'
NEARLY_OF_TRACED = 0.75  # by an effect that is there anyway: noise, lines, events or codes show it
NONE_BELOW = 0.1  # of no gap: only then is there one. In five scored sets healthy units had 0.19, and no gap that was found rightly had more than 0.08
MUCH_LEFT = 3.0  # floors: of a large gap nearly all may be removed, and what is left is another effect or the law's own, one as likely as the other
MANY = 3  # effects that only means show: so many numbers fit others' doings, too
NOISE_LEFT = 1.3  # floors: a small gap of which no more is left says little about how much of it was removed
LEAST_REMOVED = 0.2  # of the held-out gap: less is nothing
ENOUGH_REMOVED, ENOUGH_OF_SEVERAL = 0.965, 0.98  # an explanation that leaves more does not stand alone; several effects imitate another one more easily
FORETOLD = 40.0  # energy in floors, twenty nats: what an explanation foretells of a channel within its floor is there
PLAIN = 2.0  # floors: a gap of that size is there, whatever no explanation is worth
SHAKEN = 5.0  # floors, in any channel: what a line, noise or events that are named may leave in means, and nothing else need explain


@dataclass(frozen=True)
class Outcome:
    """verdict; named: the explanations; chosen: the closed one that is confirmed on the full twin"""

    verdict: str
    named: list[Ids]
    chosen: Closed | None


def decide(found: TwinAnalysis, weighed: Hypotheses) -> Outcome:
    if weighed.none > NONE_BELOW:
        return Outcome("no_gap", [], None)
    known = weighed.best_known
    if weighed.other > UNKNOWN_ABOVE:
        return Outcome("unknown", [known] if known else [], found.closed_for(known) if known else None)
    named = hypotheses.alternatives(weighed)
    if not named:
        return Outcome("unknown", [], None)
    chosen = found.closed_for(named[0])
    if len(named) > 1:
        return Outcome("ambiguous", named, chosen)
    holding = sum(p for ids, p in weighed.probability.items() if set(named[0]) <= set(ids))
    if holding >= SETTLED:
        return Outcome("attributed", named, chosen)
    rivals = [ids for ids in weighed.probability if ids != (NONE,) and not set(named[0]) <= set(ids)]
    return Outcome("ambiguous", [named[0], max(rivals, key=lambda ids: weighed.probability[ids], default=(OTHER,))], chosen)


Answer = tuple[Outcome, Hypotheses]
WANDERS_OR_UNKNOWN: list[Ids] = [(FLICKER,), (OTHER,)]


def traced(noise: NoiseEvidence | None) -> frozenset[str]:
    """Effects that are there whatever means say: noise, lines, events or codes have named them."""
    return frozenset(noise.named if noise is not None else ())


# --- held-out data ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Case:
    """An outcome before the held-out data. removed: of the held-out gap, None: there is none"""

    found: TwinAnalysis
    outcome: Outcome
    weighed: Hypotheses
    confirmed: Confirmed
    noise: NoiseEvidence | None
    removed: float | None

    @property
    def traced(self) -> frozenset[str]:
        return traced(self.noise)


def held_to_the_gap(found: TwinAnalysis, outcome: Outcome, weighed: Hypotheses, confirmed: Confirmed, noise: NoiseEvidence | None) -> Answer:
    """What no channel shows on held-out data is no gap; what an explanation does not remove there, it does not explain. What noise, lines, events or codes
    have named stands without that."""
    case = _Case(found, outcome, weighed, confirmed, noise, _removed(outcome, confirmed))
    return next(answer for question in QUESTIONS if (answer := question(case)) is not None)


def _removed(outcome: Outcome, confirmed: Confirmed) -> float | None:
    another_unit_does = outcome.chosen is not None and confirmed.gained.before <= PLAIN and (confirmed.gained.fraction or 0.0) < LEAST_REMOVED
    return None if another_unit_does else confirmed.total.fraction


def _is_there_none(case: _Case) -> Answer | None:
    """No gap, says the evidence: then held-out data may not show one either."""
    if case.outcome.verdict != "no_gap":
        return None
    if case.removed is None:
        return case.outcome, hypotheses.below_the_floor(case.weighed)
    if case.confirmed.total.before > PLAIN:
        return Outcome("unknown", [], None), hypotheses.not_none(case.weighed)
    return case.outcome, case.weighed


def _does_a_law_show(case: _Case) -> Answer | None:
    """No channel is beyond its floor, but the full twin with an explanation foretells of stretches that it was not fitted on what no noise would let it, whether
    the unit is that of the explanation or the one which needs no effect. What has a trace of its own needs no law to be there, and may be all that is foretold."""
    foretold = min(case.confirmed.total.foretold, case.confirmed.gained.foretold)
    chosen = case.outcome.chosen
    if case.removed is not None or chosen is None or set(chosen.support) & case.traced or foretold < FORETOLD:
        return None
    return case.outcome, case.weighed


def _is_it_only_traces(case: _Case) -> Answer | None:
    """No channel of means asks for an explanation: what noise, lines, events or codes have named, or nothing."""
    little = bool(case.traced) and _worst(case.confirmed) <= SHAKEN and case.removed is not None and case.removed < ENOUGH_REMOVED
    if case.removed is not None and not little:
        return None
    if case.noise is None or not case.traced:
        return Outcome("no_gap", [], None), hypotheses.below_the_floor(case.weighed)
    weighed = hypotheses.only(case.weighed, case.noise.within_reach)
    return replace(decide(case.found, weighed), chosen=None), weighed


def _is_the_unknown_a_trifle(case: _Case) -> Answer | None:
    """Something unknown is seen beside an explanation that leaves hardly anything on held-out data: on all of it a sharper look says so, and that may be the twin's own
    errors."""
    outcome, total = case.outcome, case.confirmed.total
    if outcome.verdict != "unknown" or outcome.chosen is None or not outcome.named or not outcome.chosen.possible:
        return None
    assert case.removed is not None
    if case.removed < _enough(case) or total.after > MUCH_LEFT or _untraced(case) >= MANY:
        return None
    known = outcome.named[0]
    return Outcome("ambiguous", [known, tuple(sorted({*known, OTHER}))], outcome.chosen), hypotheses.perhaps_without_other(case.weighed, 1.0 - IMITATED)


def _is_enough_removed(case: _Case) -> Answer | None:
    """Then the outcome stands, unless it stands alone while much is left of a large gap, or so many effects are asked for that others would do."""
    if case.outcome.verdict == "unknown":
        return case.outcome, case.weighed
    assert case.removed is not None
    alone = case.outcome.verdict == "attributed" and case.outcome.chosen is not None
    doubtful = alone and (case.confirmed.total.after > MUCH_LEFT or _untraced(case) >= MANY)
    return (case.outcome, case.weighed) if case.removed >= _enough(case) and not doubtful else None


def _is_it_nearly_all(case: _Case) -> Answer | None:
    """May what an explanation leaves be its own, because its law is not quite the one that is stated, or, of a single effect, because the gap is too small to say
    what is left?"""
    outcome, total = case.outcome, case.confirmed.total
    if outcome.verdict != "attributed" or outcome.chosen is None:
        return None
    assert case.removed is not None and total.interval is not None
    nothing_left = total.after <= NOISE_LEFT and total.interval[1] >= ENOUGH_REMOVED
    least = NEARLY_OF_TRACED if set(outcome.chosen.support) <= case.traced else NEARLY_REMOVED if _single(case) else NEARLY_OF_SEVERAL
    if case.removed < least and not (_single(case) and nothing_left):
        return None
    both = [outcome.named[0], tuple(sorted({*outcome.named[0], OTHER}))]
    return replace(outcome, verdict="ambiguous", named=both), hypotheses.perhaps_with_other(case.weighed, IMITATED)


def _it_is_unknown(case: _Case) -> Answer:
    return Outcome("unknown", case.outcome.named[:1], case.outcome.chosen), hypotheses.with_other(case.weighed)


QUESTIONS: tuple[Callable[[_Case], Answer | None], ...] = (
    _is_there_none, _does_a_law_show, _is_it_only_traces, _is_the_unknown_a_trifle, _is_enough_removed, _is_it_nearly_all, _it_is_unknown)


def _worst(confirmed: Confirmed) -> float:
    """In floors, of the channel with the largest gap."""
    return max((c.in_floors for c in confirmed.changes if c.fraction is not None), default=0.0)


def _untraced(case: _Case) -> int:
    return len(set(case.outcome.chosen.support) - case.traced) if case.outcome.chosen is not None else 0


def _single(case: _Case) -> bool:
    """Does one effect alone explain the means? Beside one that has a trace of its own no other one is easier to imitate."""
    return _untraced(case) <= 1


def _enough(case: _Case) -> float:
    """Of the held-out gap, that an explanation has to remove: noise alone removes none."""
    if case.outcome.chosen is None:
        return np.inf
    if case.outcome.verdict == "ambiguous":
        return LEAST_REMOVED
    return ENOUGH_REMOVED if _single(case) else ENOUGH_OF_SEVERAL


# --- imitation, and what is unknown ------------------------------------------------------------------------------------------


def held_to_imitation(found: TwinAnalysis, outcome: Outcome, weighed: Hypotheses, noise: NoiseEvidence | None) -> Answer:
    """What nobody could tell from a plain law that something unknown obeys is not named alone. What noise, lines, events or codes show stands without that."""
    if outcome.chosen is None or not outcome.named or set(outcome.chosen.support) <= traced(noise):
        return outcome, weighed
    imitated = plain.imitated(found, outcome.chosen) - traced(noise)
    if not imitated:
        return outcome, weighed
    weighed = hypotheses.shared_with_other(weighed, imitated, IMITATED)
    if outcome.verdict != "attributed":
        return outcome, weighed
    beside = tuple(sorted({*(set(outcome.named[0]) - imitated), OTHER}))
    return replace(outcome, verdict="ambiguous", named=[outcome.named[0], beside]), weighed


def beside_unknown(outcome: Outcome, weighed: Hypotheses, removed: float | None, noise: NoiseEvidence | None) -> Answer:
    """What something unknown is beside may be its doing: an effect is believed as the square of what it removes, each of several as the square for every pair of
    them, and named if that is most likely. What noise, lines, events or codes have named stands without that, but for a bias that wanders."""
    if outcome.verdict != "unknown" or removed is None:
        return outcome, weighed
    surely = traced(noise) - {FLICKER}
    several = max(1, len(set(outcome.named[0]) - surely - {OTHER})) if outcome.named else 1
    weighed = hypotheses.doubted(weighed, surely, min(1.0, max(0.0, removed)) ** (2 * several**2))
    named = tuple(e for e in (outcome.named[0] if outcome.named else ()) if weighed.marginal(e) > NAMED_BESIDE)
    chosen = outcome.chosen if outcome.chosen is not None and set(named) & set(outcome.chosen.support) else None
    return Outcome("unknown", [named] if named else [], chosen), weighed


def wanders_or_unknown(found: TwinAnalysis, outcome: Outcome, weighed: Hypotheses, confirmed: Confirmed, noise: NoiseEvidence | None) -> Answer:
    """Where no law of the catalogue was worth following and the gap is where a bias shows, the bias may only wander, too slowly for quiet windows."""
    gaps = [change.channel for change in confirmed.changes if change.fraction is not None]
    able = noise is not None and not noise.named and noise.log_evidence.get(frozenset({FLICKER}), -np.inf) > -SURE
    if outcome.verdict != "unknown" or found.closed or not able or not gaps or not all(name.startswith(FED) for name in gaps):
        return outcome, weighed
    return Outcome("ambiguous", WANDERS_OR_UNKNOWN, None), hypotheses.shared_with(weighed, FLICKER, WANDERS)
