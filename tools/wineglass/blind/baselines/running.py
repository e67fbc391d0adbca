"""The baselines sit the exam: features of every recording, what was learned from the training set, answers in the diagnosis' format."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from wineglass.atomic import atomic_path, write_text
from wineglass.blind import results, running, scheduling, sealing
from wineglass.blind.baselines import engines, features, training
from wineglass.blind.baselines.engines import NONE, OTHER, Found
from wineglass.blind.folders import Folders
from wineglass.blind.scheduling import Spread
from wineglass.blind.sheet import Sheet
from wineglass.diagnosis.vocabulary import stage_of
from wineglass.errors import BadInput

TABLE = "features.npz"
SURE = 0.5  # an explanation with this weight stands alone; below, all within a third of the best are named


def run(folders: Folders, taught_by: Folders, spread: Spread, advance: Callable[[int], None] = lambda count: None) -> list[str]:
    """Writes answers of every baseline; returns their names. taught_by: a set with open labels, of another seed."""
    labels = sealing.opened(taught_by.recordings, taught_by.sealed)
    sheets = [Sheet.model_validate(labels[name]["sheet"]) for name in sorted(labels)]
    learned = training.learn(table(taught_by, spread, advance), sheets)
    rows, digests = table(folders, spread, advance), sealing.check_recordings(folders.recordings)
    _need_apart(sealing.manifest(taught_by.recordings), digests, taught_by)
    groups = _groups(folders, learned)
    state = running.code_state()
    answerers = engines.baselines(learned)
    for name, baseline in answerers.items():
        target = folders.results(name)
        target.mkdir(parents=True, exist_ok=True)
        for case, row in zip(sorted(digests), rows, strict=True):
            begin, group = time.process_time(), learned.group(groups[case])
            found = baseline(group.white(row), group)
            entry = {"case": case, "engine": name, "recording": digests[case]["recording"], **state, "gap_statistic": found.gap,
                     "diagnosis": _diagnosis(found), "elapsed_s": 0.0, "cpu_s": time.process_time() - begin, "machine": ""}
            write_text(target / f"{case}.json", json.dumps(entry, indent=1, allow_nan=False) + "\n")
        results.write(target, sorted(digests))
    return list(answerers)


def table(folders: Folders, spread: Spread, advance: Callable[[int], None]) -> np.ndarray:
    """(cases, features) in the order of names; kept beside the recordings' results."""
    digests = sealing.check_recordings(folders.recordings)
    path = folders.root / TABLE
    seal = sealing.file_digest(folders.recordings / sealing.MANIFEST)
    if path.is_file():
        with np.load(path) as kept:
            if str(kept["seal"]) == seal and kept["rows"].shape == (len(digests), len(features.NAMES)):
                advance(len(digests))
                return kept["rows"]
    found = {}
    tasks = [(name, lambda name=name: (folders.recording(name).read_bytes(),)) for name in digests]
    for name, row in scheduling.results(features.of_bytes, tasks, spread):
        found[name] = row
        advance(1)
    rows = np.array([found[name] for name in sorted(digests)])
    with atomic_path(path) as temporary:
        np.savez(temporary, rows=rows, seal=seal)
    return rows


def _need_apart(taught_by: dict[str, dict[str, str]], asked: dict[str, dict[str, str]], folders: Folders) -> None:
    """What is asked must not have been taught."""
    shared = {one["recording"] for one in taught_by.values()} & {one["recording"] for one in asked.values()}
    if shared:
        raise BadInput(f"shares {len(shared)} recordings with the exam", folders.root, "make a set with another seed to learn from")


def _groups(folders: Folders, learned: training.Training) -> dict[str, str]:
    """Device, protocol and loop as the recording itself says them."""
    from wineglass.recording import Recording

    found = {}
    for name in sealing.manifest(folders.recordings):
        with Recording.open(folders.recording(name), tolerant=True) as recording:
            scenario = next((json.loads(event.value) for event in recording.events if event.kind == "scenario"), {})
        loop = scenario.get("mode", {}).get("loop", "open")
        found[name] = f"{scenario.get('device', '')} {scenario.get('name', '')} {loop}"
    return found


def _diagnosis(found: Found) -> dict[str, Any]:
    """As if there were a gap; whether there is one is decided at scoring, at the diagnosis' own rate of false gaps."""
    ranked = sorted(found.weights.items(), key=lambda item: -item[1])
    best, weight = ranked[0]
    near = [best] if weight >= SURE else [ids for ids, value in ranked if value > weight / 3.0]
    verdict = "unknown" if best == OTHER else "attributed" if len(near) == 1 else "ambiguous"
    named = best - OTHER if verdict != "ambiguous" else frozenset()
    return {
        "verdict": verdict, "sentence": "", "hypotheses": _hypotheses(found), "effects": [{"id": id, "parameters": []} for id in sorted(named)],
        "alternatives": [sorted(ids) for ids in near] if verdict == "ambiguous" else [],
        "where": [{"stage": stage_of(sorted(best)[0]), "share": 1.0}] if best != OTHER else [],
        "shrink": {"all": {"before": None, "after": None, "floor": None, "fraction": None}},
    }


def _hypotheses(found: Found) -> list[dict[str, Any]]:
    weights = {NONE: 0.0, OTHER: 0.0, **found.weights}
    return [{"ids": sorted(ids), "probability": value} for ids, value in weights.items()]
