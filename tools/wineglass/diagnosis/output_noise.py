"""The rate's diagnosis with what the looks at noise, lines and readings say about an output without baseband (noise_level.py).

From the rate alone some causes are one: whatever raises its whole spectrum, and whatever draws a line into it. They are listed side by side. The rest is
joined as of an independent channel: sets of effects unite, probabilities multiply.
"""

from __future__ import annotations

from dataclasses import dataclass

from wineglass.diagnosis.contract import Diagnosis, EffectFound, Hypothesis, NextExperiment, Parameter, Region, Where
from wineglass.diagnosis.noise_level import NoiseEvidence
from wineglass.diagnosis.vocabulary import COMPONENTS, EFFECTS, NONE, OTHER, component_of, stage_of

LOOK_ALIKE = {
    "excess_noise": ("clock_jitter", "dropped_samples"),
    "clock_jitter": ("excess_noise", "dropped_samples"),
    "vibration": ("interference",),
    "interference": ("vibration",),
}
FAVOURED = 2.0  # the one that the looks prefer, over each that looks alike
DOUBT, UNFITTING_DOUBT = 0.05, 0.3  # that it is something else; where the looks themselves say that no pattern fits
LISTED = 12
Ids = tuple[str, ...]


@dataclass(frozen=True)
class Seen:
    """probability: sets of effects, or other -> probability, summing to one"""

    probability: dict[Ids, float]
    noise: NoiseEvidence

    @property
    def sets(self) -> list[Ids]:
        return [ids for ids in self.probability if ids != (OTHER,)]


def seen(noise: NoiseEvidence) -> Seen | None:
    """None where nothing is to be seen, or nothing that fits an effect: from the rate alone that is too little for a gap."""
    found = tuple(name for name in noise.named if name in EFFECTS)
    if not found:
        return None
    doubt = UNFITTING_DOUBT if OTHER in noise.named else DOUBT
    weights: dict[Ids, float] = {found: FAVOURED}
    for place, name in enumerate(found):
        for rival in LOOK_ALIKE.get(name, ()):
            if rival not in found:
                weights[tuple(sorted((*found[:place], rival, *found[place + 1 :])))] = 1.0
    total = sum(weights.values()) / (1.0 - doubt)
    return Seen({ids: weight / total for ids, weight in weights.items()} | {(OTHER,): doubt}, noise)


def join(rate: Diagnosis, noise: NoiseEvidence) -> Diagnosis:
    what = seen(noise)
    if what is None:
        risen = ["the output's spectrum is above the described floor in a way that fits no effect"] if noise.named else []
        return rate.model_copy(update={"notes": [*rate.notes, *risen]})
    hypotheses = _united(rate, what)
    silent = rate.verdict in ("no_gap", "insufficient")
    sets = _sets(rate, what, silent)
    verdict = _verdict(rate, what, silent, sets)
    names = dict.fromkeys([*(e.id for e in rate.effects), *(name for ids in what.sets for name in ids)])
    effects = [_effect(rate, what, name, hypotheses) for name in names]
    total = max(1.0, sum(e.share for e in effects))
    return rate.model_copy(update={
        "verdict": verdict, "sentence": _sentence(rate, what, silent), "hypotheses": hypotheses,
        "effects": sorted((e.model_copy(update={"share": e.share / total}) for e in effects), key=lambda e: -e.confidence),
        "alternatives": [list(ids) for ids in sets] if verdict == "ambiguous" else [],
        "where": [*(w.model_copy(update={"share": 0.5 * w.share}) for w in rate.where), *_where(rate, what, 1.0 if silent else 0.5)],
        "next_experiment": rate.next_experiment or (_next(sets) if verdict != "attributed" else None),
        "notes": list(dict.fromkeys([*rate.notes, *noise.notes]))})


def _united(rate: Diagnosis, what: Seen) -> list[Hypothesis]:
    joint: dict[frozenset[str], float] = {}
    for hypothesis in rate.hypotheses:
        for ids, value in what.probability.items():
            key = frozenset(hypothesis.ids) - {NONE} | frozenset(ids)
            joint[key] = joint.get(key, 0.0) + hypothesis.probability * value
    order = sorted(joint, key=lambda key: -joint[key])
    kept = list(dict.fromkeys([*order[:LISTED], frozenset({NONE}), frozenset({OTHER})]))
    total = sum(joint.get(key, 0.0) for key in kept)
    return [Hypothesis(ids=sorted(key), probability=joint.get(key, 0.0) / total) for key in kept]


def _sets(rate: Diagnosis, what: Seen, silent: bool) -> list[Ids]:
    """What is left: every explanation of the rate beside every one of the noise."""
    if silent:
        beside: list[Ids] = [()]
    elif rate.verdict == "ambiguous":
        beside = [tuple(ids) for ids in rate.alternatives]
    else:
        beside = [tuple(e.id for e in rate.effects) or (OTHER,)]
    united = [frozenset(a) | frozenset(b) for b in what.sets for a in beside]
    return [tuple(sorted(ids)) for ids in dict.fromkeys(united)]


def _verdict(rate: Diagnosis, what: Seen, silent: bool, sets: list[Ids]) -> str:
    if rate.verdict == "unknown":
        return "unknown"
    if len(sets) > 1 or what.probability[(OTHER,)] > DOUBT:
        sets += [] if len(sets) > 1 else [(OTHER,)]
        return "ambiguous"
    return "attributed" if silent or rate.verdict == "attributed" else "ambiguous"


def _effect(rate: Diagnosis, what: Seen, name: str, hypotheses: list[Hypothesis]) -> EffectFound:
    confidence = min(1.0, sum(h.probability for h in hypotheses if name in h.ids))
    known = next((e for e in rate.effects if e.id == name), None)
    if known is not None:
        return known.model_copy(update={"confidence": confidence})
    numbers = [Parameter(name=n, value=value, interval=interval, unit=unit) for n, value, interval, unit in what.noise.parameters(name)]
    share = sum(p / len(ids) for ids, p in what.probability.items() if name in ids)
    return EffectFound(id=name, stage=stage_of(name), confidence=confidence, parameters=numbers, share=share)


def _where(rate: Diagnosis, what: Seen, share: float) -> list[Where]:
    stop = max((w.region.stop for w in rate.where), default=0.0)
    region = Region(variable="time", start=0.0, stop=stop, unit="s")
    found = what.noise.where or [(stage_of(what.sets[0][0]), "rate", component_of(what.sets[0][0]), 1.0, "")]
    return [Where(stage=stage, channel=channel, component=component if component in COMPONENTS else "noise", share=share / len(found), region=region, size=0.0,
                  unit="1", ratio_over_floor=ratio) for stage, channel, component, ratio, _ in found]


def _sentence(rate: Diagnosis, what: Seen, silent: bool) -> str:
    ways = " or ".join(" with ".join(ids) for ids in what.sets)
    added = f"Noise, lines or readings of the output show more than the described device has: {ways}."
    return added if silent else f"{rate.sentence} {added}"


def _next(sets: list[Ids]) -> NextExperiment:
    return NextExperiment(run="the same recording with the baseband tap and raw bursts", separates=[list(ids) for ids in sets], predicted_separation=None,
                          why="both quadratures of both pickoffs, and codes, tell noise, jitter, lost samples and lines apart")
