"""How honest the rate-level diagnosis is, on gyros of other forms than its own (rate_level_cases.py).

    python tests/campaigns/rate_level_honesty.py --cases 150 [--first 1] [--jobs 2] [--list] [--makes]

--makes draws from rate_level_makes.py instead: other sampling, thermometers, soaks and pauses.
Prints: false gaps on nulls, truth among the named, unique and wrong, unknown flagged, Brier score and expected calibration error of the probabilities,
held-out gap removed. docs/NUMBERS.md has the last result. About 1 s a case.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

sys.path[:0] = [str(Path(__file__).resolve().parents[2] / "tools"), str(Path(__file__).resolve().parent)]

import wineglass  # noqa: E402, F401 - before numpy: threads

import numpy as np  # noqa: E402
import rate_level_cases as cases  # noqa: E402
import rate_level_makes as makes  # noqa: E402

BINS = 10
NEAREST = cases.NEAREST | makes.NEAREST


@dataclass(frozen=True)
class Answer:
    seed: int
    kind: str
    profile: str
    size: float
    truth: frozenset[str]
    foreign: bool
    verdict: str
    named: tuple[frozenset[str], ...]
    probabilities: tuple[tuple[frozenset[str], float], ...]
    fraction: float | None

    @property
    def gap(self) -> bool:
        return self.verdict in ("attributed", "ambiguous", "unknown")

    @property
    def right(self) -> frozenset[str]:
        """The set of ids that a perfect answer holds."""
        if self.foreign:
            return frozenset({"other"})
        return self.truth or frozenset({"none"})

    def accepts(self, ids: frozenset[str]) -> bool:
        return ids == self.right or (self.foreign and ids == NEAREST.get(self.kind))

    @property
    def unique_and_wrong(self) -> bool:
        return self.verdict == "attributed" and not self.accepts(self.named[0])

    @property
    def truth_named(self) -> bool:
        return any(self.accepts(ids) for ids in self.named)


def answer_of_makes(seed: int) -> Answer:
    return answer(seed, source=makes)


def answer(seed: int, kind: str | None = None, profile: str | None = None, size: float | None = None, source: ModuleType = cases) -> Answer:
    from wineglass.diagnosis.rate_level import analyse
    from wineglass.diagnosis.verdict import diagnose

    case = source.draw(seed, kind, profile, size)
    found = diagnose(case.evidence, analyse(case.evidence))
    named = [frozenset(ids) for ids in found.alternatives] or ([frozenset(e.id for e in found.effects)] if found.effects else [])
    probabilities = tuple((frozenset(h.ids), h.probability) for h in found.hypotheses)
    return Answer(seed, case.kind, case.profile, case.size, case.truth, case.foreign, found.verdict, tuple(named), probabilities, found.shrink.all.fraction)


def brier(answers: list[Answer]) -> float:
    """Mean over the cases of the sum over hypotheses of (probability - truth)^2."""
    scores = []
    for a in answers:
        table = dict(a.probabilities)
        right = sum(p for ids, p in table.items() if a.accepts(ids))
        scores.append((1.0 - right) ** 2 + sum(p**2 for ids, p in table.items() if not a.accepts(ids)))
    return float(np.mean(scores))


def calibration_error(answers: list[Answer]) -> float:
    """Expected difference between a marginal confidence and how often it is right, over ten bins."""
    confidence, hit = [], []
    for a in answers:
        for name in {i for ids, _ in a.probabilities for i in ids} - {"none", "other"}:
            confidence.append(sum(p for ids, p in a.probabilities if name in ids))
            hit.append(name in a.truth or (a.foreign and name in NEAREST.get(a.kind, ())))
    confidence, hit = np.array(confidence), np.array(hit, float)
    place = np.minimum((confidence * BINS).astype(int), BINS - 1)
    return float(sum(abs(confidence[place == b].sum() - hit[place == b].sum()) for b in range(BINS)) / max(1, len(hit)))


def share(answers: list[Answer], test) -> str:  # noqa: ANN001 - Answer -> bool
    hits = sum(test(a) for a in answers)
    return f"{hits}/{len(answers)}" + (f" = {100 * hits / len(answers):.1f} %" if answers else "")


def report(answers: list[Answer]) -> list[str]:
    nulls = [a for a in answers if a.kind == "null"]
    known = [a for a in answers if a.truth]
    foreign = [a for a in answers if a.foreign]
    removed = [a.fraction for a in known if a.fraction is not None and a.verdict in ("attributed", "ambiguous")]
    lines = [
        f"nulls with a gap                {share(nulls, lambda a: a.gap)}",
        f"unique and wrong, all           {share(answers, lambda a: a.unique_and_wrong)}",
        f"unique and wrong, foreign       {share(foreign, lambda a: a.unique_and_wrong)}",
        f"truth among the named, of gaps  {share([a for a in known if a.gap], lambda a: a.truth_named)}",
        f"gap seen                        {share(known, lambda a: a.gap)}",
        f"uniquely named and right        {share(known, lambda a: a.verdict == 'attributed' and a.truth_named)}",
        f"foreign: unknown                {share(foreign, lambda a: a.verdict == 'unknown')}",
        f"foreign: no gap or insufficient {share(foreign, lambda a: not a.gap)}",
        f"Brier {brier(answers):.3f}, expected calibration error {calibration_error(answers):.3f}",
    ]
    return lines + ([f"held-out gap removed, median    {np.median(removed):.3f}"] if removed else [])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=150)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--list", action="store_true", help="every case that is wrong, and the verdicts by kind")
    parser.add_argument("--makes", action="store_true", help="gyros of rate_level_makes.py")
    args = parser.parse_args()
    answers: list[Answer] = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for found in pool.map(answer_of_makes if args.makes else answer, range(args.first, args.first + args.cases)):
            answers.append(found)
            if len(answers) % 25 == 0:
                print(f"{len(answers)} cases done", file=sys.stderr, flush=True)
    print("\n".join(report(answers)))
    if args.list:
        _list(answers, (makes if args.makes else cases).kinds())


def _list(answers: list[Answer], kinds: list[str]) -> None:
    for kind in kinds:
        of = [a for a in answers if a.kind == kind]
        print(f"{kind:24} {dict(Counter(a.verdict for a in of))}")
    for a in answers:
        missed = a.truth and a.gap and not a.truth_named
        if a.unique_and_wrong or missed or (a.kind == "null" and a.gap):
            best = sorted(a.probabilities, key=lambda item: -item[1])[:3]
            print(f"{'WRONG' if a.unique_and_wrong else 'missed':6} seed {a.seed} {a.kind}, {a.profile}, {a.size:g}: {a.verdict} "
                  f"{[sorted(ids) for ids in a.named]} {[(sorted(ids), round(p, 2)) for ids, p in best]}")


if __name__ == "__main__":
    main()
