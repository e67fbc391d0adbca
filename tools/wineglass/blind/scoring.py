"""The envelopes are opened and every engine's answers scored."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from wineglass.blind import gating, results, sealing
from wineglass.blind.choices import NULLS
from wineglass.blind.folders import Folders
from wineglass.blind.marks import Mark, mark
from wineglass.blind.scores import score
from wineglass.errors import BadInput

SCORES = "scores.json"
MAIN = "diagnose"


def marked(folders: Folders) -> dict[str, list[Mark]]:
    """Per engine the marks of all cases. BadInput where anything was exchanged since sealing, or an answer is missing."""
    folders.need_root()
    labels = sealing.opened(folders.recordings, folders.sealed)
    digests = sealing.manifest(folders.recordings)
    if not folders.engines:
        raise BadInput("there are no answers yet", folders.root, "run `wineglass blind run` first")
    found: dict[str, list[Mark]] = {}
    for engine in sorted(folders.engines, key=lambda name: name != MAIN):
        answers = results.read(folders.results(engine))
        _check(answers, digests, folders.results(engine))
        if all("gap_statistic" in one for one in answers.values()):
            nulls = {name for name, label in labels.items() if label["sheet"]["tier"] in NULLS}
            answers = gating.gate(answers, nulls, _false_gaps(found.get(MAIN, [])))
        found[engine] = [mark(labels[name], answers[name]) for name in sorted(labels)]
    return found


def _false_gaps(marks: list[Mark]) -> float:
    """Share of nulls with a gap; a hundredth where the diagnosis has not answered."""
    nulls = [one for one in marks if one.null]
    return sum(one.gap for one in nulls) / len(nulls) if nulls else 0.01


def _check(answers: dict[str, dict[str, Any]], digests: dict[str, dict[str, str]], folder: Path) -> None:
    missing = sorted(set(digests) - set(answers))
    if missing:
        raise BadInput(f"{len(missing)} of {len(digests)} cases have no answer, {missing[0]} first", folder, "go on with `wineglass blind run`")
    for name, answer in answers.items():
        if name not in digests or answer["recording"] != digests[name]["recording"]:
            raise BadInput("the answer is to another recording", folder / f"{name}.json", "remove it and run again")


def scores(folders: Folders, marks: dict[str, list[Mark]]) -> dict[str, Any]:
    """What goes into scores.json."""
    plan = folders.sealed / "plan.json"
    return {"format": "wineglass-blind-scores", "version": 1, "seal": sealing.file_digest(folders.recordings / sealing.MANIFEST),
            "plan": json.loads(plan.read_text(encoding="utf-8")) if plan.is_file() else None,
            "answers": {engine: _provenance(folders.results(engine)) for engine in marks},
            "engines": {engine: score(found) for engine, found in marks.items()}}


def main_of(found: dict[str, Any]) -> str:
    """The engine that is examined; the others stand beside it."""
    return MAIN if MAIN in found["engines"] else next(iter(found["engines"]))


def _provenance(folder: Path) -> dict[str, list[str]]:
    """Commits and days of the answers."""
    answers = results.read(folder).values()
    return {"commits": sorted({one["commit"] for one in answers}), "days": sorted({one["date"][:10] for one in answers})}
