"""Twin-level analysis -> diagnosis: which verdict, what is named, and in which words."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from wineglass import __version__, effects
from wineglass.diagnosis import confirmation, hypotheses, menu, plain, reliability
from wineglass.diagnosis.channels import unit_of
from wineglass.diagnosis.closure import Closed
from wineglass.diagnosis.confirmation import Change, Confirmed
from wineglass.diagnosis.contract import (ChannelShrink, Diagnosis, EffectFound, Hypothesis, NextExperiment, Parameter, Provenance, Region, Shrink,
                                          TotalShrink, Where)
from wineglass.diagnosis.hypotheses import SETTLED, Hypotheses, Ids
from wineglass.diagnosis.noise_level import NoiseEvidence
from wineglass.diagnosis.responses import POLAR, STEP_S
from wineglass.diagnosis.twin_level import ENGINE, TwinAnalysis
from wineglass.diagnosis.unknowns import AXIS, POLAR_ROLES, folded_deg, freed
from wineglass.diagnosis.vocabulary import EFFECTS, NONE, OTHER, component_of, stage_of

COMPUTED_BY = "full twin with the effects added, firmware in the loop"
UNKNOWN_ABOVE = 0.5
NAMED_BESIDE = 0.7  # of an effect beside something unknown, which may be all of it
IMITATED = 0.4  # of an explanation that as few plain laws would imitate as it has numbers: that it is something unknown
NEARLY_REMOVED, NEARLY_OF_SEVERAL = 0.93, 0.95  # by a single effect, and by several: what is left may be their own laws'
NEARLY_OF_TRACED = 0.75  # by an effect that is there anyway: noise, lines, events or codes show it
MUCH_LEFT = 3.0  # floors: of a large gap nearly all may be removed, and what is left is another effect or the law's own, one as likely as the other
MANY = 3  # effects that only means show: so many numbers fit others' doings, too
NOISE_LEFT = 1.3  # floors: a small gap of which no more is left says little about how much of it was removed
SURELY = 0.99  # that an effect's numbers are not nothing
LEAST_REMOVED = 0.2  # of the held-out gap: less is nothing
ENOUGH_REMOVED, ENOUGH_OF_SEVERAL = 0.965, 0.98  # an explanation that leaves more does not stand alone; several effects imitate another one more easily
PLAIN = 2.0  # floors: a gap of that size is there, whatever no explanation is worth
SHAKEN = 5.0  # floors, in any channel: what a line, noise or events that are named may leave in means, and nothing else need explain
PLACES = {"primary_in_phase": ("primary", "level"), "primary_quadrature": ("primary", "quadrature"), "drive_frequency": ("primary", "frequency"),
          "drive_level": ("primary", "level"), "secondary_in_phase": ("coupling", "in_phase"), "secondary_quadrature": ("coupling", "quadrature"),
          "rebalance_in_phase": ("coupling", "in_phase"), "rebalance_quadrature": ("coupling", "quadrature"), "rate": ("coupling", "in_phase"),
          "rate_uncompensated": ("coupling", "in_phase"), "quadrature": ("coupling", "quadrature"), "temperature_measured": ("temperature", "temperature")}
"""Where a gap that nothing explains is booked: the stage that the channel reads"""
Z95 = 1.96
LARGEST = 1e9  # of a ratio: where there is no noise at all


@dataclass(frozen=True)
class Source:
    """What the recording is: for the provenance."""

    recording: str
    sha256: str
    firmware: str | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """verdict; named: the explanations; chosen: the closed one that is confirmed on the full twin"""

    verdict: str
    named: list[Ids]
    chosen: Closed | None


def decide(found: TwinAnalysis, weighed: Hypotheses) -> Outcome:
    if weighed.none > 0.5:
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


def _held_to_the_gap(found: TwinAnalysis, outcome: Outcome, weighed: Hypotheses, confirmed: Confirmed, noise: NoiseEvidence | None) -> tuple[Outcome, Hypotheses]:
    """What no channel shows on held-out data is no gap; what an explanation does not remove there, it does not explain. What noise, lines, events or codes
    have named stands without that."""
    removed, before = confirmed.total.fraction, confirmed.total.before
    if outcome.chosen is not None and confirmed.gained.before <= PLAIN and (confirmed.gained.fraction or 0.0) < LEAST_REMOVED:
        removed = None  # another unit does as well, without any effect
    if outcome.verdict == "no_gap":
        if removed is not None and before > PLAIN:
            return Outcome("unknown", [], None), hypotheses.not_none(weighed)
        return outcome, hypotheses.below_the_floor(weighed) if removed is None else weighed
    named = noise is not None and bool(noise.named)
    if removed is None or (named and _worst(confirmed) <= SHAKEN and removed < ENOUGH_REMOVED):
        return _by_traces_alone(found, weighed, noise)
    traced = frozenset(noise.named if noise is not None else ())
    if _all_but_a_trifle(outcome, confirmed, traced):
        known = outcome.named[0]
        return Outcome("ambiguous", [known, tuple(sorted({*known, OTHER}))], outcome.chosen), hypotheses.perhaps_without_other(weighed, 1.0 - IMITATED)
    if outcome.verdict == "unknown" or (removed >= _enough(outcome, traced) and not _doubtful(outcome, confirmed, traced)):
        return outcome, weighed
    if _nearly(outcome, confirmed, traced):
        both = [outcome.named[0], tuple(sorted({*outcome.named[0], OTHER}))]
        return replace(outcome, verdict="ambiguous", named=both), hypotheses.perhaps_with_other(weighed, IMITATED)
    return Outcome("unknown", outcome.named[:1], outcome.chosen), hypotheses.with_other(weighed)


def _held_to_imitation(found: TwinAnalysis, outcome: Outcome, weighed: Hypotheses, noise: NoiseEvidence | None) -> tuple[Outcome, Hypotheses]:
    """What nobody could tell from a plain law that something unknown obeys is not named alone. What noise, lines, events or codes show stands without that."""
    traced = frozenset(noise.named if noise is not None else ())
    if outcome.chosen is None or not outcome.named or set(outcome.chosen.support) <= traced:
        return outcome, weighed
    imitated = plain.imitated(found, outcome.chosen) - traced
    if not imitated:
        return outcome, weighed
    weighed = hypotheses.shared_with_other(weighed, imitated, IMITATED)
    if outcome.verdict != "attributed":
        return outcome, weighed
    beside = tuple(sorted({*(set(outcome.named[0]) - imitated), OTHER}))
    return replace(outcome, verdict="ambiguous", named=[outcome.named[0], beside]), weighed


def _worst(confirmed: Confirmed) -> float:
    """In floors, of the channel with the largest gap."""
    return max((c.before / max(c.floor, 1e-300) for c in confirmed.changes if c.fraction is not None), default=0.0)


def _all_but_a_trifle(outcome: Outcome, confirmed: Confirmed, traced: frozenset[str]) -> bool:
    """Something unknown is seen beside an explanation that leaves hardly anything on held-out data: on all of it a sharper look says so, and that may be the twin's own
    errors."""
    if outcome.verdict != "unknown" or outcome.chosen is None or not outcome.named or not outcome.chosen.possible:
        return False
    assert confirmed.total.fraction is not None
    return confirmed.total.fraction >= _enough(outcome, traced) and confirmed.total.after <= MUCH_LEFT and _untraced(outcome.chosen, traced) < MANY


def _nearly(outcome: Outcome, confirmed: Confirmed, traced: frozenset[str]) -> bool:
    """May what an explanation leaves be its own, because its law is not quite the one that is stated, or, of a single effect, because the gap is too small to say
    what is left?"""
    assert confirmed.total.fraction is not None and confirmed.total.interval is not None
    if outcome.verdict != "attributed" or outcome.chosen is None:
        return False
    nothing_left = confirmed.total.after <= NOISE_LEFT and confirmed.total.interval[1] >= ENOUGH_REMOVED
    single = _single(outcome.chosen, traced)
    least = NEARLY_OF_TRACED if set(outcome.chosen.support) <= traced else NEARLY_REMOVED if single else NEARLY_OF_SEVERAL
    return confirmed.total.fraction >= least or (single and nothing_left)


def _doubtful(outcome: Outcome, confirmed: Confirmed, traced: frozenset[str]) -> bool:
    """Is much left of a large gap, or are so many effects asked for that others would do?"""
    if outcome.verdict != "attributed" or outcome.chosen is None:
        return False
    return confirmed.total.after > MUCH_LEFT or _untraced(outcome.chosen, traced) >= MANY


def _untraced(closed: Closed, traced: frozenset[str]) -> int:
    return len(set(closed.support) - traced)


def _single(closed: Closed, traced: frozenset[str]) -> bool:
    """Does one effect alone explain the means? Beside one that has a trace of its own no other one is easier to imitate."""
    return _untraced(closed, traced) <= 1


def _enough(outcome: Outcome, traced: frozenset[str]) -> float:
    """Of the held-out gap, that an explanation has to remove: noise alone removes none."""
    if outcome.chosen is None:
        return np.inf
    if outcome.verdict == "ambiguous":
        return LEAST_REMOVED
    return ENOUGH_REMOVED if _single(outcome.chosen, traced) else ENOUGH_OF_SEVERAL


def _by_traces_alone(found: TwinAnalysis, weighed: Hypotheses, noise: NoiseEvidence | None) -> tuple[Outcome, Hypotheses]:
    """No channel of means asks for an explanation: what noise, lines, events or codes have named, or nothing."""
    if noise is None or not noise.named:
        return Outcome("no_gap", [], None), hypotheses.below_the_floor(weighed)
    weighed = hypotheses.only(weighed, noise.within_reach)
    return replace(decide(found, weighed), chosen=None), weighed


def _beside_unknown(outcome: Outcome, weighed: Hypotheses, removed: float | None, noise: NoiseEvidence | None) -> tuple[Outcome, Hypotheses]:
    """What something unknown is beside may be its doing: an effect is believed as the square of what it removes, each of several as the square for every pair of
    them, and named if that is most likely. What noise, lines, events or codes have named stands without that, but for a bias that wanders."""
    if outcome.verdict != "unknown" or removed is None:
        return outcome, weighed
    traced = frozenset(noise.named if noise is not None else ()) - {"flicker_noise"}
    several = max(1, len(set(outcome.named[0]) - traced - {OTHER})) if outcome.named else 1
    weighed = hypotheses.doubted(weighed, traced, min(1.0, max(0.0, removed)) ** (2 * several**2))
    named = tuple(e for e in (outcome.named[0] if outcome.named else ()) if weighed.marginal(e) > NAMED_BESIDE)
    chosen = outcome.chosen if outcome.chosen is not None and set(named) & set(outcome.chosen.support) else None
    return Outcome("unknown", [named] if named else [], chosen), weighed


@dataclass(frozen=True)
class Verdict:
    """The diagnosis, and what the report draws beside it."""

    diagnosis: Diagnosis
    outcome: Outcome
    confirmed: Confirmed


def diagnose(found: TwinAnalysis, weighed: Hypotheses, noise: NoiseEvidence | None, source: Source) -> Verdict:
    outcome = decide(found, weighed)
    confirmed = confirmation.confirm(found, outcome.chosen)
    idle = _idle(outcome.chosen, confirmed) - frozenset(noise.named if noise is not None else ())
    if outcome.chosen is not None and idle:
        weighed = hypotheses.less(weighed, frozenset(outcome.chosen.support), idle)
        outcome = decide(found, weighed)
        confirmed = confirmation.confirm(found, outcome.chosen)
    outcome, weighed = _held_to_the_gap(found, outcome, weighed, confirmed, noise)
    outcome, weighed = _held_to_imitation(found, outcome, weighed, noise)
    believed, weighed = _beside_unknown(outcome, weighed, confirmed.total.fraction, noise)
    if outcome.chosen is not None and believed.chosen is None:
        confirmed = confirmation.confirm(found, None)
    outcome = believed
    weighed = reliability.tempered(weighed, outcome.verdict, outcome.named, [closed.support for closed in found.closed])
    listed = _hypotheses(weighed)
    named = _effects(found, outcome, confirmed, listed, noise)
    diagnosis = Diagnosis(
        verdict=outcome.verdict, sentence=sentence(outcome, confirmed), where=_where(found, outcome, confirmed, named, noise), hypotheses=listed,
        effects=named, alternatives=[list(ids) for ids in outcome.named] if outcome.verdict == "ambiguous" else [],
        shrink=_shrink(found, outcome, confirmed), next_experiment=_next(found, outcome), notes=[*source.notes, *found.driven.notes, *(noise.notes if noise is not None else [])],
        provenance=Provenance(program=f"wineglass {__version__}", engine=ENGINE, recording=source.recording, sha256=source.sha256,
                              device=found.driven.run.device.name, firmware=source.firmware))
    return Verdict(diagnosis, outcome, confirmed)


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
        if float(values @ precision @ values) < chi2.ppf(SURELY, len(values)):
            found.add(effect)
    return frozenset(found)


def sentence(outcome: Outcome, confirmed: Confirmed) -> str:
    total = confirmed.total
    if outcome.verdict == "no_gap":
        return "No gap: within its tolerances the nominal twin leaves no more than noise in every channel."
    worst = max(confirmed.changes, key=lambda c: c.before / max(c.floor, 1e-300))
    size = f"There is a gap, largest in {worst.channel}: {worst.before:.3g} {unit_of(worst.channel)} on held-out data, {worst.before / max(worst.floor, 1e-300):.3g} times the floor"
    if total.fraction is None and outcome.named:
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
    shares = {e: s for ids in reversed(outcome.named) for e, s in _shares(found, found.closed_for(ids), confirmed).items()}
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


def _shares(found: TwinAnalysis, closed: Closed | None, confirmed: Confirmed) -> dict[str, float]:
    """Share of the gap's energy that each effect of an explanation carries: what the confirmed one removes, divided as their responses are."""
    if closed is None or confirmed.total.fraction is None:
        return {}
    whole = 1.0 - (1.0 - min(1.0, max(0.0, confirmed.total.fraction))) ** 2
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


# --- where -----------------------------------------------------------------------------------------------------------------


def _where(found: TwinAnalysis, outcome: Outcome, confirmed: Confirmed, named: list[EffectFound], noise: NoiseEvidence | None) -> list[Where]:
    if outcome.verdict in ("no_gap", "insufficient"):
        return []
    places: dict[tuple[str, str], float] = {}
    slow = {e for closed in found.closed for e in closed.support}
    for effect in (e for e in named if e.id in slow):
        key = (effect.stage, component_of(effect.id))
        places[key] = places.get(key, 0.0) + effect.share
    rest = max(0.0, 1.0 - sum(places.values()))
    entries = [_named_place(found, confirmed, named, place, share) for place, share in places.items()]
    entries += _traces(found, named, slow, noise, rest)
    if outcome.verdict == "unknown":
        entries += _unexplained(found, confirmed, rest if len(entries) == len(places) else 0.0)
    total = max(1.0, sum(w.share for w in entries))
    return sorted((w.model_copy(update={"share": w.share / total}) for w in entries), key=lambda w: -w.share)


def _traces(found: TwinAnalysis, named: list[EffectFound], slow: set[str], noise: NoiseEvidence | None, rest: float) -> list[Where]:
    """Of the effects that only noise, lines, events or codes show: they share what slow channels do not."""
    mine = [e for e in named if e.id not in slow]
    time_s = found.grid.time_s
    whole = Region(variable="time", start=float(time_s[0]), stop=float(time_s[-1]), unit="s")
    entries = []
    for effect in mine:
        seen = next((w for w in (noise.where if noise is not None else []) if w[0] == effect.stage), None)
        channel, component, ratio = (seen[1], seen[2], min(abs(float(seen[3])), LARGEST)) if seen else (found.names[0], component_of(effect.id), 1.0)
        entries.append(Where(stage=effect.stage, channel=channel, component=component, share=rest / len(mine), region=whole, size=ratio,
                             unit="floor", ratio_over_floor=ratio))
    return entries


def _named_place(found: TwinAnalysis, confirmed: Confirmed, named: list[EffectFound], place: tuple[str, str], share: float) -> Where:
    """In the channel that shows most of these effects on held-out data; where several effects move it, their part of it."""
    mine = {e.id for e in named if (e.stage, component_of(e.id)) == place}
    closed = next((c for c in found.closed if set(c.support) & mine), None)
    parts = confirmation.contributions(found, closed) if closed is not None else {}
    own = sum((parts[e] for e in mine if e in parts), np.zeros((len(found.names), found.grid.count)))
    energy, whole = np.sum(own**2, axis=1), sum((np.sum(part**2, axis=1) for part in parts.values()), np.zeros(len(found.names)))
    channel = int(np.argmax(_excess(confirmed, [c.before for c in confirmed.changes]) * energy / np.maximum(whole, 1e-300)))
    return _place(found, *place, confirmed.changes[channel], share, own[channel])


def _excess(confirmed: Confirmed, sizes: list[float]) -> np.ndarray:
    """(channels,): energy on held-out data above the floor, in floors; of channels without a gap none. sizes: rms, before or after"""
    beyond = [max(0.0, (size / max(c.floor, 1e-300)) ** 2 - 1.0) if c.fraction is not None else 0.0 for c, size in zip(confirmed.changes, sizes, strict=True)]
    return np.array(beyond) * np.count_nonzero(confirmed.use, axis=1)


def _unexplained(found: TwinAnalysis, confirmed: Confirmed, rest: float) -> list[Where]:
    """What is left on held-out data, channel by channel, in the stage that the channel reads."""
    excess = _excess(confirmed, [c.after for c in confirmed.changes])
    total = float(excess.sum())
    order = [int(i) for i in np.argsort(-excess) if excess[i] > 0.05 * total]
    left = np.where(confirmed.use, confirmed.after, 0.0)
    return [_place(found, *PLACES[found.names[i]], confirmed.changes[i], rest * float(excess[i]) / total, left[i]) for i in order]


def _place(found: TwinAnalysis, stage: str, component: str, change: Change, share: float, series: np.ndarray) -> Where:
    return Where(stage=stage, channel=change.channel, component=component, share=min(1.0, share), region=_region(found, series),
                 size=change.before, unit=unit_of(change.channel), ratio_over_floor=change.before / max(change.floor, 1e-300))


def _region(found: TwinAnalysis, series: np.ndarray) -> Region:
    """The stretch of time that holds nine tenths of the energy."""
    time_s = found.grid.time_s
    energy = np.cumsum(series**2)
    if energy[-1] <= 0.0:
        return Region(variable="time", start=float(time_s[0]), stop=float(time_s[-1]), unit="s")
    low, high = np.searchsorted(energy, 0.05 * energy[-1]), np.searchsorted(energy, 0.95 * energy[-1])
    return Region(variable="time", start=float(time_s[low]), stop=float(time_s[min(high, len(time_s) - 1)]), unit="s")


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
    if len(pair) < 2:
        return NextExperiment(run="the protocol full", separates=names, predicted_separation=None, why="it excites every stage")
    proposal = menu.propose(found, pair[0], pair[1])
    return NextExperiment(run=proposal.run, separates=names, predicted_separation=proposal.separation, why=proposal.why)
