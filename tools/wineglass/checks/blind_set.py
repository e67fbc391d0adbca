"""A small sealed set from beginning to end, as a user sits the exam: made, sealed, diagnosed, scored. Run as `python -m wineglass.checks.blind_set`.

Four cases on the protocol `operating`, seed on the command line or the fixed one. Fails when a command fails or a case ends without an answer; a false gap or an
effect named alone and wrongly is printed. A handful of cases says nothing about the scores: those are in docs/BLIND.md."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

from wineglass import cli
from wineglass.blind import scoring

SEED = 20261127  # all its cases with effects are of one kind, so that what tolerances do is found out once
TIERS = ("null_unit", "single", "outside")
CASES = 4
SHOULD_BE_NONE = {"failed": "ended without an answer", "false_gap": "are healthy and were said to have a gap", "unique_and_wrong": "were named alone and wrongly"}


def main(seed: int = SEED) -> int:
    with tempfile.TemporaryDirectory() as scratch:
        folder = str(Path(scratch) / "set")
        chosen = [word for tier in TIERS for word in ("--tier", tier)]
        for command in (["make", "--cases", str(CASES), "--seed", str(seed), "--protocol", "operating", *chosen, folder], ["run", folder], ["score", folder]):
            status = cli.main(["blind", *command])
            if status:
                return status
        return judged(json.loads((Path(folder) / scoring.SCORES).read_text(encoding="utf-8"))["engines"][scoring.MAIN], seed)


def judged(scores: dict, seed: int) -> int:
    """1 when a case has no answer; one line for each score that should be none."""
    every = scores["all"]
    print(f"blind set, seed {seed}: {scores['cases']} cases sealed, diagnosed and scored")
    for name, says in SHOULD_BE_NONE.items():
        if every[name]["k"]:
            print(f"  {every[name]['k']} of {every[name]['n']} cases {says}")
    for one in scores["worst"]:
        print(f"  {one['case']}: {', '.join(one['effects']) or 'healthy'}: {one['verdict']} {one['claims']} {one['error']}")
    return 1 if every["failed"]["k"] else 0


if __name__ == "__main__":
    sys.exit(main(*(int(word) for word in sys.argv[1:2])))
