"""What the set-up says while it works, and how it runs other programs."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

LOG_TAIL_LINES = 15


class SetupError(Exception):
    """The set-up cannot go on; the text says what to do. May have more than one line (the tail of a log)."""

    def __init__(self, text: str, exit_status: int = 1) -> None:
        super().__init__(text)
        self.exit_status = exit_status


class Notice:
    """Progress lines on stderr."""

    def __init__(self, quiet: bool = False) -> None:
        self.quiet = quiet
        self._start = time.monotonic()

    def say(self, text: str) -> None:
        if not self.quiet:
            print(f"wineglass: [{time.monotonic() - self._start:5.1f} s] {text}", file=sys.stderr, flush=True)


def run_logged(command: list[str], log: Path, variables: dict[str, str] | None = None, cwd: Path | None = None) -> int:
    """Runs a program with all its output in `log`; returns its exit status."""
    log.parent.mkdir(parents=True, exist_ok=True)
    with open(log, "ab") as stream:
        stream.write(f"\n$ {' '.join(command)}\n".encode())
        stream.flush()
        try:
            return subprocess.run(command, stdin=subprocess.DEVNULL, stdout=stream, stderr=subprocess.STDOUT,
                                  env=variables, cwd=cwd, close_fds=False, check=False).returncode
        except OSError as error:
            stream.write(f"{error}\n".encode())
            return 127


def must_run(what: str, command: list[str], log: Path, variables: dict[str, str] | None = None,
             cwd: Path | None = None) -> None:
    if run_logged(command, log, variables, cwd) != 0:
        raise SetupError(f"{what} failed; the end of {log}:\n{tail(log)}")


def tail(log: Path, lines: int = LOG_TAIL_LINES) -> str:
    text = log.read_text(encoding="utf-8", errors="replace").splitlines()
    return "\n".join(f"  {line}" for line in text[-lines:])
