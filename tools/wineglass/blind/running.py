"""An exam is sat: every recording to an engine, every answer kept as it comes. An interrupted run goes on where it was.

The workers get the bytes of one recording each and no path of the set, so labels are out of their reach; nothing here opens the sealed folder."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from wineglass import paths
from wineglass.atomic import write_text
from wineglass.blind import engines, results, scheduling, sealing
from wineglass.blind.folders import Folders
from wineglass.blind.scheduling import Spread


def run(folders: Folders, engine: str, spread: Spread, advance: Callable[[int], None] = lambda count: None,
        work: Callable[[str, bytes], dict[str, Any]] = engines.answer) -> Path:
    """Returns the table of results. work: what a task does with the engine's name and a recording's bytes."""
    folders.need_root()
    cases = sealing.check_recordings(folders.recordings)
    target = folders.results(engine)
    target.mkdir(parents=True, exist_ok=True)
    left = unanswered(folders, engine, cases)
    advance(len(cases) - len(left))
    state = code_state()
    tasks = [(name, lambda name=name: (engine, folders.recording(name).read_bytes())) for name in left]
    for name, found in scheduling.results(work, tasks, spread):
        entry = {"case": name, "engine": engine, "recording": cases[name]["recording"], **state, **found}
        write_text(target / f"{name}.json", json.dumps(entry, indent=1, allow_nan=False) + "\n")
        advance(1)
    return results.write(target, sorted(cases))


def unanswered(folders: Folders, engine: str, cases: dict[str, dict[str, str]]) -> list[str]:
    """cases: of the manifest"""
    return [name for name in cases if not _is_answered(folders.results(engine) / f"{name}.json", cases[name]["recording"])]


def code_state() -> dict[str, str]:
    """Commit (with a plus where files differ from it) and time."""
    return {"commit": _commit(), "date": datetime.now(timezone.utc).isoformat(timespec="seconds")}


def _commit() -> str:
    root = paths.repository_root()
    try:
        head = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=root, capture_output=True, text=True, check=True).stdout.strip()
        changed = subprocess.run(["git", "status", "--porcelain", "--untracked-files=no"], cwd=root, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return head + ("+" if changed.strip() else "")


def _is_answered(path: Path, recording: str) -> bool:
    """An answer to this very recording; errors are asked again."""
    try:
        entry = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return entry.get("recording") == recording and "diagnosis" in entry
