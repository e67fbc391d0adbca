"""Worst stack of a function, from the call graph and the frame sizes that the compiler wrote beside its objects."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from wineglass.errors import WineglassError

_NODE = re.compile(r'node: \{ title: "([^"]+)" label: "([^"]+)"')
_FRAME = re.compile(r"\\n(\d+) bytes \(([\w,]+)\)")
_EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
_INDIRECT = "__indirect_call"


@dataclass
class Graph:
    frames: dict[str, int] = field(default_factory=dict)
    """bytes of each function's own frame"""
    callees: dict[str, set[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Worst:
    bytes: int
    path: tuple[str, ...]
    """functions from the outermost to the innermost of the deepest path"""


def read(files: Iterable[Path]) -> Graph:
    """Call graph of compiled sources (*.ci). A frame whose size is not fixed is refused: it would have no bound."""
    graph = Graph()
    for path in files:
        text = path.read_text(encoding="utf-8")
        for title, label in _NODE.findall(text):
            if frame := _FRAME.search(label):
                graph.frames[_name(title)] = _fixed(_name(title), int(frame[1]), frame[2])
        for source, target in _EDGE.findall(text):
            graph.callees.setdefault(_name(source), set()).add(_name(target))
    return graph


def add_library_frames(graph: Graph, program: Path) -> None:
    """Functions that no source here defines (memset and its like): their frames, from the instructions that save registers."""
    unknown = {name for names in graph.callees.values() for name in names} - graph.frames.keys() - {_INDIRECT}
    if not unknown:
        return
    listing = subprocess.run(["arm-none-eabi-objdump", "-d", "--no-show-raw-insn", str(program)], capture_output=True, text=True,
                             check=True).stdout
    for name, body in re.findall(r"^[0-9a-f]+ <([^>]+)>:\n((?:.+\n?)*)", listing, re.MULTILINE):
        if name in unknown:
            if re.search(r"\tblx?\s", body):
                raise WineglassError(f"{name}: a library function that calls others; its stack is not known")
            graph.frames[name] = _saved_bytes(body)


def worst(graph: Graph, function: str, above: tuple[str, ...] = ()) -> Worst:
    """Deepest path below a function, itself included. Recursion and calls through pointers are refused."""
    if function in above:
        raise WineglassError(f"recursion: {' -> '.join((*above, function))}")
    if function == _INDIRECT:
        raise WineglassError(f"a call through a pointer in {above[-1]}: its stack is not known")
    if function not in graph.frames:
        raise WineglassError(f"the stack of {function} is not known")
    below = [worst(graph, callee, (*above, function)) for callee in graph.callees.get(function, ())]
    deepest = max(below, key=lambda item: item.bytes, default=Worst(0, ()))
    return Worst(graph.frames[function] + deepest.bytes, (function, *deepest.path))


def _fixed(name: str, size: int, kind: str) -> int:
    if kind == "dynamic":
        raise WineglassError(f"{name}: its stack frame has no fixed size")
    return size


def _name(title: str) -> str:
    """Functions private to a file are written with its name in front."""
    return title.rpartition(":")[2]


def _saved_bytes(body: str) -> int:
    lists = re.findall(r"\t(?:push|stmdb)\s+(?:sp!, )?\{([^}]*)\}", body)
    locals_ = sum(int(value) for value in re.findall(r"\tsub(?:\.w)?\s+sp,(?: sp,)? #(\d+)", body))
    return locals_ + sum(4 * _register_count(registers) for registers in lists)


def _register_count(text: str) -> int:
    count = 0
    for item in text.split(","):
        first, _, last = item.strip().partition("-")
        count += int(last[1:]) - int(first[1:]) + 1 if last else 1
    return count
