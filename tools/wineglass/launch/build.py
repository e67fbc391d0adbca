"""The compiled library: the release preset, built again when a source, a header or a build file has changed."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from pathlib import Path

from wineglass.launch.notice import Notice, must_run

PRESET = "release"
INPUTS = ("CMakeLists.txt", "CMakePresets.json", "cmake", "exam", "firmware", "hal", "sim")


def is_fresh(root: Path) -> bool:
    try:
        return _stamp(root).read_text(encoding="ascii") == _fingerprint(root)
    except OSError:
        return False


def make(root: Path, notice: Notice) -> None:
    notice.say("building the C library (preset release)")
    fingerprint = _fingerprint(root)  # taken first: an edit during the build makes the next run build again
    _stamp(root).unlink(missing_ok=True)
    log = root / "build" / "setup-build.log"
    variables = prepare(root, PRESET)
    must_run("configuring the build", ["cmake", "--preset", PRESET], log, variables, root)
    must_run("building the C library", ["cmake", "--build", "--preset", PRESET, "--parallel", str(jobs())], log,
             variables, root)
    _stamp(root).write_text(fingerprint, encoding="ascii")


def prepare(root: Path, preset: str) -> dict[str, str]:
    """Variables for cmake; drops a build folder that was configured for a working tree that has since moved."""
    folder = root / "build" / preset
    cache = folder / "CMakeCache.txt"
    variables = dict(os.environ)
    if cache.is_file():
        home = re.search(r"^CMAKE_HOME_DIRECTORY:INTERNAL=(.*)$", cache.read_text(encoding="utf-8"), re.MULTILINE)
        if home is None or Path(home.group(1)) != root:
            shutil.rmtree(folder)
    if not cache.is_file() and shutil.which("ninja"):
        variables.setdefault("CMAKE_GENERATOR", "Ninja")
    return variables


def jobs() -> int:
    return max(1, os.cpu_count() or 1)


def _stamp(root: Path) -> Path:
    return root / "build" / PRESET / "complete"


def _fingerprint(root: Path) -> str:
    """Changes with the name, size or time of any input, and with the place of the tree."""
    digest = hashlib.sha256(str(root).encode())
    for path in _input_files(root):
        status = path.stat()
        digest.update(f"{path}\0{status.st_size}\0{status.st_mtime_ns}\n".encode())
    return digest.hexdigest()


def _input_files(root: Path) -> list[Path]:
    files = []
    for name in INPUTS:
        path = root / name
        files += [path] if path.is_file() else [item for item in path.rglob("*") if item.is_file()]
    return sorted(files)
