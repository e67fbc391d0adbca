"""Everything that must hold before a change is accepted, in the order in which it runs.

A step is a list of commands, run from the root one after the other until one fails. `{junit}` in a command is the file
to which that program writes its test results; a step without one counts as a single test.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from wineglass.emulation.machines import BOARDS, MACHINES, USERS, Machine
from wineglass.paths import repository_root

ROOT = repository_root()
PYTHON = sys.executable


@dataclass(frozen=True)
class Step:
    name: str
    what: str
    commands: tuple[tuple[str, ...], ...]
    preset: str | None = None  # the build folder that the step uses
    tools: tuple[str, ...] = ()  # optional programs; without them the step is skipped
    needs: str | None = None  # path in the tree without which there is nothing to check


def _cmake(name: str, what: str, *tools: str) -> Step:
    """Configure, build with warnings as errors, run every C test of one preset."""
    jobs = str(os.cpu_count() or 1)
    return Step(name, what, preset=name, tools=tools, commands=(
        ("cmake", "--preset", name),
        ("cmake", "--build", "--preset", name, "--parallel", jobs),
        ("ctest", "--preset", name, "--parallel", jobs, "--output-junit", "{junit}"),
    ))


def _pytest(name: str, what: str, folder: str, *options: str, first: tuple[tuple[str, ...], ...] = (),
            tools: tuple[str, ...] = ()) -> Step:
    command = (PYTHON, "-P", "-m", "pytest", "-q", *options, "--junit-xml={junit}", folder)
    return Step(name, what, (*first, command), needs=folder, tools=tools)


TWIN_LIBRARY = (PYTHON, "-P", "-m", "wineglass.checks.twin_library")


def tools_of(*machines: Machine) -> tuple[str, ...]:
    return tuple(dict.fromkeys(tool for machine in machines for tool in machine.tools))


STEPS: tuple[Step, ...] = (
    _pytest("structure", "include directions, lock file, version numbers, launcher", "tests/structure"),
    _cmake("host", "C tests, -O2, gcc"),
    _cmake("release-test", "C tests, -O3 with link-time optimisation"),
    _cmake("sanitize", "C tests under address and undefined-behaviour sanitizers"),
    _cmake("clang", "C tests, second compiler", "clang"),
    _pytest("python", "Python tools", "tests/python", "-n", "2", first=(TWIN_LIBRARY,)),
    Step("blind", "a small set of the blind check: made, sealed, diagnosed, scored", (TWIN_LIBRARY, (PYTHON, "-P", "-m", "wineglass.checks.blind_set"))),
    Step("golden", "golden traces are what the code produces", (
        TWIN_LIBRARY,
        (PYTHON, "-P", str(ROOT / "tests/golden/regenerate.py")),
        ("git", "diff", "--exit-code", "--stat", "--", "tests/golden"),
        ("sh", "-c", 'test -z "$(git status --porcelain -- tests/golden)"'),
    ), needs="tests/golden/regenerate.py"),
    _pytest("boards", "emulated Cortex-M4 and M7: bit for bit the host, processor in the loop, cost; the board's image boots", "tests/target", "-k", "not user-",
            first=(TWIN_LIBRARY,), tools=tools_of(*BOARDS)),
    _pytest("machines", "ARM, RISC-V, big-endian and 32-bit x86 builds: bit for bit the host", "tests/target", "-k", "user-",
            first=(TWIN_LIBRARY,), tools=tools_of(*USERS)),
    Step("cost", "instructions, sizes and stack, beside those of the commit before", (TWIN_LIBRARY, (PYTHON, "-P", "-m", "wineglass", "cost")),
         tools=tools_of(BOARDS[0])),
    Step("fuzz", "every C parser of bytes from outside, 20 s of libFuzzer under both sanitizers",
         ((PYTHON, "-P", "-m", "wineglass", "fuzz", "--seconds", "20"),), tools=("clang",), needs="tests/fuzz"),
    Step("cppcheck", "static analysis of the C code", (
        ("cppcheck", "--quiet", "--std=c11", "--error-exitcode=1", "--inline-suppr",
         "--enable=warning,performance,portability", "--suppress=missingIncludeSystem", "--suppress=normalCheckLevelMaxBranches",
         "--suppress=shiftNegativeLHS",  # arithmetic shift, asserted at compile time in firmware/core/fixed.h
         "--suppress=shiftTooManyBitsSigned",  # the same
         "--suppress=comparePointers:hal/*/startup.c", "--suppress=comparePointers:hal/cortex_m/memory.h",  # begin and end of one section, named by the linker script
         "--suppress=syntaxError:hal/*/semihosting.c",  # register variables bound by the compiler's own syntax
         "-I", ".", "-I", "firmware", "-j", "2", "firmware", "hal", "sim", "exam"),
    ), tools=("cppcheck",)),
)

# Programs that only the tests use, and the Debian packages that hold them.
TEST_PACKAGES: dict[str, tuple[str, ...]] = {
    "clang": ("clang", "libclang-rt-14-dev"), "cppcheck": ("cppcheck",),
    **{tool: machine.packages for machine in MACHINES for tool in machine.tools},
}


def absent_packages(steps: Iterable[Step]) -> list[str]:
    """Packages whose programs the steps use and do not find."""
    tools = [tool for step in steps for tool in step.tools if not shutil.which(tool)]
    return sorted({package for tool in tools for package in TEST_PACKAGES[tool]})


def missing_need(step: Step, root: Path = ROOT) -> bool:
    return step.needs is not None and not (root / step.needs).exists()
