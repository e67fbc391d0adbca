"""Everything that must hold before a change is accepted, in the order in which it runs.

A step is a list of commands, run from the root one after the other until one fails. `{junit}` in a command is the file
to which that program writes its test results; a step without one counts as a single test.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

from wineglass.paths import repository_root

ROOT = repository_root()
PYTHON = sys.executable


@dataclass(frozen=True)
class Step:
    name: str
    what: str
    commands: tuple[tuple[str, ...], ...]
    preset: str | None = None  # the build folder that the step uses
    tool: str | None = None  # optional program; without it the step is skipped
    needs: str | None = None  # path in the tree without which there is nothing to check


def _cmake(name: str, what: str, tool: str | None = None) -> Step:
    """Configure, build with warnings as errors, run every C test of one preset."""
    jobs = str(os.cpu_count() or 1)
    return Step(name, what, preset=name, tool=tool, commands=(
        ("cmake", "--preset", name),
        ("cmake", "--build", "--preset", name, "--parallel", jobs),
        ("ctest", "--preset", name, "--parallel", jobs, "--output-junit", "{junit}"),
    ))


def _pytest(name: str, what: str, folder: str, *options: str, first: tuple[tuple[str, ...], ...] = ()) -> Step:
    command = (PYTHON, "-P", "-m", "pytest", "-q", *options, "--junit-xml={junit}", folder)
    return Step(name, what, (*first, command), needs=folder)


TWIN_LIBRARY = (PYTHON, "-P", "-m", "wineglass.checks.twin_library")


STEPS: tuple[Step, ...] = (
    _pytest("structure", "include directions, lock file, version numbers, launcher", "tests/structure"),
    _cmake("host", "C tests, -O2, gcc"),
    _cmake("release-test", "C tests, -O3 with link-time optimisation"),
    _cmake("sanitize", "C tests under address and undefined-behaviour sanitizers"),
    _cmake("clang", "C tests, second compiler", tool="clang"),
    _pytest("python", "Python tools", "tests/python", "-n", "2", first=(TWIN_LIBRARY,)),
    Step("golden", "golden traces are what the code produces", (
        TWIN_LIBRARY,
        (PYTHON, "-P", str(ROOT / "tests/golden/regenerate.py")),
        ("git", "diff", "--exit-code", "--stat", "--", "tests/golden"),
        ("sh", "-c", 'test -z "$(git status --porcelain -- tests/golden)"'),
    ), needs="tests/golden/regenerate.py"),
    Step("cppcheck", "static analysis of the C code", (
        ("cppcheck", "--quiet", "--std=c11", "--error-exitcode=1", "--inline-suppr",
         "--enable=warning,performance,portability", "--suppress=missingIncludeSystem", "--suppress=normalCheckLevelMaxBranches",
         "--suppress=shiftNegativeLHS",  # arithmetic shift, asserted at compile time in firmware/core/fixed.h
         "--suppress=shiftTooManyBitsSigned",  # the same
         "--suppress=comparePointers:hal/*/startup.c",  # begin and end of one section, named by the linker script
         "--suppress=syntaxError:hal/*/semihosting.c",  # register variables bound by the compiler's own syntax
         "-I", ".", "-I", "firmware", "-j", "2", "firmware", "hal", "sim"),
    ), tool="cppcheck"),
)

# Programs that only the tests use, and the Debian packages that hold them.
TEST_PACKAGES = {"clang": "clang", "cppcheck": "cppcheck"}


def missing_need(step: Step, root: Path = ROOT) -> bool:
    return step.needs is not None and not (root / step.needs).exists()
