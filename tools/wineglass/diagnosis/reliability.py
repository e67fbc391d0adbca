"""How far an answer is to be believed: what no likelihood knows, because all its models may be wrong.

On the scored sets 20267 to 20269 (docs/NUMBERS.md), nulls and what can be seen from SNR 10 on, an explanation that was said to stand alone was the whole truth in 241 of
275 answers, `unknown` was right in 75 of 152 and `no_gap` in 145 of 157 of protocol `full` (96 of 141 of the shorter ones, where tolerances cover more). Probabilities are taken back
to that."""

from __future__ import annotations

from collections.abc import Sequence

from wineglass.diagnosis.hypotheses import Hypotheses, Ids
from wineglass.diagnosis.vocabulary import FLICKER, NONE, OTHER

ALONE, UNKNOWN, NO_GAP = 0.87, 0.5, 0.92  # at most, of one explanation that stands alone; of something unknown; of no gap at all
BESIDE = 0.6  # of what is taken from an explanation: that it is a part of the truth


def tempered(found: Hypotheses, verdict: str, named: Sequence[Ids], closed: Sequence[Ids]) -> Hypotheses:
    """named: the explanations of the answer. closed: those that were followed on the envelope twin, the best first."""
    if verdict == "attributed":
        return _with_a_doubt(found, tuple(sorted(named[0])))
    if verdict == "no_gap":
        return _perhaps_covered(found)
    return _perhaps_known(found, closed) if verdict == "unknown" else found


def _with_a_doubt(found: Hypotheses, alone: Ids) -> Hypotheses:
    kept = dict(found.probability)
    place = next((ids for ids in kept if set(ids) == set(alone)), None)
    if place is None or kept[place] <= ALONE:
        return found
    taken, kept[place] = kept[place] - ALONE, ALONE
    for ids, part in ((tuple(sorted({*alone, OTHER})), BESIDE), ((OTHER,), 1.0 - BESIDE)):
        kept[ids] = kept.get(ids, 0.0) + part * taken
    return Hypotheses(kept)


def _perhaps_covered(found: Hypotheses) -> Hypotheses:
    """Of no gap a part is something that tolerances or noise cover."""
    if found.none <= NO_GAP:
        return found
    kept = dict(found.probability)
    kept[(NONE,)] = NO_GAP
    kept[(OTHER,)] = kept.get((OTHER,), 0.0) + found.none - NO_GAP
    return Hypotheses(kept)


def _perhaps_known(found: Hypotheses, closed: Sequence[Ids]) -> Hypotheses:
    """Of every set with something unknown a part without it; in the place of something unknown alone the best explanations that there are: where nothing
    was, what foretells nothing is noise that wanders."""
    if found.other <= UNKNOWN:
        return found
    part = 1.0 - UNKNOWN / found.other
    kept: dict[Ids, float] = {(NONE,): found.none, (OTHER,): 0.0}
    rivals = list(dict.fromkeys(tuple(sorted(ids)) for ids in closed))[:3] or [(FLICKER,)]
    for ids, p in found.probability.items():
        known = tuple(e for e in ids if e != OTHER)
        instead = [known] if known else rivals
        share = part if OTHER in ids and instead else 0.0
        kept[ids] = (kept.get(ids, 0.0) if ids != (NONE,) else 0.0) + (1.0 - share) * p
        for other in instead if share else []:
            kept[other] = kept.get(other, 0.0) + share * p / len(instead)
    return Hypotheses(kept)
