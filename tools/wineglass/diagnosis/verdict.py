"""Analysis -> diagnosis: which verdict, what is named, and in which words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wineglass import __version__
from wineglass.diagnosis import bayes, digits, experiments, gap, output_noise, parameters, thermometer
from wineglass.diagnosis.blocks import STEADY_DEGC, make_blocks
from wineglass.diagnosis.contract import (ChannelShrink, Diagnosis, EffectFound, Hypothesis, NextExperiment, Provenance, Region, Shrink,
                                          TotalShrink, Where)
from wineglass.diagnosis.evidence import Evidence, missing_samples
from wineglass.diagnosis.probabilities import LEAST_NAMED, SETTLED, earns_its_place
from wineglass.diagnosis.rate_level import ENGINE, Analysis
from wineglass.diagnosis.split import IN_TURN
from wineglass.diagnosis.vocabulary import EFFECTS, NONE, OTHER, component_of, stage_of

UNIT = "rad/s"
ATTRIBUTED_LEFT = 0.15  # a single explanation must do better, where what it leaves is no noise
LEAST_SPAN_DEGC = 5.0
UNKNOWN_ABOVE = 0.8
STILL_PROBABLE = 0.2
LISTED_ABOVE = 0.15  # that it is something else is then one of the explanations
UNKNOWN_LEFT = 0.4  # of the gap: when more than that stays and is no noise, the verdict is unknown
LEAST_REMOVED = 0.1  # of the held-out gap
HISTORY = {"thermometer_lag", "thermal_gradient", "thermal_hysteresis", "ageing"}
"""Effects of the path that the temperature took"""
COMPUTED_BY = "rate-level model with the effects added, not the full twin"


@dataclass(frozen=True)
class Outcome:
    """verdict, and the explanations that it names"""

    verdict: str
    named: list[tuple[str, ...]]
    reason: str = ""


def decide(found: Analysis) -> Outcome:
    if not found.gap:
        missing = _cannot_say(found)
        return Outcome("insufficient", [], missing) if missing else Outcome("no_gap", [])
    probability = found.posterior.probability
    named = found.alternatives
    if probability[(OTHER,)] > UNKNOWN_ABOVE:
        return Outcome("unknown", [])
    doubtful = found.posterior.remainder > 0.5
    if not named or _unsupported(found, named):
        return _unsettled(found)
    if doubtful and found.share_left > UNKNOWN_LEFT:
        return Outcome("unknown", named[:1])
    if _poor(found):
        listed = [*named, *_not_excluded(found, named)]
        return Outcome("ambiguous", listed if len(listed) > 1 else [*listed, (OTHER,)])
    if len(named) > 1 or probability[(OTHER,)] > LISTED_ABOVE:
        return Outcome("ambiguous", [*named, (OTHER,)] if probability[(OTHER,)] > LISTED_ABOVE else named)
    if doubtful and found.share_left > ATTRIBUTED_LEFT:
        return Outcome("unknown", named[:1])
    if not _earned(found, named[0]) or found.cancelling(named[0]) or (_one_cycle(found) and HISTORY & set(named[0])):
        return Outcome("ambiguous", [named[0], (OTHER,)])
    holding = sum(p for ids, p in probability.items() if set(named[0]) <= set(ids))
    if holding >= SETTLED:
        return Outcome("attributed", named)
    rivals = [ids for ids in probability if ids not in ((NONE,), named[0]) and not set(named[0]) <= set(ids)]
    rival = max(rivals, key=lambda ids: probability[ids], default=(OTHER,))
    return Outcome("ambiguous", [named[0], rival])


def _unsettled(found: Analysis) -> Outcome:
    """Held-out data support no explanation: what stays probable all the same is listed beside something else."""
    probable = [ids for ids in found.posterior.explanations if found.posterior.probability[ids] >= STILL_PROBABLE]
    if not probable or found.posterior.other > max(found.posterior.probability[ids] for ids in probable) + STILL_PROBABLE:
        return Outcome("unknown", [])
    return Outcome("ambiguous", [*probable, (OTHER,)])


def _earned(found: Analysis, ids: tuple[str, ...]) -> bool:
    return earns_its_place(ids, found.held, found.floor.threshold)


def _unsupported(found: Analysis, named: list[tuple[str, ...]]) -> bool:
    """Held-out data speak against it; or they are silent, and in sample it is not beyond doubt either."""
    if not any(_earned(found, ids) for ids in named):
        return found.posterior.remainder > 0.5 or found.share_left > ATTRIBUTED_LEFT or found.posterior.other > 0.05
    return found.fraction.value is not None and found.fraction.value < LEAST_REMOVED and _earned(found, named[0])


def _not_excluded(found: Analysis, named: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """What a single branch cannot rule out beside the named ones: whatever is at all probable, and every single effect."""
    probable = [ids for ids in found.posterior.explanations if found.posterior.probability[ids] >= LEAST_NAMED]
    singles = [(name,) for name in found.design.effects]
    return [ids for ids in dict.fromkeys([*probable, *singles]) if ids not in named]


def _one_cycle(found: Analysis) -> bool:
    """In a single cycle lag, drift and hysteresis, and what is in no catalogue, can take each other's shape."""
    steady = float(np.ptp(found.blocks.temperature_degc)) < STEADY_DEGC
    return not found.design.calibrated and not steady and len(found.blocks.branches) < IN_TURN


def _poor(found: Analysis) -> bool:
    """One thermal branch and no calibration: a static curve, lag, drift and hysteresis are all smooth functions of the same time."""
    return not found.design.calibrated and len(found.blocks.branches) < 2 and float(np.ptp(found.blocks.temperature_degc)) >= LEAST_SPAN_DEGC


def _cannot_say(found: Analysis) -> str:
    """Why the absence of a gap means nothing here."""
    if found.design.calibrated or found.blocks.evidence.true_rate_rad_s is not None:
        return ""
    span = float(np.ptp(found.blocks.temperature_degc))
    if span >= LEAST_SPAN_DEGC and len(found.blocks.branches) < 2:
        return "the temperature moves in one direction only, so that the fitted static curve absorbs lag, drift and hysteresis"
    return ""


def diagnose(evidence: Evidence, found: Analysis | None) -> Diagnosis:
    if found is None:
        return _too_short(evidence)
    outcome = decide(found)
    extra = _dropped(evidence)
    named = sorted({e for ids in outcome.named for e in ids if e in EFFECTS})
    hypotheses = _hypotheses(found, outcome)
    effects = _effects(found, named, outcome, hypotheses)
    seen = make_blocks(evidence.thermometer) if evidence.thermometer is not None else found.blocks
    diagnosis = thermometer.join(Diagnosis(
        verdict=outcome.verdict,
        sentence=sentence(found, outcome),
        where=_where(found, outcome, effects),
        hypotheses=hypotheses,
        effects=effects,
        alternatives=[list(ids) for ids in outcome.named] if outcome.verdict == "ambiguous" else [],
        shrink=_shrink(found, outcome),
        next_experiment=_next(found, outcome),
        notes=[*evidence.notes, *extra, *_notes(found, outcome)],
        provenance=_provenance(evidence),
    ), thermometer.examine(seen or found.blocks))
    return diagnosis if evidence.noise is None else output_noise.join(diagnosis, evidence.noise)


def sentence(found: Analysis, outcome: Outcome) -> str:
    before, floor = gap.rms(found.before[found.split.held]), found.floor.rms
    size = f"{before:.3g} rad/s on held-out data, {before / floor:.3g} times the noise floor"
    if outcome.verdict == "insufficient":
        return f"This recording cannot show a gap: {outcome.reason}."
    if outcome.verdict == "no_gap":
        return f"No gap: the nominal twin leaves {before:.3g} rad/s on held-out data, no more than noise would ({found.floor.threshold:.3g})."
    if outcome.verdict == "unknown":
        if outcome.named:
            return f"There is a gap of {size}; {_in_words(outcome.named[0])} is a part of it at most, and nothing in the catalogue explains the rest."
        return f"There is a gap of {size}, and nothing in the catalogue explains it well enough."
    if outcome.verdict == "attributed":
        return f"There is a gap of {size}; {_in_words(outcome.named[0])} explains it."
    rivals = "; or ".join(_in_words(ids) for ids in outcome.named[:4])
    return f"There is a gap of {size}; this recording cannot tell apart: {rivals}."


def _in_words(ids: tuple[str, ...]) -> str:
    return " with ".join(ids) if ids != (OTHER,) else "something that is not in the catalogue"


def _hypotheses(found: Analysis, outcome: Outcome) -> list[Hypothesis]:
    probability = dict(found.posterior.probability)
    order = sorted(probability, key=lambda ids: -probability[ids])
    total = sum(probability.values())
    return [Hypothesis(ids=list(ids), probability=probability[ids] / total) for ids in order]


def _mixture(found: Analysis, ids: tuple[str, ...]) -> list[bayes.Fit]:
    return bayes.fits(found.design, found.scores, found.blocks.white_rad_s, ids, np.arange(len(found.blocks)), 0.02)


def _effects(found: Analysis, named: list[str], outcome: Outcome, hypotheses: list[Hypothesis]) -> list[EffectFound]:
    """Every named effect: parameters and share from the most probable named explanation that has it."""
    effects = []
    for name in named:
        holder = next(ids for ids in outcome.named if name in ids)
        confidence = sum(h.probability for h in hypotheses if name in h.ids)
        share, numbers = 0.0, []
        if holder in found.scores.supports:
            mixture = _mixture(found, holder)
            numbers = parameters.describe(found.design, mixture, name)
            share = confidence * _share(found, mixture, holder, name)
        effects.append(EffectFound(id=name, stage=stage_of(name), confidence=min(1.0, confidence), parameters=numbers, share=share))
    total = max(1.0, sum(e.share for e in effects))  # rivals explain the same gap: together no more than all of it
    scaled = [e.model_copy(update={"share": e.share / total}) for e in effects]
    return sorted(scaled, key=lambda e: -e.confidence)


def _share(found: Analysis, mixture: list[bayes.Fit], holder: tuple[str, ...], name: str) -> float:
    """Share of the explanation's energy, after the nominal curve took what it can, that this effect carries."""
    energies = {e: np.mean(_beyond_static(found, parameters.contribution(found.design, mixture, e)) ** 2) for e in holder}
    total = sum(energies.values())
    explained = 1.0 - min(1.0, (found.left.get(holder, 0.0) / max(found.left[()], 1e-300)) ** 2)
    return float(explained * energies[name] / total) if total > 0 else 0.0


def _beyond_static(found: Analysis, signal: np.ndarray) -> np.ndarray:
    nominal = found.design.matrix[:, list(found.design.statics[0])]
    return signal - nominal @ np.linalg.lstsq(nominal, signal, rcond=None)[0] if nominal.shape[1] else signal


def _where(found: Analysis, outcome: Outcome, effects: list[EffectFound]) -> list[Where]:
    if outcome.verdict in ("no_gap", "insufficient"):
        return []
    before = gap.rms(found.before[found.split.held])
    common = dict(channel="rate", region=_region(found), unit=UNIT, ratio_over_floor=before / found.floor.rms)
    if not effects:
        return [Where(stage="coupling", component="in_phase", share=1.0, size=before, **common)]
    shares: dict[tuple[str, str], float] = {}
    for effect in effects:
        key = (effect.stage, component_of(effect.id))
        shares[key] = shares.get(key, 0.0) + effect.share
    order = sorted(shares.items(), key=lambda item: -item[1])
    return [Where(stage=stage, component=component, share=min(1.0, share), size=before * float(np.sqrt(share)), **common) for (stage, component), share in order]


def _region(found: Analysis) -> Region:
    """The shortest stretch of time that holds nine tenths of the held-out gap."""
    where = np.flatnonzero(found.split.held)
    energy = np.cumsum(found.before[where] ** 2)
    low = np.searchsorted(energy, 0.05 * energy[-1])
    high = np.searchsorted(energy, 0.95 * energy[-1])
    time_s = found.blocks.time_s[where]
    return Region(variable="time", start=float(time_s[low]), stop=float(time_s[min(high, len(time_s) - 1)]), unit="s")


def _shrink(found: Analysis, outcome: Outcome) -> Shrink:
    held = found.split.held
    before, after = gap.rms(found.before[held]), gap.rms(found.after[held])
    there = outcome.verdict in ("attributed", "ambiguous", "unknown")
    fraction = found.fraction.value if there else None
    interval = found.fraction.interval if fraction is not None else None
    after = after if there else before
    floor = found.floor.rms
    channel = ChannelShrink(channel="rate", before=before, after=after, floor=floor, unit=UNIT, fraction=fraction, interval=interval)
    whitened = (before / floor, after / floor, 1.0) if fraction is not None else (None, None, None)
    total = TotalShrink(before=whitened[0], after=whitened[1], floor=whitened[2], fraction=fraction, interval=interval)
    what = f"{found.split.name} held out ({int(held.sum())} of {len(held)} block means of {found.blocks.samples_per_block:.3g} samples)"
    return Shrink(channels=[channel], all=total, held_out=what, computed_by=COMPUTED_BY)


def _next(found: Analysis, outcome: Outcome) -> NextExperiment | None:
    if outcome.verdict in ("no_gap", "attributed"):
        return None
    if outcome.verdict == "insufficient":
        return NextExperiment(run="record a whole thermal cycle: heating and cooling over the same temperatures", separates=[],
                              predicted_separation=None, why="only where a temperature is passed twice can history show")
    if outcome.verdict == "unknown":
        return NextExperiment(run="run the same thermal cycle twice in a row", separates=[], predicted_separation=None,
                              why="what repeats depends on temperature or its history, what does not depends on time or on something unrecorded")
    if found.design.described:
        return NextExperiment(run="the same recording with the baseband tap", separates=[list(ids) for ids in outcome.named], predicted_separation=None,
                              why="drive, quadrature and frequency tell apart what looks alike in the rate")
    pair = [ids for ids in outcome.named if ids in found.scores.supports][:2]
    names = [list(ids) for ids in outcome.named]
    rate = {"coriolis_gain", "rate_reference"} & {e for ids in outcome.named for e in ids}
    if rate:
        return NextExperiment(run="turn the gyro by a known angle, many full turns against a mark, then with its axis reversed", separates=names,
                              predicted_separation=None, why="a known angle checks the table without its own rate signal")
    if len(pair) < 2:
        return NextExperiment(run=experiments.MENU[0][0], separates=names, predicted_separation=None, why=experiments.MENU[0][1])
    best = experiments.propose(found.blocks, found.design, found.scores, pair)[0]
    return NextExperiment(run=best.run, separates=names, predicted_separation=best.separation, why=best.why)


def _notes(found: Analysis, outcome: Outcome) -> list[str]:
    evidence = found.blocks.evidence
    notes = [f"before, after and floor are rms of block means; they are computed by the {COMPUTED_BY}"]
    if not found.design.calibrated:
        notes.append("without calibration a static error (cross_damping up to the cubic, thermometer_error) is absorbed by the fitted curve and cannot be seen")
    if evidence.expected is None:
        notes += digits.notes(evidence.temperature_degc if evidence.measured_degc is None else evidence.measured_degc, evidence.rate_rad_s,
                              found.blocks.sample_noise_rad_s)
    if evidence.noise is None:
        notes.append("the device's noise is not described: excess_noise cannot be seen, flicker_noise only above the noise of one sample")
    if evidence.true_rate_rad_s is None:
        notes.append("no true rate: the gyro is taken to stand still; coriolis_gain and rate_reference cannot be seen")
    if found.posterior.remainder > 0.5 and outcome.verdict in ("attributed", "ambiguous"):
        rest = gap.rms(found.after[found.split.held]) / found.floor.rms
        notes.append(f"the named effects leave {rest:.3g} times the floor: something beyond them, or another functional form, is there as well")
    return notes


def _dropped(evidence: Evidence) -> list[str]:
    notes = []
    missing = missing_samples(evidence.time_s) if len(evidence.time_s) > 2 else 0
    if missing or evidence.lost:
        notes.append(f"{max(missing, evidence.lost)} samples are missing; the diagnosis uses the others")
    return notes


def _provenance(evidence: Evidence) -> Provenance:
    return Provenance(program=f"wineglass {__version__}", engine=ENGINE, recording=evidence.source, sha256=evidence.sha256,
                      device=evidence.device, firmware=evidence.firmware)


def _too_short(evidence: Evidence) -> Diagnosis:
    count = len(evidence.time_s)
    return Diagnosis(
        verdict="insufficient", sentence=f"This recording cannot show a gap: it has only {count} usable samples.", where=[],
        hypotheses=[Hypothesis(ids=[NONE], probability=0.5), Hypothesis(ids=[OTHER], probability=0.5)], effects=[], alternatives=[],
        shrink=Shrink(channels=[], all=TotalShrink(before=None, after=None, floor=None, fraction=None, interval=None), held_out="nothing",
                      computed_by=COMPUTED_BY),
        next_experiment=NextExperiment(run="record a whole thermal cycle: heating and cooling over the same temperatures", separates=[],
                                       predicted_separation=None, why="held-out branches need samples"),
        notes=list(evidence.notes), provenance=_provenance(evidence),
    )
