"""Worst stack of a function, from the call graph and the frame sizes that the compiler wrote beside its objects."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from wineglass.errors import WineglassError

_NODE = re.compile(r'node: \{ title: "([^"]+)" label: "([^"]+)"')
_FRAME = re.compile(r"\\n(\d+) bytes \(([\w,]+)\)")
_EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
_INDIRECT = "__indirect_call"


Pointees = Callable[[str], Iterable[str]]
"""Which functions the pointers in a function may lead to."""


@dataclass
class Graph:
    frames: dict[str, int] = field(default_factory=dict)
    """bytes of each function's own frame; functions private to a file are written `file:function`"""
    callees: dict[str, set[str]] = field(default_factory=dict)

    @property
    def names(self) -> set[str]:
        """Functions without their files."""
        return {name_of(title) for title in self.frames}

    def reachable(self, function: str, pointees: Pointees | None = None) -> set[str]:
        """Everything that a function may call, at any depth."""
        found, left = set(), [function]
        while left:
            title = left.pop()
            if title not in found:
                found.add(title)
                left += self.below(title, pointees)
        return found

    def below(self, title: str, pointees: Pointees | None) -> list[str]:
        """What a function calls, a call through a pointer as all that the pointer may lead to."""
        called = self.callees.get(title, set())
        if _INDIRECT not in called or pointees is None:
            return sorted(called)
        return sorted((called - {_INDIRECT}) | set(pointees(title)))


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
                graph.frames[title] = _fixed(title, int(frame[1]), frame[2])
        for source, target in _EDGE.findall(text):
            graph.callees.setdefault(source, set()).add(target)
    return graph


def add_library_frames(graph: Graph, program: Path) -> None:
    """Functions that no source here defines (memset and its like): their frames, from the instructions that save registers."""
    unknown = {name for names in graph.callees.values() for name in names} - graph.frames.keys() - {_INDIRECT}
    if not unknown:
        return
    listing = subprocess.run(["arm-none-eabi-objdump", "-d", "--no-show-raw-insn", str(program)], capture_output=True, text=True,
                             check=True).stdout
    bodies = dict(re.findall(r"^[0-9a-f]+ <([^>]+)>:\n((?:.+\n?)*)", listing, re.MULTILINE))
    while name := next((name for name in sorted(unknown) if name in bodies and name not in graph.frames), None):
        if re.search(r"\tblx\s+r", bodies[name]):
            raise WineglassError(f"{name}: a library function that calls through a pointer; its stack is not known")
        graph.frames[name] = _saved_bytes(bodies[name])
        graph.callees[name] = set(_called(name, bodies[name]))
        unknown |= graph.callees[name]


def worst(graph: Graph, function: str, above: tuple[str, ...] = (), pointees: Pointees | None = None) -> Worst:
    """Deepest path below a function, itself included. Recursion is refused, and calls through pointers of which nobody says where
    they lead."""
    if function in above:
        raise WineglassError(f"recursion: {' -> '.join((*above, function))}")
    if function == _INDIRECT:
        raise WineglassError(f"a call through a pointer in {above[-1]}: its stack is not known")
    if function not in graph.frames:
        raise WineglassError(f"the stack of {function} is not known")
    below = [worst(graph, callee, (*above, function), pointees) for callee in graph.below(function, pointees)]
    deepest = max(below, key=lambda item: item.bytes, default=Worst(0, ()))
    return Worst(graph.frames[function] + deepest.bytes, (name_of(function), *deepest.path))


def _fixed(name: str, size: int, kind: str) -> int:
    if kind == "dynamic":
        raise WineglassError(f"{name}: its stack frame has no fixed size")
    return size


def name_of(title: str) -> str:
    return title.rpartition(":")[2]


def _called(name: str, body: str) -> list[str]:
    """Calls, and jumps to the beginning of another function."""
    return [target for target in re.findall(r"\tb(?:l|\.w|\.n|)\s+[0-9a-f]+ <([^>+]+)>", body) if target != name]


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
