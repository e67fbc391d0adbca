"""Size and stack bound of a board's whole image: background and interrupts together."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from wineglass import paths
from wineglass.cost import stack
from wineglass.cost.footprint import forbidden
from wineglass.emulation.machines import STM32F405

PROGRAM = "wineglass_stm32f405.elf"
FLASH_BAR_BYTES = 48 * 1024
MEMORY_BAR_BYTES = 16 * 1024

_PORT = paths.repository_root() / "hal" / "stm32f405"
_BACKGROUND = "reset_handler"
_SAMPLES = "converters_handler"
_INTERRUPTS = (_SAMPLES, "usart1_handler", "systick_handler", "fault_handle")  # each on a priority of its own
_EXCEPTION_BYTES = 36  # eight registers and the alignment


@dataclass(frozen=True)
class Image:
    flash_bytes: int
    memory_bytes: int
    """stack included"""
    stack_reserved_bytes: int
    stack_bytes: int
    """bound: the background's deepest path, and on top of it every interrupt at its deepest"""
    paths: tuple[stack.Worst, ...]
    """of the background and of every interrupt"""
    sample_path_forbidden: list[str]
    """software division and floating point within reach of the sample interrupt"""


def program() -> Path:
    return STM32F405.program(PROGRAM)


def measure() -> Image:
    build = paths.build_folder(STM32F405.preset)
    graph = stack.read([*(build / "firmware").rglob("*.ci"), *build.rglob(f"{program().stem}.dir/**/*.ci")])
    stack.add_library_frames(graph, program())
    worst = tuple(stack.worst(graph, name, pointees=_Pointees(graph)) for name in (_BACKGROUND, *_INTERRUPTS))
    bound = sum(item.bytes for item in worst) + _EXCEPTION_BYTES * len(_INTERRUPTS)
    sizes = _section_bytes()
    flash = sum(sizes.get(name, 0) for name in (".text", ".ARM.exidx", ".data", ".seal"))
    memory = sum(sizes.get(name, 0) for name in (".stack", ".noinit", ".data", ".bss"))
    reach = {stack.name_of(title) for title in graph.reachable(_SAMPLES, _Pointees(graph))}
    return Image(flash, memory, sizes[".stack"], bound, worst, forbidden(reach))


class _Pointees:
    """The firmware calls through pointers in two ways: the table of commands, and the port's functions."""

    def __init__(self, graph: stack.Graph) -> None:
        self._commands = [title for title in graph.frames if "/application/commands.c:" in title]
        text = (_PORT / "main.c").read_text(encoding="utf-8")
        table = re.search(r"struct hal port = \{(.*?)\};", text, re.DOTALL)
        assert table, "no table of the port's functions"
        names = set(re.findall(r"= (\w+)", table[1]))
        self._port = [title for title in graph.frames if stack.name_of(title) in names and "/application/" not in title]

    def __call__(self, caller: str) -> Iterable[str]:
        return self._commands if caller == "command_execute" else self._port


def _section_bytes() -> dict[str, int]:
    listing = subprocess.run(["arm-none-eabi-size", "-A", str(program())], capture_output=True, text=True, check=True).stdout
    return {name: int(size) for name, size in re.findall(r"^(\.\S+)\s+(\d+)", listing, re.MULTILINE)}
