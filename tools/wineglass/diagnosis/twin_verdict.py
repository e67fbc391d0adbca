"""Twin-level analysis -> diagnosis: which verdict, what is named, and in which words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from wineglass import __version__, effects
from wineglass.diagnosis import confirmation, decisions, hypotheses, menu, places, reliability
from wineglass.diagnosis.channels import unit_of
from wineglass.diagnosis.closure import Closed
from wineglass.diagnosis.confirmation import Confirmed
from wineglass.diagnosis.contract import ChannelShrink, Diagnosis, EffectFound, Hypothesis, NextExperiment, Parameter, Provenance, Shrink, TotalShrink
from wineglass.diagnosis.decisions import Outcome
from wineglass.diagnosis.hypotheses import Hypotheses, Ids
from wineglass.diagnosis.noise_level import NoiseEvidence
from wineglass.diagnosis.responses import POLAR, STEP_S
from wineglass.diagnosis.twin_level import ENGINE, TwinAnalysis
from wineglass.diagnosis.unknowns import AXIS, POLAR_ROLES, folded_deg, freed
from wineglass.diagnosis.vocabulary import EFFECTS, OTHER, stage_of

COMPUTED_BY = "full twin with the effects added, firmware in the loop"
SURELY = 0.99  # that an effect's numbers are not nothing
FORETOLD = 0.5  # of the held-out gap: noise foretells none of itself
Z95 = 1.96


@dataclass(frozen=True)
class Source:
    """What the recording is: for the provenance."""

    recording: str
    sha256: str
    firmware: str | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """The diagnosis, and what the report draws beside it."""

    diagnosis: Diagnosis
    outcome: Outcome
    confirmed: Confirmed
    removed: float | None
    """by the explanation that was confirmed, of the held-out gap; whatever became of that explanation"""

    @property
    def foretold(self) -> bool:
        """Does an explanation foretell most of the gap?"""
        return self.removed is not None and self.removed >= FORETOLD


def diagnose(found: TwinAnalysis, weighed: Hypotheses, noise: NoiseEvidence | None, source: Source) -> Verdict:
    outcome = decisions.decide(found, weighed)
    confirmed = confirmation.confirm(found, outcome.chosen)
    idle = _idle(outcome.chosen, confirmed) - decisions.traced(noise)
    if outcome.chosen is not None and idle:
        weighed = hypotheses.less(weighed, frozenset(outcome.chosen.support), idle)
        outcome = decisions.decide(found, weighed)
        confirmed = confirmation.confirm(found, outcome.chosen)
    removed = confirmed.total.fraction
    outcome, weighed = decisions.held_to_the_gap(found, outcome, weighed, confirmed, noise)
    outcome, weighed = decisions.held_to_imitation(found, outcome, weighed, noise)
    believed, weighed = decisions.beside_unknown(outcome, weighed, removed, noise)
    if outcome.chosen is not None and believed.chosen is None:
        confirmed = confirmation.confirm(found, None)
    outcome, weighed = decisions.wanders_or_unknown(found, believed, weighed, confirmed, noise)
    weighed = reliability.tempered(weighed, outcome.verdict, outcome.named, [closed.support for closed in found.closed])
    listed = _hypotheses(weighed)
    named = _effects(found, outcome, confirmed, listed, noise)
    diagnosis = Diagnosis(
        verdict=outcome.verdict, sentence=sentence(outcome, confirmed), where=places.where(found, outcome, confirmed, named, noise), hypotheses=listed,
        effects=named, alternatives=[list(ids) for ids in outcome.named] if outcome.verdict == "ambiguous" else [],
        shrink=_shrink(found, outcome, confirmed), next_experiment=_next(found, outcome), notes=[*source.notes, *found.driven.notes, *(noise.notes if noise is not None else [])],
        provenance=Provenance(program=f"wineglass {__version__}", engine=ENGINE, recording=source.recording, sha256=source.sha256,
                              device=found.driven.run.device.name, firmware=source.firmware))
    return Verdict(diagnosis, outcome, confirmed, removed)


def _idle(closed: Closed | None, confirmed: Confirmed) -> frozenset[str]:
    """Effects of the confirmed explanation whose numbers, all together, are nothing as far as the full twin's run can say. Their shapes stay as they are: of an
    effect that is nothing there is no shape to go along with."""
    if closed is None:
        return frozenset()
    found = set()
    for effect in closed.support:
        mine = [i for i, u in enumerate(closed.unknowns) if u.effect == effect]
        strengths = np.array([closed.unknowns[i].role != "shape" for i in mine])
        covariance = confirmed.covariance[np.ix_(mine, mine)]
        size = np.sqrt(np.maximum(np.diagonal(covariance), 1e-300))
        precision = np.linalg.pinv(covariance / np.outer(size, size), hermitian=True)[np.ix_(strengths, strengths)]
        values = (confirmed.values[mine] / size)[strengths]
        if float(values @ precision @ values) < chdtri(len(values), 1.0 - SURELY):
            found.add(effect)
    return frozenset(found)


def sentence(outcome: Outcome, confirmed: Confirmed) -> str:
    total = confirmed.total
    if outcome.verdict == "no_gap":
        return "No gap: within its tolerances the nominal twin leaves no more than noise in every channel."
    worst = max(confirmed.changes, key=lambda c: c.in_floors)
    size = f"There is a gap, largest in {worst.channel}: {worst.before:.3g} {unit_of(worst.channel)} on held-out data, {worst.in_floors:.3g} times the floor"
    if total.fraction is None and outcome.chosen is not None:
        most = max(confirmed.changes, key=lambda c: c.foretold)
        size = f"No channel is beyond its floor, but {most.channel} is foretold on held-out data at {np.sqrt(max(0.0, most.foretold)):.3g} standard deviations"
    elif total.fraction is None and outcome.named:
        size = "Means stay within their floors, but noise, lines, events or codes do not look like the twin's"
    shrunk = "" if total.fraction is None else f" ({max(0.0, total.fraction):.1%} of the gap above the floor goes)"
    if outcome.verdict == "attributed":
        return f"{size}; {_in_words(outcome.named[0])} explains it{shrunk}."
    if outcome.verdict == "ambiguous":
        return f"{size}; this recording cannot tell apart: {'; or '.join(_in_words(ids) for ids in outcome.named[:4])}."
    if outcome.named:
        return f"{size}; {_in_words(outcome.named[0])} is a part of it{shrunk}, and nothing in the catalogue explains the rest."
    return f"{size}, and nothing in the catalogue explains it well enough."


def _in_words(ids: Ids) -> str:
    return " with ".join("something that is not in the catalogue" if e == OTHER else e for e in ids)


def _hypotheses(weighed: Hypotheses) -> list[Hypothesis]:
    order = sorted(weighed.probability, key=lambda ids: -weighed.probability[ids])
    return [Hypothesis(ids=list(ids), probability=min(1.0, weighed.probability[ids])) for ids in order]  # a sum may be a rounding beyond


# --- effects ---------------------------------------------------------------------------------------------------------------


def _effects(found: TwinAnalysis, outcome: Outcome, confirmed: Confirmed, listed: list[Hypothesis], noise: NoiseEvidence | None
             ) -> list[EffectFound]:
    named = sorted({e for ids in outcome.named for e in ids if e in EFFECTS})
    shares = {e: s for ids in reversed(outcome.named) for e, s in _shares(found, outcome, found.closed_for(ids), confirmed).items()}
    total = max(1.0, sum(shares.get(e, 0.0) for e in named))
    result = []
    for name in named:
        holder = next((found.closed_for(ids) for ids in outcome.named if name in ids), None)
        values, covariance = _estimate(found, holder, outcome, confirmed)
        numbers = _parameters(holder, name, values, covariance) if holder is not None and name in holder.support else []
        if not numbers and noise is not None:
            numbers = [Parameter(name=n, value=v, interval=(min(low, v), max(high, v)), unit=unit) for n, v, (low, high), unit in noise.parameters(name)]
        confidence = min(1.0, sum(h.probability for h in listed if name in h.ids))
        result.append(EffectFound(id=name, stage=stage_of(name), confidence=confidence, parameters=numbers, share=shares.get(name, 0.0) / total))
    return sorted(result, key=lambda e: -e.confidence)


def _shares(found: TwinAnalysis, outcome: Outcome, closed: Closed | None, confirmed: Confirmed) -> dict[str, float]:
    """Share of the gap's energy that each effect of an explanation carries: what the confirmed one removes, divided as their responses are. Of what is foretold
    within the floors nothing is seen that is not removed."""
    if closed is None or (confirmed.total.fraction is None and outcome.chosen is None):
        return {}
    removed = 1.0 if confirmed.total.fraction is None else confirmed.total.fraction
    whole = 1.0 - (1.0 - min(1.0, max(0.0, removed))) ** 2
    energies = {effect: float(np.sum(np.sum(part**2, axis=1) / found.softening)) for effect, part in confirmation.contributions(found, closed).items()}
    total = sum(energies.values())
    return {effect: whole * energy / total for effect, energy in energies.items()} if total > 0.0 else {}


def _estimate(found: TwinAnalysis, closed: Closed | None, outcome: Outcome, confirmed: Confirmed) -> tuple[np.ndarray, np.ndarray]:
    """Values and covariance of an explanation's unknowns: from the full twin where it was run, else from the envelope."""
    if closed is None:
        return np.zeros(0), np.zeros((0, 0))
    if closed is outcome.chosen:
        return confirmed.values, confirmed.covariance
    gram = closed.products.pooled(found.softening)
    spread = np.array([u.spread for u in closed.unknowns])
    covariance = np.linalg.pinv(gram[:-1, :-1] + np.eye(len(gram) - 1), hermitian=True)[-len(spread):, -len(spread):]
    return closed.values, covariance * np.outer(spread, spread)


def _parameters(closed: Closed, effect: str, values: np.ndarray, covariance: np.ndarray) -> list[Parameter]:
    """Moments are known to half a step of the envelope twin that gave their slopes; what was held beside a curve is not known apart from it."""
    numbers = []
    mine = [i for i, u in enumerate(closed.unknowns) if u.effect == effect]
    units = {p.name: p.unit for p in effects.find(effect).parameters}
    for i in mine:
        unknown = closed.unknowns[i]
        deviation = freed(unknown).spread if unknown.held else float(np.sqrt(max(covariance[i, i], 0.0)))
        if unknown.role not in POLAR_ROLES:
            moment = 0.5 * STEP_S if unknown.role == "shape" and units[unknown.name] == "s" else 0.0
            value = folded_deg(float(values[i])) if unknown.name == AXIS else float(values[i])
            numbers.append(_number(unknown.name, value, float(np.hypot(deviation, moment)), units[unknown.name]))
    if any(closed.unknowns[i].role in POLAR_ROLES for i in mine):
        numbers = [*_polar_numbers(closed, effect, mine, values, covariance), *numbers]
    return numbers


def _number(name: str, value: float, deviation: float, unit: str) -> Parameter:
    return Parameter(name=name, value=value, interval=(value - Z95 * deviation, value + Z95 * deviation), unit=unit)


def _polar_numbers(closed: Closed, effect: str, mine: list[int], values: np.ndarray, covariance: np.ndarray) -> list[Parameter]:
    """Size and axis from their two components, errors to first order."""
    cosine, sine = (next(i for i in mine if closed.unknowns[i].role == role) for role in ("cosine", "sine"))
    c, s = float(values[cosine]), float(values[sine])
    size = max(float(np.hypot(c, s)), 1e-300)
    block = covariance[np.ix_([cosine, sine], [cosine, sine])]
    along, across = np.array([c, s]) / size, np.array([-s, c]) / size**2
    axis_deviation = float(np.degrees(0.5 * np.sqrt(max(across @ block @ across, 0.0))))
    return [_number(POLAR[effect][0], size, float(np.sqrt(max(along @ block @ along, 0.0))), _unit(effect, POLAR[effect][0])),
            _number("axis_deg", float(np.degrees(0.5 * np.arctan2(s, c))), min(axis_deviation, 90.0), "deg")]


def _unit(effect: str, name: str) -> str:
    return next(p.unit for p in effects.find(effect).parameters if p.name == name)


# --- shrink and what is next -------------------------------------------------------------------------------------------------


def _shrink(found: TwinAnalysis, outcome: Outcome, confirmed: Confirmed) -> Shrink:
    gap = outcome.verdict != "no_gap"
    channels = [ChannelShrink(channel=c.channel, before=c.before, after=c.after, floor=c.floor, unit=unit_of(c.channel),
                              fraction=c.fraction if gap else None, interval=c.interval if gap else None) for c in confirmed.changes]
    total = confirmed.total
    there = gap and total.fraction is not None
    whole = TotalShrink(before=total.before if there else None, after=total.after if there else None, floor=1.0 if there else None,
                        fraction=total.fraction if there else None, interval=total.interval if there else None)
    return Shrink(channels=channels, all=whole, held_out=confirmation.held_out_text(found), computed_by=COMPUTED_BY)


def _with_or_without_other(named: list[Ids]) -> bool:
    """Is the question whether an explanation is all?"""
    return len(named) == 2 and set(named[1]) == {*named[0], OTHER}


def _next(found: TwinAnalysis, outcome: Outcome) -> NextExperiment | None:
    if outcome.verdict in ("no_gap", "attributed"):
        return None
    if outcome.verdict == "unknown":
        return NextExperiment(run="the same protocol again, without a change", separates=[], predicted_separation=None,
                              why="what repeats follows temperature, rate or amplitude; what does not follows time or something unrecorded")
    able = {closed.support: closed for closed in (found.closed_for(ids) for ids in outcome.named) if closed is not None}
    pair = list(able.values())[:2]
    names = [list(ids) for ids in outcome.named]
    if _with_or_without_other(outcome.named):
        return NextExperiment(run="the same protocol again, without a change", separates=names, predicted_separation=None,
                              why="what is left and repeats belongs to the effect's law; what does not is something else")
    if outcome.named == decisions.WANDERS_OR_UNKNOWN:
        return NextExperiment(run="the same protocol again, without a change", separates=names, predicted_separation=None,
                              why="what repeats obeys a law that is not in the catalogue; a bias that wanders does not repeat")
    if len(pair) < 2:
        return NextExperiment(run="the protocol full", separates=names, predicted_separation=None, why="it excites every stage")
    proposal = menu.propose(found, pair[0], pair[1])
    return NextExperiment(run=proposal.run, separates=names, predicted_separation=proposal.separation, why=proposal.why)
