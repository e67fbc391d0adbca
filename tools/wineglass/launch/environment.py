"""The Python environment .venv: exactly the packages of requirements.lock, every file checked against its hash."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from pathlib import Path

from wineglass.launch.notice import Notice, SetupError, must_run, run_logged
from wineglass.launch.pythons import find_python


def python_of(root: Path) -> Path:
    return root / ".venv" / "bin" / "python"


def is_ready(root: Path) -> bool:
    """Complete, made from this lock, and its base interpreter still the same."""
    try:
        return _stamp(root).read_text(encoding="utf-8") == _wanted_stamp(root)
    except OSError:
        return False


def make(root: Path, notice: Notice) -> None:
    """Makes or refreshes the environment. The stamp goes first and comes last: an interruption leaves none."""
    log = root / "build" / "setup-python.log"
    folder = root / ".venv"
    complete = _stamp(root).is_file() and _same_interpreter(root)
    _stamp(root).unlink(missing_ok=True)
    if not complete:
        notice.say("making the Python environment .venv")
        shutil.rmtree(folder, ignore_errors=True)
        python = find_python()
        if python is None:
            raise SetupError("no Python 3.11 or newer with venv was found", 2)
        must_run("making the Python environment", [python, "-m", "venv", str(folder)], log, _clean_variables(root))
    _install(root, notice, log)
    _stamp(root).write_text(_wanted_stamp(root), encoding="utf-8")


def home_is_usable() -> bool:
    home = os.environ.get("HOME", "")
    return os.path.isdir(home) and os.access(home, os.W_OK)


def _install(root: Path, notice: Notice, log: Path) -> None:
    """With uv from the lock (seconds); with pip (a minute) where uv does not work."""
    lock = root / "requirements.lock"
    python = str(python_of(root))
    variables = _clean_variables(root)
    bootstrap = root / "build" / "bootstrap.txt"
    bootstrap.write_text(locked_entry(lock.read_text(encoding="utf-8"), "uv"), encoding="utf-8")
    notice.say("installing the Python packages of requirements.lock")
    pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--require-hashes"]
    if run_logged([*pip, "--no-deps", "-r", str(bootstrap)], log, variables) == 0:
        uv = [python, "-m", "uv", "pip", "install", "--python", python, "--require-hashes", "--no-progress"]
        if run_logged([*uv, "-r", str(lock)], log, variables) == 0:
            return
    notice.say("uv did not do it, trying pip (about a minute)")
    must_run("installing the Python packages", [*pip, "-r", str(lock)], log, variables)


def locked_entry(lock: str, package: str) -> str:
    """The lines of one package in a lock file: its requirement and hashes."""
    entry = re.search(rf"^{re.escape(package)}==[^\n]*(\n +--hash=[^\n]*)+\n", lock, re.MULTILINE)
    if entry is None:
        raise SetupError(f"requirements.lock has no entry for {package}; make it again with tools/lock")
    return entry.group(0)


def _stamp(root: Path) -> Path:
    return root / ".venv" / "complete"


def _wanted_stamp(root: Path) -> str:
    digest = hashlib.sha256((root / "requirements.lock").read_bytes()).hexdigest()
    return f"{digest}\n{_interpreter(root)}\n"


def _same_interpreter(root: Path) -> bool:
    return _stamp(root).read_text(encoding="utf-8").split("\n")[1:2] == [_interpreter(root)]


def _interpreter(root: Path) -> str:
    """The base interpreter's real path: a distribution upgrade changes it and makes the environment useless."""
    python = python_of(root)
    return os.path.realpath(python) if os.access(python, os.X_OK) else "none"


def _clean_variables(root: Path) -> dict[str, str]:
    """The caller's environment without what would send packages elsewhere; caches below build/ without a home."""
    variables = dict(os.environ)
    for name in ("VIRTUAL_ENV", "PYTHONHOME", "PYTHONPATH", "PIP_TARGET", "PIP_PREFIX", "PIP_REQUIREMENT"):
        variables.pop(name, None)
    variables["PIP_USER"] = "0"
    for ours, theirs in (("UV_DEFAULT_INDEX", "PIP_INDEX_URL"), ("UV_FIND_LINKS", "PIP_FIND_LINKS"),
                         ("SSL_CERT_FILE", "PIP_CERT")):
        if theirs in variables:
            variables.setdefault(ours, variables[theirs])
    if not home_is_usable():
        variables.setdefault("UV_CACHE_DIR", str(root / "build" / "cache" / "uv"))
        variables.setdefault("PIP_CACHE_DIR", str(root / "build" / "cache" / "pip"))
    return variables
