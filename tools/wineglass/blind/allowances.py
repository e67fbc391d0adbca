"""What tolerances may do to recordings of each kind in an exam: found once, kept in a folder, used for every case of the kind."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Callable, Iterable
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from wineglass.blind import generator, scheduling, setting
from wineglass.blind.generator import allowance, native
from wineglass.blind.generator.allowance import Allowance, Runs
from wineglass.blind.generator.oracle import Measured
from wineglass.blind.scheduling import Spread
from wineglass.blind.sheet import Sheet

QUIET, NOISY = "quiet", "noisy"


def place(sheet: Sheet, folder: Path) -> Path:
    """Where the allowance of the case's kind stands. Named after all that goes into it, so that what is shared is never that of another device or program."""
    healthy = sheet.healthy()
    case = healthy.case()
    parts = (case.scenario.model_dump_json(), allowance.describe(case).to_toml(), healthy.block().hex(), _program())
    return folder / f"{sheet.kind}_{hashlib.sha256(' '.join(parts).encode()).hexdigest()[:12]}"


@cache
def _program() -> str:
    """Of the generator and of its library, with the firmware in it."""
    files = [*sorted(Path(generator.__file__).parent.rglob("*.py")), native.library_path()]
    return " ".join(hashlib.sha256(path.read_bytes()).hexdigest() for path in files)


def places(sheets: Iterable[Sheet], folder: Path) -> dict[str, Path]:
    """Of all kinds of cases with effects."""
    one_each = {sheet.kind: sheet for sheet in sheets if sheet.effects}
    return {name: place(sheet, folder) for name, sheet in sorted(one_each.items())}


def missing(sheets: Iterable[Sheet], folder: Path) -> dict[Path, Sheet]:
    """What is not in the folder yet, each with its healthy sheet."""
    healthy = {sheet.kind: sheet.healthy() for sheet in sheets if sheet.effects}
    return {path: healthy[name] for name, path in places(sheets, folder).items() if not path.is_dir()}


def runs_of(sheet: Sheet) -> list[tuple[str, bool, dict[str, Any], float]]:
    """Name, quiet, fields and how far in standard deviations, of everything that has to be run for a kind."""
    case = sheet.case()
    moved = [(one.name, True, one.fields, one.by) for one in allowance.moved(case)]
    return [(QUIET, True, {}, 0.0), (NOISY, False, {}, 0.0), *moved, *((one.name, False, one.fields, one.by) for one in allowance.louder(case))]


def prepare(sheets: dict[Path, Sheet], spread: Spread, advance: Callable[[int], None] = lambda count: None) -> None:
    """Runs and keeps what is missing, a kind as soon as its last run has ended."""
    wanted = {path: {one[0]: one for one in runs_of(sheet)} for path, sheet in sheets.items()}
    found: dict[Path, dict[str, Measured]] = {path: {} for path in sheets}
    tasks = [((path, key), lambda path=path, one=one: (sheets[path].label(), one[1], one[2])) for path in sheets for key, one in wanted[path].items()]
    for (path, key), seen in scheduling.results(measured, tasks, spread) if tasks else ():
        found[path][key] = seen
        advance(1)
        if len(found[path]) == len(wanted[path]):
            _keep(_gathered(wanted[path], found.pop(path)), path)


def measured(label: dict[str, Any], quiet: bool, fields: dict[str, Any]) -> Measured:
    """One run, in whatever process."""
    return allowance.run(allowance.alike(Sheet.model_validate(label).case(), quiet, fields), setting.calibration_block)


def _gathered(wanted: dict[str, Any], found: dict[str, Measured]) -> Allowance:
    plain = Runs(found[QUIET], found[NOISY])
    moves = {key: (by, Runs(found[key]) if quiet else Runs(plain.quiet, found[key])) for key, quiet, _, by in wanted.values() if by}
    return allowance.gathered(plain, moves)


def _keep(found: Allowance, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".making") as scratch:
        half = Path(scratch) / path.name
        half.mkdir()
        allowance.save(found, half)
        if not path.is_dir():
            shutil.move(str(half), path)


@lru_cache(maxsize=12)
def of_kind(folder: str, healthy: str) -> Allowance:
    """From its own folder; a process that does not see it finds out for itself. healthy: the sheet of the kind as JSON."""
    path = Path(folder)
    if path.is_dir():
        return allowance.load(path)
    sheet = Sheet.model_validate_json(healthy)
    wanted = {one[0]: one for one in runs_of(sheet)}
    return _gathered(wanted, {key: measured(sheet.label(), quiet, fields) for key, quiet, fields, _ in wanted.values()})
