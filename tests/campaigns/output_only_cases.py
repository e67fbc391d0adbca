"""Recordings of a described device that hold its output and the bench's references, but no baseband: what is said of them, one effect a case.

    PYTHONPATH=tools python tests/campaigns/output_only_cases.py --cases 60 [--seed 7]

Full twin, metal-fast, both loops, the protocols full, thermal and table in turn, every second case another unit within the tolerances; a healthy one after every
fourth. Prints one line per case and then counts: healthy ones without a gap, the truth among the named, unique and right, unique and wrong. About 7 s a case.
"""

from __future__ import annotations

import argparse
import random
import tempfile
from collections import Counter
from pathlib import Path

import h5py
import numpy as np

from wineglass import effects, protocols, scenario
from wineglass.diagnosis.contract import Diagnosis
from wineglass.diagnosis.evidence import from_recording
from wineglass.diagnosis.rate_level import analyse
from wineglass.diagnosis.unit import Unit
from wineglass.diagnosis.verdict import diagnose
from wineglass.simulation import simulate

FACTORS = (1.0, 3.0, 8.0)
PROTOCOLS = ("full", "thermal", "table")
KEPT = ("output", "reference")


def recorded(folder: Path, protocol: str, loop: str, effect: str, factor: float, seed: int, other_unit: bool) -> Path:
    """Output and references alone."""
    run = scenario.prepare(protocols.scenario(protocol, device="metal-fast", loop=loop, seed=seed))
    if other_unit:
        unit = Unit.of(run.device)
        run = scenario.Run(run.scenario, run.device, unit.at(np.random.default_rng([seed, 5]).standard_normal(len(unit.uncertain))).device)
    simulate(run, folder / "all.h5", effects=[effects.typical(effect, factor)] if effect else [])
    with h5py.File(folder / "all.h5") as source, h5py.File(folder / "output.h5", "w") as target:
        target.attrs.update(source.attrs)
        for name in source:
            if name in KEPT or not isinstance(source[name], h5py.Group):
                source.copy(name, target)
    return folder / "output.h5"


def judged(effect: str, found: Diagnosis) -> str:
    if not effect:
        return "healthy, no gap" if found.verdict == "no_gap" else f"healthy, FALSE {found.verdict}"
    if found.verdict == "no_gap":
        return "not seen"
    sets = [set(ids) for ids in found.alternatives] or [{e.id for e in found.effects}]
    if found.verdict == "attributed":
        return "unique and right" if sets == [{effect}] else "unique and WRONG"
    if found.verdict == "unknown":
        return "unknown"
    return "truth among them" if {effect} in sets else "with others" if any(effect in ids for ids in sets) else "truth not among them"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=30)
    parser.add_argument("--seed", type=int, default=7, help="of order and noise")
    args = parser.parse_args()
    chance = random.Random(args.seed)
    names = [effect.id for effect in effects.catalogue()]
    chance.shuffle(names)
    counts: Counter[str] = Counter()
    for number in range(args.cases):
        effect = "" if number % 5 == 4 else names[(number - number // 5) % len(names)]
        protocol, loop, factor = PROTOCOLS[number % 3], chance.choice(("open", "rebalance")), chance.choice(FACTORS)
        with tempfile.TemporaryDirectory() as folder:
            path = recorded(Path(folder), protocol, loop, effect, factor, 1000 * args.seed + number, number % 2 == 1)
            evidence = from_recording(path)
            found = diagnose(evidence, analyse(evidence))
        verdict = judged(effect, found)
        counts[verdict] += 1
        probable = [f"{'+'.join(h.ids)} {h.probability:.2f}" for h in found.hypotheses[:3]]
        print(f"{number + 1:3d} {protocol:7s} {loop:9s} {effect or 'healthy':24s} x {factor:g}: {verdict}; {', '.join(probable)}", flush=True)
    print(", ".join(f"{name} {count}" for name, count in sorted(counts.items())))


if __name__ == "__main__":
    main()
