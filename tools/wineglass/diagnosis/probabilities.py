"""From scores to probabilities that can be believed.

Four corrections to the plain posterior, all because forms are only approximately right:

* Where a remainder larger than the floor is needed, the forms are known to be wrong, and differences of log evidence overstate what the data say.
  They are divided by 1 + 2 P(large remainder).
* An explanation that imitates the best one's signal (leaves no more than IMITATES of the gap, in the same number of effects or fewer) cannot be
  excluded by its exact shape alone: its probability is kept within IMITATOR_NATS of the best.
* What predicts held-out branches badly loses HELD_OUT_WEIGHT ln(rms) for it; below the floor's threshold all are equally good.
* What is in no catalogue is fitted by something that is, better the more effects may take part. So a set keeps its probability by odds that
  fall with the number of its effects and with the share of the gap that it leaves, in sample and on held-out blocks; the rest goes to `other`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from wineglass.diagnosis.bayes import Scores
from wineglass.diagnosis.noise_models import CLASSES
from wineglass.diagnosis.vocabulary import NONE, OTHER

IMITATES = 0.25
IMITATOR_NATS = 1.5
REMAINDER_WEIGHT = 2.0
HELD_OUT_WEIGHT = 1.0
HELD_OUT_MARGIN = 0.95  # an explanation earns its place when it leaves less than this share of what is left without it
CREDIBLE = 0.95
SETTLED = 0.8
LEAVES_AT_MOST = 0.6  # of the gap, in sample: what leaves more is no explanation of it
SIMPLER = 0.5  # an explanation is dropped for a part of it that is at least this times as probable
LISTED = 12
OPEN = 1.5  # a miss on held-out blocks within this times what the fit leaves open is no evidence against it
LEAST_NAMED = 0.02  # an explanation that is less probable is not named
TRUE_ODDS = (20.0, 8.0, 0.7)  # that one, two, three effects which leave nothing are really it, and no imitation of something unknown
ONE_BRANCH_ODDS = 0.25  # times those, where the temperature moves in one direction only and any smooth function of time will do
FORM_ERROR = 0.3  # share of the gap: what a true effect leaves, as its form is not exactly nature's; the odds fall e-fold with each
UNFOLLOWED = 0.7  # share taken for sets whose residuals were not computed


@dataclass(frozen=True)
class HeldOut:
    """rms: left on held-out blocks. uncertain: rms of what the fit part leaves open there"""

    rms: float
    uncertain: float


@dataclass(frozen=True)
class Posterior:
    """probability: set of ids -> probability, sums to 1; remainder: of the best explanation, probability that it leaves more than the floor."""

    probability: dict[tuple[str, ...], float]
    coarsening: float
    remainder: float

    def marginal(self, effect_id: str) -> float:
        return sum(p for ids, p in self.probability.items() if effect_id in ids)

    @property
    def none(self) -> float:
        return self.probability[(NONE,)]

    @property
    def other(self) -> float:
        return self.probability[(OTHER,)]

    @property
    def explanations(self) -> list[tuple[str, ...]]:
        """Sets of effects, the most probable first."""
        named = [ids for ids in self.probability if ids not in ((NONE,), (OTHER,))]
        return sorted(named, key=lambda ids: -self.probability[ids])


def raw_log(scores: Scores) -> dict[tuple[str, ...], float]:
    floor, flicker, other = (CLASSES.index(kind) for kind in ("floor", "flicker", "other"))
    table = dict(zip(scores.supports, scores.by_support))
    bare = table.pop(())
    logs = {(NONE,): float(bare[floor]), ("flicker_noise",): float(bare[flicker]), (OTHER,): float(bare[other])}
    return logs | {support: float(logsumexp(row)) for support, row in table.items()}


@dataclass(frozen=True)
class Leftover:
    """What explanations leave. left, held: support -> in sample, on held-out blocks; () is without any effect. floor, threshold: rms of
    noise, and its 99 % quantile; one_branch: the temperature moves in one direction only."""

    left: dict[tuple[str, ...], float]
    held: dict[tuple[str, ...], HeldOut]
    floor: float
    threshold: float
    one_branch: bool = False

    def share(self, ids: tuple[str, ...], remainder: float) -> float:
        """Of the gap's amplitude, where it is worse: in sample or held out. remainder: probability that what is left in sample is more than noise."""
        if ids not in self.left:
            return UNFOLLOWED
        sample = remainder * share_left(self.left[ids], self.left[()], self.floor)
        held, bare = self.held[ids], self.held[()].rms
        beyond = max(0.0, held.rms**2 - max(self.threshold, held.uncertain) ** 2) / max(bare**2, 1e-300)
        return max(sample, float(np.sqrt(beyond)))

    def belief(self, ids: tuple[str, ...], remainder: float) -> float:
        """Probability that a set which explains the data best is really it."""
        odds = TRUE_ODDS[len(ids) - 1] * (ONE_BRANCH_ODDS if self.one_branch else 1.0) * float(np.exp(-self.share(ids, remainder) / FORM_ERROR))
        return odds / (1.0 + odds)


def posterior(scores: Scores, leftover: Leftover) -> Posterior:
    left, held, threshold = leftover.left, leftover.held, leftover.threshold
    logs = raw_log(scores)
    all_rows = scores.by_support
    large = float(np.exp(logsumexp(all_rows[:, 1:]) - logsumexp(all_rows)))
    coarsening = 1.0 + REMAINDER_WEIGHT * large
    logs = {ids: value / coarsening for ids, value in logs.items()}
    bare = held[()]
    logs = {ids: value - HELD_OUT_WEIGHT * float(np.log(max(_charged(held.get(ids, bare), bare), threshold))) for ids, value in logs.items()}
    logs = _with_imitators(logs, left)
    total = logsumexp(list(logs.values()))
    table = dict(zip(scores.supports, all_rows))
    best = max((s for s in table if s), key=lambda s: logs[s])
    plain = {ids: float(np.exp(v - total)) for ids, v in logs.items()}
    return Posterior(_listed(_believed(plain, table, leftover)), coarsening, _remainder(table[best]))


def _remainder(row: np.ndarray) -> float:
    """Probability that a support leaves more than the floor; row: log evidence by class of noise."""
    return float(np.exp(logsumexp(row[1:]) - logsumexp(row)))


def _believed(plain: dict[tuple[str, ...], float], table: dict[tuple[str, ...], np.ndarray], leftover: Leftover) -> dict[tuple[str, ...], float]:
    """What is not believed of each set goes to `other`."""
    believed = dict(plain)
    for ids in table:
        if ids:
            believed[ids] = plain[ids] * leftover.belief(ids, _remainder(table[ids]))
            believed[(OTHER,)] += plain[ids] - believed[ids]
    return believed


def _charged(found: HeldOut, bare: HeldOut) -> float:
    """A miss that the fit part left open counts no more than that of the nominal twin."""
    return min(found.rms, bare.rms) if found.rms <= OPEN * found.uncertain else found.rms


def _with_imitators(logs: dict[tuple[str, ...], float], left: dict[tuple[str, ...], float]) -> dict[tuple[str, ...], float]:
    """Only what imitates without effects to spare: a set that holds another imitator owes it nothing. A part of the best explanation that does as well as the
    whole is as probable: what the rest adds may be the form's error."""
    best = max(logs, key=lambda ids: logs[ids])
    if best not in left or best == () or not left[()] > 0.0:
        return logs
    bound = max(IMITATES * left[()], 1.3 * left[best])
    able = [ids for ids, rms in left.items() if ids and ids != best and len(ids) <= len(best) and rms <= bound]
    for ids in able:
        if not any(set(other) < set(ids) for other in able):
            logs[ids] = max(logs[ids], logs[best] - (0.0 if set(ids) < set(best) else IMITATOR_NATS))
    return logs


def _listed(probability: dict[tuple[str, ...], float]) -> dict[tuple[str, ...], float]:
    """The most probable sets, none and other; what the rest had is spread over them in proportion."""
    order = sorted(probability, key=lambda ids: -probability[ids])
    kept = dict.fromkeys([*order[:LISTED], (NONE,), (OTHER,)])
    total = sum(probability[ids] for ids in kept)
    return {ids: probability[ids] / total for ids in kept}


def earns_its_place(ids: tuple[str, ...], held: dict[tuple[str, ...], HeldOut], threshold: float) -> bool:
    """Does it predict held-out data better than nothing, and better than without any one of its effects (where that was computed)?"""
    if ids not in held or held[ids].rms <= threshold:
        return True
    rivals = [(), *(tuple(i for i in ids if i != out) for out in ids if len(ids) > 1)]
    return all(held[ids].rms < HELD_OUT_MARGIN * held[r].rms for r in rivals if r in held)


def is_open(ids: tuple[str, ...], held: dict[tuple[str, ...], HeldOut]) -> bool:
    """Do the fit parts leave open what it would do on the held-out ones? Then they say nothing about it."""
    return ids in held and held[ids].rms <= OPEN * held[ids].uncertain


def share_left(rms: float, bare: float, floor: float) -> float:
    """Share of the amplitude above the floor that an explanation leaves."""
    return float(np.sqrt(max(0.0, rms**2 - floor**2) / max(bare**2 - floor**2, 1e-6 * bare**2, 1e-300)))


def alternatives(
    found: Posterior, left: dict[tuple[str, ...], float], held: dict[tuple[str, ...], HeldOut], floor: float, threshold: float
) -> list[tuple[str, ...]]:
    """The credible set of what held-out data support or leave open, without explanations that contain a simpler and about as probable one."""
    order = [ids for ids in found.explanations if found.probability[ids] >= LEAST_NAMED]
    order = [ids for ids in order if earns_its_place(ids, held, threshold) or is_open(ids, held)]
    order = [ids for ids in order if ids not in left or left[ids] <= threshold or share_left(left[ids], left[()], floor) <= LEAVES_AT_MOST]
    total = sum(found.probability[ids] for ids in order)
    credible, mass = [], 0.0
    for ids in order:
        if mass >= CREDIBLE * total:
            break
        credible.append(ids)
        mass += found.probability[ids]
    return [
        ids for ids in credible
        if not any(set(simpler) < set(ids) and found.probability[simpler] >= SIMPLER * found.probability[ids] for simpler in credible)
    ]
