"""Which Python the environment is made from: 3.11 or newer, able to make virtual environments."""

from __future__ import annotations

import shutil
import subprocess
import sys

OLDEST = 11  # 3.11
NEWEST = 14

_PROBE = f"import sys, venv, ensurepip; sys.exit(sys.version_info < (3, {OLDEST}))"


def find_python() -> str | None:
    """The running interpreter if it serves, else the oldest one on the path that does."""
    for candidate in [sys.executable, "python3", *(f"python3.{minor}" for minor in range(OLDEST, NEWEST + 1))]:
        path = shutil.which(candidate) if candidate else None
        if path and _serves(path):
            return path
    return None


def _serves(python: str) -> bool:
    return subprocess.run([python, "-c", _PROBE], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                          stderr=subprocess.DEVNULL, check=False).returncode == 0
