"""The twin-level diagnosis on the full twin: one effect a case, in random order over catalogue and loops, a healthy one after every fifth.

    PYTHONPATH=tools python tests/campaigns/twin_level_cases.py --cases 28

Prints one line per case and then counts: healthy ones without a gap, effects named alone and rightly, unknown, wrong, and how many 95 % intervals held the truth.
A case takes 15 to 30 s of processor time.
"""

from __future__ import annotations

import argparse
import random
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from wineglass import effects, protocols, scenario
from wineglass.diagnosis import twin_engine
from wineglass.diagnosis.contract import Diagnosis
from wineglass.simulation import simulate

USUAL = 2.0
TIMES_TYPICAL = {"thermometer_lag": 0.05, "cross_damping": 10.0, "frequency_temperature": 5.0, "clock_error": 1.0, "damping_temperature": 3.0,
                 "drive_phase": 3.0, "flicker_noise": 5.0}


def cases(seed: int) -> Iterator[tuple[str, str, int]]:
    """Loop, effect ('' is healthy), seed of the noise."""
    order = [(loop, effect.id, 100 + i) for i, effect in enumerate(effects.catalogue()) for loop in ("open", "rebalance")]
    random.Random(seed).shuffle(order)
    for number, case in enumerate(order):
        yield case
        if number % 5 == 0:
            yield case[0], "", 900 + number * 6 // 5


def diagnosed(loop: str, effect: str, seed: int) -> Diagnosis:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.h5"
        chosen = [effects.typical(effect, TIMES_TYPICAL.get(effect, USUAL))] if effect else []
        simulate(scenario.prepare(protocols.scenario("full", device="metal-fast", loop=loop, seed=seed)), path, effects=chosen)
        found = twin_engine.examine(path)
    assert found is not None
    return found.verdict.diagnosis


def held(effect: str, diagnosis: Diagnosis) -> list[bool]:
    """Of every number given for the effect: does its interval hold what was switched on?"""
    truth = {p.name: TIMES_TYPICAL.get(effect, USUAL) * p.typical if p.strength else p.usual for p in effects.find(effect).parameters}
    numbers = [p for e in diagnosis.effects if e.id == effect for p in e.parameters]
    return [p.interval[0] <= truth[p.name] <= p.interval[1] for p in numbers if p.name in truth]


def judged(effect: str, diagnosis: Diagnosis) -> str:
    if not effect:
        return "healthy, no gap" if diagnosis.verdict == "no_gap" else "healthy, false gap"
    if diagnosis.verdict == "attributed":
        return "right" if [e.id for e in diagnosis.effects] == [effect] else "wrong"
    return diagnosis.verdict


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--seed", type=int, default=7, help="of the order")
    args = parser.parse_args()
    counts: Counter[str] = Counter()
    intervals: list[bool] = []
    for number, (loop, effect, seed) in zip(range(args.cases), cases(args.seed)):
        diagnosis = diagnosed(loop, effect, seed)
        verdict = judged(effect, diagnosis)
        counts[verdict] += 1
        intervals += held(effect, diagnosis) if verdict in ("right", "wrong") else []
        print(f"{number + 1:3d} {loop:9s} {effect or 'healthy':26s} seed {seed}: {verdict}; removed {diagnosis.shrink.all.fraction}", flush=True)
    print(", ".join(f"{name} {count}" for name, count in counts.items()), f"; intervals {sum(intervals)} of {len(intervals)}")


if __name__ == "__main__":
    main()
