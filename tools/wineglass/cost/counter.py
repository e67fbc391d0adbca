"""Instructions executed by functions of a program on the emulated Cortex-M4, call by call, through a plugin of the emulator."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from wineglass import paths
from wineglass.emulation.machines import M4, PROGRAM, Machine
from wineglass.errors import WineglassError

_SOURCE = "tools/emulation/count_instructions.c"


def plugin() -> Path:
    """The compiled plugin, made again when its source is newer."""
    source = paths.repository_root() / _SOURCE
    made = paths.repository_root() / "build" / "emulation" / "libcount_instructions.so"
    if not made.is_file() or made.stat().st_mtime < source.stat().st_mtime:
        made.parent.mkdir(parents=True, exist_ok=True)
        done = subprocess.run(["cc", "-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-fvisibility=hidden", str(source),
                               "-o", str(made)], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise WineglassError(f"{_SOURCE} does not compile: {done.stderr.strip()[:300]}")
    return made


def symbols(program: Path) -> dict[str, int]:
    """Addresses of the functions of an ARM program, without the Thumb bit."""
    listing = subprocess.run(["arm-none-eabi-nm", str(program)], capture_output=True, text=True, check=True).stdout
    rows = (line.split() for line in listing.splitlines())
    return {row[2]: int(row[0], 16) & ~1 for row in rows if len(row) == 3 and row[1] in "tT"}


class Counter:
    """Emulator options that count, and the counts afterwards. Functions that the program does not have are left out."""

    def __init__(self, functions: Iterable[str], out: Path, name: str = PROGRAM, machine: Machine = M4):
        known = symbols(machine.program(name))
        self.functions = [function for function in functions if function in known]
        self._out = out
        watched = "".join(f",watch={known[function]:#x}" for function in self.functions)
        self.options = ("-plugin", f"{plugin()},out={out}{watched}")

    def counts(self) -> dict[str, np.ndarray]:
        """Instructions of every call, in the order of the calls' ends; uint32 arrays. A function never called has an empty one."""
        records = np.fromfile(self._out, np.uint32).reshape(-1, 2)
        return {function: records[records[:, 0] == index, 1] for index, function in enumerate(self.functions)}
