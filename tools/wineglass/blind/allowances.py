"""What tolerances may do to recordings of each kind in an exam: found once, kept in a folder, used for every case of the kind."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

from wineglass.blind import scheduling, setting
from wineglass.blind.generator import allowance
from wineglass.blind.generator.allowance import Allowance, Runs
from wineglass.blind.generator.oracle import Measured
from wineglass.blind.scheduling import Spread
from wineglass.blind.sheet import Sheet

QUIET, NOISY = "quiet", "noisy"


def kinds(sheets: Iterable[Sheet], folder: Path) -> dict[str, Sheet]:
    """Of cases with effects, those that are not in the folder yet, each with its healthy sheet."""
    found = {sheet.kind: sheet.healthy() for sheet in sheets if sheet.effects}
    return {name: sheet for name, sheet in sorted(found.items()) if not (folder / name).is_dir()}


def runs_of(sheet: Sheet) -> list[tuple[str, bool, dict[str, Any], float]]:
    """Name, quiet, fields and how far in standard deviations, of everything that has to be run for a kind."""
    case = sheet.case()
    moved = [(one.name, True, one.fields, one.by) for one in allowance.moved(case)]
    return [(QUIET, True, {}, 0.0), (NOISY, False, {}, 0.0), *moved, *((one.name, False, one.fields, one.by) for one in allowance.louder(case))]


def prepare(sheets: dict[str, Sheet], folder: Path, spread: Spread, advance: Callable[[int], None] = lambda count: None) -> None:
    """Runs and keeps what is missing."""
    for name, sheet in sheets.items():
        wanted = {one[0]: one for one in runs_of(sheet)}
        tasks = [(key, lambda one=one: (sheet.label(), one[1], one[2])) for key, one in wanted.items()]
        found = {}
        for key, seen in scheduling.results(measured, tasks, spread):
            found[key] = seen
            advance(1)
        _keep(_gathered(wanted, found), folder, name)


def measured(label: dict[str, Any], quiet: bool, fields: dict[str, Any]) -> Measured:
    """One run, in whatever process."""
    return allowance.run(allowance.alike(Sheet.model_validate(label).case(), quiet, fields), setting.calibration_block)


def _gathered(wanted: dict[str, Any], found: dict[str, Measured]) -> Allowance:
    plain = Runs(found[QUIET], found[NOISY])
    moves = {key: (by, Runs(found[key]) if quiet else Runs(plain.quiet, found[key])) for key, quiet, _, by in wanted.values() if by}
    return allowance.gathered(plain, moves)


def _keep(found: Allowance, folder: Path, name: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".making") as scratch:
        half = Path(scratch) / name
        half.mkdir()
        allowance.save(found, half)
        if not (folder / name).is_dir():
            shutil.move(str(half), folder / name)


@lru_cache(maxsize=12)
def of_kind(folder: str, name: str, healthy: str) -> Allowance:
    """From the folder; a process that does not see it finds out for itself. healthy: the sheet of the kind as JSON."""
    path = Path(folder) / name
    if path.is_dir():
        return allowance.load(path)
    sheet = Sheet.model_validate_json(healthy)
    wanted = {one[0]: one for one in runs_of(sheet)}
    return _gathered(wanted, {key: measured(sheet.label(), quiet, fields) for key, quiet, fields, _ in wanted.values()})
