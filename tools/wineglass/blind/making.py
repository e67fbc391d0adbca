"""An exam is made: every recording and its label, then the seal. An interrupted run goes on where it was."""

from __future__ import annotations

import json
import secrets
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from wineglass.atomic import write_bytes, write_text
from wineglass.blind import allowances, generator, scheduling, sealing, setting
from wineglass.blind.draw import Wishes, draw
from wineglass.blind.choices import DETECTABLE
from wineglass.blind.folders import Folders
from wineglass.blind.generator import allowance
from wineglass.blind.scheduling import Spread
from wineglass.blind.sheet import Sheet
from wineglass.errors import BadInput

PLAN = "plan.json"


def steps(wishes: Wishes, folders: Folders) -> int:
    """How much `make` will have advanced by at its end."""
    sheets = draw(wishes)
    missing = {} if is_sealed(folders) else allowances.missing(unmade(sheets, folders), folders.allowances)
    return len(sheets) + sum(len(allowances.runs_of(sheet)) for sheet in missing.values())


def unmade(sheets: list[Sheet], folders: Folders) -> list[Sheet]:
    """Those whose label is not there yet: it is written after the recording."""
    return [sheet for sheet in sheets if not ((folders.sealed / f"{sheet.name}.json").is_file() and folders.recording(sheet.name).is_file())]


def is_sealed(folders: Folders) -> bool:
    return (folders.recordings / sealing.MANIFEST).is_file()


def make(wishes: Wishes, folders: Folders, spread: Spread, advance: Callable[[int], None] = lambda count: None) -> str:
    """Returns the seal. advance(steps done since the last call)."""
    sheets = draw(wishes)
    for folder in (folders.recordings, folders.sealed):
        folder.mkdir(parents=True, exist_ok=True)
    _keep_plan(wishes, folders)
    if is_sealed(folders):
        advance(len(sheets))
        return sealing.file_digest(folders.recordings / sealing.MANIFEST)
    left = unmade(sheets, folders)
    advance(len(sheets) - len(left))
    allowances.prepare(allowances.missing(left, folders.allowances), spread, advance)
    kept = allowances.places(left, folders.allowances.resolve())
    tasks = [(sheet.name, lambda sheet=sheet: (sheet.label(), str(kept.get(sheet.kind, "")))) for sheet in sorted(left, key=_longest_first)]
    for name, (recording, label) in scheduling.results(made, tasks, spread):
        write_bytes(folders.recording(name), recording)
        write_text(folders.sealed / f"{name}.json", json.dumps({"salt": secrets.token_hex(16), "label": label}) + "\n")
        advance(1)
    envelopes = {sheet.name: json.loads((folders.sealed / f"{sheet.name}.json").read_text(encoding="utf-8")) for sheet in sheets}
    return sealing.seal(folders.recordings, folders.sealed, envelopes)


def _longest_first(sheet: Sheet) -> tuple[int, bool]:
    """So that no process is left with a long case at the end."""
    return -len(sheet.effects), sheet.protocol != "full"


def made(label: dict[str, Any], kept: str) -> tuple[bytes, dict[str, Any]]:
    """One case, in whatever process: the recording's bytes, and the label with what the oracle says of it. kept: folder of its kind's allowance."""
    begin, sheet = time.process_time(), Sheet.model_validate(label)
    case, block = sheet.case(), sheet.block()
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "case.h5"
        done = generator.make(case, path, block)
        grade = graded(sheet, case, kept) if sheet.effects else {"snr": 0.0, "channel": "", "channels": {}, "effects": []}
        return path.read_bytes(), {"sheet": label, "grade": grade, "clipped_codes": done.clipped_codes, "unit": done.truth,
                                   "cpu_s": round(time.process_time() - begin, 3)}


def graded(sheet: Sheet, case: generator.Case, kept: str) -> dict[str, Any]:
    """What is seen of all effects together beyond tolerances, and of each beside those before it."""
    allowed = allowances.of_kind(kept, sheet.healthy().model_dump_json())
    total, each = allowance.graded(case, setting.calibration_block, allowed)
    return {**total.label(), "effects": [{"snr": one.snr, "channel": one.channel, "detectable": one.snr >= DETECTABLE} for one in each]}


def _keep_plan(wishes: Wishes, folders: Folders) -> None:
    """A folder holds one set."""
    path, wanted = folders.sealed / PLAN, json.loads(json.dumps(asdict(wishes)))
    if not path.is_file():
        if any(folders.recordings.iterdir()):
            raise BadInput("holds recordings of another set", folders.recordings, "choose another folder")
        write_text(path, json.dumps(wanted, indent=1) + "\n")
    elif json.loads(path.read_text(encoding="utf-8")) != wanted:
        raise BadInput("holds another set", folders.root, "give the same cases, seed and choices to go on with it, or choose another folder")
