"""The twin-level diagnosis on recordings of the full twin: catalogue effects one at a time in both loops, healthy ones between them.

    PYTHONPATH=tools python tests/campaigns/twin_level_cases.py --cases 66 --results full.jsonl
    PYTHONPATH=tools python tests/campaigns/twin_level_cases.py --healthy 100 --results healthy.jsonl
    PYTHONPATH=tools python tests/campaigns/twin_level_cases.py --cases 66 --without --results without.jsonl      # the effect is taken out of the catalogue
    PYTHONPATH=tools python tests/campaigns/twin_level_cases.py --cases 66 --protocol thermal --results thermal.jsonl

One line per case as it is done, then the counts with Wilson's 95 % intervals. Cases that the results file has are not done again. --units draws every value that
the description calls uncertain anew, so that each recording is of another healthy unit. A case takes 10 to 30 s of processor time.
"""

from __future__ import annotations

import argparse
import json
import random
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import reduce
from itertools import islice
from pathlib import Path

import numpy as np

from wineglass import device, effects, protocols, scenario
from wineglass.blind.statistics import Share
from wineglass.diagnosis import twin_engine
from wineglass.diagnosis.contract import Diagnosis
from wineglass.diagnosis.explain import posterior_mean
from wineglass.diagnosis.system import products
from wineglass.diagnosis.twin_engine import Examined
from wineglass.diagnosis.unit import Unit
from wineglass.effects import Setting
from wineglass.scenario import Run
from wineglass.simulation import simulate

DEVICE = "metal-fast"
USUAL = 2.0
TIMES_TYPICAL = {"thermometer_lag": 0.05, "cross_damping": 10.0, "frequency_temperature": 5.0, "clock_error": 15.0, "adc_saturation": 0.8, "damping_temperature": 3.0,
                 "drive_phase": 3.0, "flicker_noise": 5.0}
LARGEST_OFF = 1.7  # standard deviations of a drawn unit
SURE = 0.8
TWINS = 10.0  # nats: a recording that holds less against an explanation cannot tell it from the truth


@dataclass(frozen=True)
class Case:
    """effect: '' is healthy."""

    protocol: str
    loop: str
    effect: str
    seed: int
    units: bool
    without: bool


def cases(args: argparse.Namespace) -> Iterator[Case]:
    if args.healthy:
        for number in range(args.healthy):
            yield Case(args.protocol, ("open", "rebalance")[number % 2], "", 5000 + 100 * args.seed + number, args.units, False)
        return
    order = [(loop, effect.id, 1000 * args.seed + i) for i, effect in enumerate(effects.catalogue()) for loop in ("open", "rebalance")]
    random.Random(args.seed).shuffle(order)
    yield from islice((Case(args.protocol, loop, effect, seed, args.units, args.without) for loop, effect, seed in order), args.cases)


def drawn(seed: int) -> dict[str, object]:
    """Values of a healthy unit, uniform within the largest number of standard deviations."""
    unit = Unit.of(device.load(DEVICE))
    moved = unit.at(np.random.default_rng(seed).uniform(-LARGEST_OFF, LARGEST_OFF, len(unit.uncertain))).device
    return {item.path: reduce(getattr, item.path.split("."), moved) for item in unit.uncertain}


def held(effect: str, diagnosis: Diagnosis) -> list[bool]:
    """Of every number given for the effect: does its interval hold what was switched on?"""
    truth = {p.name: TIMES_TYPICAL.get(effect, USUAL) * p.typical if p.strength else p.usual for p in effects.find(effect).parameters}
    numbers = [p for e in diagnosis.effects if e.id == effect for p in e.parameters]
    return [p.interval[0] <= truth[p.name] <= p.interval[1] for p in numbers if p.name in truth]


def judged(case: Case) -> dict[str, object]:
    """The case's fields, and what came of it."""
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.h5"
        chosen = [effects.typical(case.effect, TIMES_TYPICAL.get(case.effect, USUAL))] if case.effect else []
        planned = protocols.scenario(case.protocol, device=DEVICE, loop=case.loop, seed=case.seed)
        if case.units:
            planned = planned.changed({"plant.override": drawn(case.seed)})
        simulate(scenario.prepare(planned), path, effects=chosen)
        made = time.process_time()
        found = twin_engine.examine(path, without=frozenset([case.effect] if case.without else []))
        against = nats_against(found, scenario.prepare(planned), chosen) if case.without else None
    assert found is not None
    diagnosis = found.verdict.diagnosis
    where = diagnosis.where[0] if diagnosis.where else None
    return {**asdict(case), "verdict": diagnosis.verdict, "named": [e.id for e in diagnosis.effects], "confident": [e.id for e in diagnosis.effects if e.confidence >= SURE],
            "alternatives": diagnosis.alternatives, "stage": where.stage if where else None, "removed": diagnosis.shrink.all.fraction,
            "held": held(case.effect, diagnosis) if case.effect else [], "against": against, "next": diagnosis.next_experiment.run if diagnosis.next_experiment else None,
            "making_s": made - begun, "diagnosis_s": time.process_time() - made}


def nats_against(found: Examined, truth: Run, effect: list[Setting]) -> float | None:
    """What the recording holds, noise aside, against the explanation that was blamed: the least that it leaves of what the effect does, everything uncertain
    and its own parameters moving along. None: nothing was blamed for what the means show."""
    analysis, blamed = found.analysis, found.verdict.outcome.chosen
    if blamed is None or found.verdict.outcome.verdict != "attributed":
        return None
    bench, pick, places = analysis.bench, analysis.pick, list(analysis.responses.nuisances)
    left = (bench.run(effect, truth=truth.truth) - bench.nominal)[pick] - blamed.response
    spread = np.array([u.spread for u in blamed.unknowns])
    off = (blamed.values - np.array([u.middle for u in blamed.unknowns])) / spread
    columns = np.concatenate([analysis.responses.values[places][:, pick, :], blamed.jacobian * spread[:, None, None]])
    table = products(analysis.system, analysis.system.whiten(columns), np.concatenate([analysis.responses.centre, off]), analysis.system.whiten(left))
    best, _ = posterior_mean(table.pooled(np.ones(len(pick))), list(range(table.count)))
    return 0.5 * float(np.sum(table.left(best)))


def sets_of(row: dict) -> list[list[str]]:
    return [row["named"]] if row["verdict"] == "attributed" else row["alternatives"] if row["verdict"] == "ambiguous" else []


def counted(rows: list[dict]) -> list[str]:
    healthy, with_effect = [r for r in rows if not r["effect"]], [r for r in rows if r["effect"]]
    seen = [r for r in with_effect if r["verdict"] != "no_gap"]
    removed = [r["removed"] for r in seen if r["effect"] in r["named"] and r["removed"] is not None]
    numbers = [inside for r in seen if r["verdict"] == "attributed" for inside in r["held"]]
    lines = [_share("healthy: no_gap", [r["verdict"] == "no_gap" for r in healthy])]
    if any(r["without"] for r in rows):
        blamed = [r["verdict"] == "attributed" and bool(r["confident"]) for r in with_effect]
        twins = [r["against"] is not None and r["against"] < TWINS for r in with_effect]
        lines += [_share("withheld: nothing blamed with confidence", [not b for b in blamed]),
                  _share("the same, true twins excepted", [not b for b, twin in zip(blamed, twins, strict=True) if not twin]),
                  _share("unknown, and nothing wrong named beside it with confidence", [not r["confident"] for r in with_effect if r["verdict"] == "unknown"])]
    else:
        lines += [_share("truth in a named set", [any(r["effect"] in ids for ids in sets_of(r)) for r in with_effect]),
                  _share("alone and right", [r["verdict"] == "attributed" and r["named"] == [r["effect"]] for r in with_effect]),
                  _share("unique and wrong", [r["verdict"] == "attributed" and set(r["named"]) != {r["effect"]} for r in with_effect]),
                  _share("unknown", [r["verdict"] == "unknown" for r in with_effect]), _share("no gap seen", [r["verdict"] == "no_gap" for r in with_effect]),
                  _share("right stage, where a place is named", [r["stage"] == effects.find(r["effect"]).stage for r in seen if r["stage"]]),
                  _share("intervals that hold the truth", numbers)]
    lines.append(f"held-out gap removed, median: {np.median(removed):.4f} of {len(removed)}" if removed else "")
    spent = [r["diagnosis_s"] for r in rows]
    return [*[line for line in lines if line], f"processor time of a diagnosis: median {np.median(spent):.1f} s, largest {max(spent):.1f} s"]


def _share(what: str, good: list[bool]) -> str:
    if not good:
        return ""
    share = Share(sum(good), len(good))
    return f"{what}: {share.k} of {share.n} = {share.k / share.n:.3f}, 95 % {share.interval[0]:.3f} to {share.interval[1]:.3f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=66, help="with an effect; the catalogue has 33, in two loops")
    parser.add_argument("--healthy", type=int, default=0, help="so many healthy ones instead")
    parser.add_argument("--protocol", default="full")
    parser.add_argument("--without", action="store_true")
    parser.add_argument("--units", action="store_true")
    parser.add_argument("--seed", type=int, default=7, help="of the order and of the noise")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--results", type=Path, required=True)
    args = parser.parse_args()
    rows = [json.loads(line) for line in args.results.read_text().splitlines()] if args.results.exists() else []
    done = {Case(**{name: row[name] for name in Case.__dataclass_fields__}) for row in rows}
    with ProcessPoolExecutor(args.workers) as pool, args.results.open("a") as results:
        for row in pool.map(judged, [case for case in cases(args) if case not in done]):
            rows.append(row)
            print(json.dumps(row), file=results, flush=True)
            print(f"{len(rows):3d} {row['loop']:9s} {row['effect'] or 'healthy':26s} seed {row['seed']}: {row['verdict']} {row['named'] or row['alternatives'] or ''} "
                  f"removed {row['removed']} {row['diagnosis_s']:.0f} s", flush=True)
    print("\n".join(counted(rows)))


if __name__ == "__main__":
    main()
