"""Flash, memory, stack and library needs of the core without an application, from its linked image."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass

from wineglass import paths
from wineglass.cost import stack
from wineglass.emulation.machines import M4, Machine

PROGRAM = "wineglass_footprint"
_ENTRY = "footprint"
_DIVISION = re.compile(r"^__(aeabi_)?(u?l?div|u?idiv|u?div|u?mod)\w*$")
_FLOATING = re.compile(r"^__aeabi_[fd]\w+$")


@dataclass(frozen=True)
class Footprint:
    flash_bytes: int
    """code and tables"""
    memory_bytes: int
    """configuration and state of one gyro"""
    stack_bytes: int
    stack_path: tuple[str, ...]
    library_functions: tuple[str, ...]
    """functions of the compiler's and the C library that the core needs"""

    @property
    def forbidden(self) -> list[str]:
        """Software division and floating point."""
        return forbidden(self.library_functions)


def forbidden(names: Iterable[str]) -> list[str]:
    """Software division and floating point among functions."""
    return sorted(name for name in names if _DIVISION.match(name) or _FLOATING.match(name))


def measure(machine: Machine = M4) -> Footprint:
    program = machine.program(PROGRAM)
    graph = stack.read((paths.build_folder(machine.preset) / "firmware").rglob("wineglass_core.dir/**/*.ci"))
    own = graph.names
    stack.add_library_frames(graph, program)
    worst = stack.worst(graph, "gyro_step")
    rows = [line.split() for line in _output("arm-none-eabi-nm", "-S", str(program)).splitlines()]
    functions = {row[-1] for row in rows if row[-2] in "tT"}
    entry_bytes = next(int(row[1], 16) for row in rows if row[-1] == _ENTRY)
    text, data, bss = map(int, _output("arm-none-eabi-size", str(program)).splitlines()[1].split()[:3])
    return Footprint(text + data - entry_bytes, data + bss, worst.bytes, worst.path, tuple(sorted(functions - own - {_ENTRY})))


def _output(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout
