"""Probabilities over sets of effects, none and other: what the slow channels say, and what noise and raw codes say, together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import logsumexp

from wineglass.diagnosis.explain import GENERIC_PRIOR, INCLUSION
from wineglass.diagnosis.vocabulary import EFFECTS, NONE, OTHER

if TYPE_CHECKING:
    from wineglass.diagnosis.noise_level import NoiseEvidence
    from wineglass.diagnosis.twin_level import TwinAnalysis

Ids = tuple[str, ...]
TRACED = frozenset({"thermometer_quantisation", "firmware_mismatch"})
"""Effects that move slow channels, too, but never without a trace in noise, lines, events or codes: where that was looked for and not found,
they are not it."""
UNSEEN = -20.0
HINTED, UNHINTED = frozenset({"vibration"}), -8.0
"""Effects that usually leave a line: where lines were looked at and there is none, a steady bias is more likely something else's."""
CREDIBLE = 0.95
SETTLED = 0.8
SIMPLER = 0.3  # a set is dropped for a part of it that is at least this times as probable
LISTED = 12


@dataclass(frozen=True)
class Hypotheses:
    """probability: set of ids -> probability, summing to 1; sets may hold `other` beside effects."""

    probability: dict[Ids, float]

    @property
    def none(self) -> float:
        return self.probability.get((NONE,), 0.0)

    @property
    def other(self) -> float:
        """That something is there which the catalogue does not have."""
        return sum(p for ids, p in self.probability.items() if OTHER in ids)

    def marginal(self, effect: str) -> float:
        return sum(p for ids, p in self.probability.items() if effect in ids)

    @property
    def named(self) -> list[Ids]:
        """Sets of effects without `other`, the most probable first."""
        return sorted((ids for ids in self.probability if NONE not in ids and OTHER not in ids), key=lambda ids: -self.probability[ids])

    @property
    def best_known(self) -> Ids:
        """The effects of the most probable set, `other` aside."""
        best = max((ids for ids in self.probability if NONE not in ids), key=lambda ids: self.probability[ids], default=())
        return tuple(e for e in best if e in EFFECTS)


def below_the_floor(found: Hypotheses) -> Hypotheses:
    """What moves no channel beyond its floor is no gap, whatever it is: that is what the word means."""
    if found.none >= CREDIBLE:
        return found
    rest = max(1e-300, 1.0 - found.none)
    kept = {ids: p * (1.0 - CREDIBLE) / rest for ids, p in found.probability.items() if NONE not in ids}
    return Hypotheses({**kept, (NONE,): 1.0 - sum(kept.values())})


def not_none(found: Hypotheses) -> Hypotheses:
    """Where a gap is plain, what was believed of none is something else."""
    kept = {**found.probability, (OTHER,): found.probability.get((OTHER,), 0.0) + found.none, (NONE,): 0.0}
    return Hypotheses(kept)


def with_other(found: Hypotheses) -> Hypotheses:
    """Every explanation with something unknown beside it."""
    kept: dict[Ids, float] = {(NONE,): found.none, (OTHER,): 0.0}
    for ids, p in found.probability.items():
        if NONE not in ids:
            beside = tuple(sorted({*ids, OTHER}))
            kept[beside] = kept.get(beside, 0.0) + p
    return Hypotheses(kept)


def perhaps_with_other(found: Hypotheses, share: float) -> Hypotheses:
    """Every explanation to this share with something unknown beside it."""
    kept: dict[Ids, float] = {}
    for hypotheses, part in ((found, 1.0 - share), (with_other(found), share)):
        for ids, p in hypotheses.probability.items():
            kept[ids] = kept.get(ids, 0.0) + part * p
    return Hypotheses(kept)


def perhaps_without_other(found: Hypotheses, share: float) -> Hypotheses:
    """Every set of effects that has something unknown beside it, to this share without."""
    kept: dict[Ids, float] = {(NONE,): found.none, (OTHER,): 0.0}
    for ids, p in found.probability.items():
        part = share if OTHER in ids and ids != (OTHER,) else 0.0
        without = tuple(e for e in ids if e != OTHER)
        kept[ids] = (kept.get(ids, 0.0) if ids != (NONE,) else 0.0) + (1.0 - part) * p
        if part:
            kept[without] = kept.get(without, 0.0) + part * p
    return Hypotheses(kept)


def shared_with_other(found: Hypotheses, effects: frozenset[str], share: float) -> Hypotheses:
    """Of every set with all of these effects this share as something unknown in their place."""
    kept: dict[Ids, float] = {(NONE,): found.none, (OTHER,): 0.0}
    for ids, p in found.probability.items():
        part = share if effects <= set(ids) else 0.0
        instead = tuple(sorted({*ids, OTHER} - effects))
        kept[ids] = (kept.get(ids, 0.0) if ids != (NONE,) else 0.0) + (1.0 - part) * p
        if part:
            kept[instead] = kept.get(instead, 0.0) + part * p
    return Hypotheses(kept)


def shared_with(found: Hypotheses, effect: str, share: float) -> Hypotheses:
    """Of something unknown alone this share as an effect."""
    kept, unknown = dict(found.probability), found.probability.get((OTHER,), 0.0)
    kept[(OTHER,)] = (1.0 - share) * unknown
    kept[(effect,)] = kept.get((effect,), 0.0) + share * unknown
    return Hypotheses(kept)


def doubted(found: Hypotheses, traced: frozenset[str], believed: float) -> Hypotheses:
    """Of every set with something unknown in it, effects without a trace of their own are believed to this share."""
    kept: dict[Ids, float] = {(NONE,): 0.0, (OTHER,): 0.0}
    for ids, p in found.probability.items():
        less = tuple(e for e in ids if e == OTHER or e in traced) if OTHER in ids else ids
        kept[ids] = kept.get(ids, 0.0) + believed * p
        kept[less] = kept.get(less, 0.0) + (1.0 - believed) * p
    return Hypotheses(kept)


def less(found: Hypotheses, support: frozenset[str], idle: frozenset[str]) -> Hypotheses:
    """Every set that holds an explanation without those of its effects that do nothing in it."""
    kept: dict[Ids, float] = {(NONE,): 0.0, (OTHER,): 0.0}
    for ids, p in found.probability.items():
        part = tuple(e for e in ids if e not in idle) or (NONE,)
        place = part if support <= set(ids) else ids
        kept[place] = kept.get(place, 0.0) + p
    return Hypotheses(kept)


def only(found: Hypotheses, traced: frozenset[str]) -> Hypotheses:
    """Of every set what has a trace of its own: beside that no channel is beyond its floor."""
    kept: dict[Ids, float] = {(NONE,): 0.0, (OTHER,): 0.0}
    for ids, p in found.probability.items():
        part = tuple(e for e in ids if e in traced) or (NONE,)
        kept[part] = kept.get(part, 0.0) + p
    return Hypotheses(kept)


def weigh(found: TwinAnalysis, noise: NoiseEvidence | None) -> Hypotheses:
    """noise: None where nothing was looked at."""
    logs: dict[Ids, float] = {}

    def add(ids: frozenset[str], value: float) -> None:
        key = tuple(sorted(ids)) if ids else (NONE,)
        logs[key] = float(np.logaddexp(logs[key], value)) if key in logs else value

    traces = noise.log_evidence if noise is not None else {frozenset[str](): 0.0}
    excluded, doubted = (frozenset(e for e in group if noise is not None and noise.looks.get(e)) for group in (TRACED, HINTED))
    no_generic = len(found.names) * np.log1p(-GENERIC_PRIOR)
    slow = [(frozenset[str](), found.none), *[(frozenset(c.support), c.entry) for c in found.closed if c.earned]]
    for support, entry in slow:
        with_other = entry.log_generic + np.log1p(-min(1.0 - 1e-12, np.exp(min(0.0, no_generic - entry.log_generic))))
        for trace, value in traces.items():
            extra = len([e for e in trace if e in EFFECTS and e not in support]) * np.log(INCLUSION / (1.0 - INCLUSION))
            penalty = UNSEEN * len((support & excluded) - trace) + UNHINTED * len((support & doubted) - trace)
            both = support | trace
            add(both, entry.log_evidence + no_generic + value + extra + penalty)
            add(both | {OTHER}, entry.log_evidence + with_other + value + extra + penalty)
    total = logsumexp(list(logs.values()))
    return Hypotheses(_listed({ids: float(np.exp(v - total)) for ids, v in logs.items()}))


def _listed(probability: dict[Ids, float]) -> dict[Ids, float]:
    """The most probable sets, none and other, and together one."""
    order = sorted(probability, key=lambda ids: -probability[ids])
    kept = dict.fromkeys([*order[:LISTED], (NONE,), (OTHER,)])
    total = sum(probability.get(ids, 0.0) for ids in kept)
    return {ids: probability.get(ids, 0.0) / total for ids in kept}


def alternatives(found: Hypotheses) -> list[Ids]:
    """The credible sets, without those that contain a simpler and about as probable one."""
    order = found.named
    total = sum(found.probability[ids] for ids in order)
    credible: list[Ids] = []
    mass = 0.0
    for ids in order:
        if mass >= CREDIBLE * total or found.probability[ids] <= 0.0:
            break
        credible.append(ids)
        mass += found.probability[ids]
    return [ids for ids in credible
            if not any(set(simpler) < set(ids) and found.probability[simpler] >= SIMPLER * found.probability[ids] for simpler in credible)]
