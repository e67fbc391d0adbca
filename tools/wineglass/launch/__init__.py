"""From a fresh clone to a running command. Standard library of Python 3.9 only.

Three things have to be there: system packages, the Python environment of the lock, the compiled twin library. Each of
the last two leaves a stamp when it is complete, so that a run with nothing to do only compares two stamps. Whatever is
interrupted leaves no stamp and is done again. A file lock lets one process at a time do the work.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from wineglass import cli
from wineglass.launch import build, environment, system_packages
from wineglass.launch.notice import Notice, SetupError
from wineglass.launch.single import only_one

ROOT = Path(__file__).resolve().parents[3]


def main(argv: list[str]) -> int:
    """Never returns when the command runs: the process becomes the tools' own Python."""
    request = cli.split(argv)
    if cli.is_bare(request):
        return cli.main(argv)
    notice = Notice(quiet=request.wants("quiet"))
    try:
        _prepare(notice, wants_build=cli.needs_build(request))
    except SetupError as error:
        print(f"wineglass: error: {error}", file=sys.stderr)
        return error.exit_status
    except KeyboardInterrupt:
        print("\nwineglass: interrupted during set-up; the next run continues", file=sys.stderr)
        return 130
    _become(argv)
    return 1


def _prepare(notice: Notice, wants_build: bool) -> None:
    if _is_ready(wants_build):
        return
    with only_one(ROOT, notice):
        if _is_ready(wants_build):
            return  # another process has just done it
        system_packages.require(ROOT, notice)
        if not environment.is_ready(ROOT):
            environment.make(ROOT, notice)
        if wants_build and not build.is_fresh(ROOT):
            build.make(ROOT, notice)


def _is_ready(wants_build: bool) -> bool:
    return environment.is_ready(ROOT) and (not wants_build or build.is_fresh(ROOT))


def _become(argv: list[str]) -> None:
    variables = dict(os.environ)
    variables["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT / "tools"), variables.get("PYTHONPATH")]))
    if not environment.home_is_usable():
        variables.setdefault("MPLCONFIGDIR", str(ROOT / "build" / "cache" / "matplotlib"))
    python = str(environment.python_of(ROOT))
    sys.stdout.flush()
    os.execve(python, [python, "-P", "-m", "wineglass", *argv], variables)
