"""What the bytes of a state snapshot mean: the fields of configuration and state by name.

The one table of them is in firmware/application/snapshot.c, and it is read from there, as the C interface is read from its headers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

import numpy as np

from wineglass import paths

HEADER_BYTES = 12
_SOURCE = "firmware/application/snapshot.c"
_CONSTANTS = {"THERMAL_POLYNOMIAL_MAX_ORDER": "firmware/core/thermal_polynomial.h", "OUTPUT_FILTER_SECTIONS": "firmware/core/output_filter.h"}
_CALL = re.compile(r"\b([A-Z]+)\(([^()]*)\)")


@dataclass(frozen=True)
class Field:
    """part: "cfg" or "state"; offset in the snapshot; `count` numbers of `width` bytes"""

    part: str
    name: str
    offset: int
    width: int
    count: int

    def of(self, snapshot: bytes) -> np.ndarray:
        """Numbers (count,), little endian, as signed integers."""
        return np.frombuffer(snapshot, f"<i{self.width}", self.count, self.offset)


@cache
def fields() -> tuple[Field, ...]:
    """All fields in their order."""
    text = (paths.repository_root() / _SOURCE).read_text(encoding="utf-8")
    macros = _macros(text)
    found: list[Field] = []
    offset = HEADER_BYTES
    for part in ("cfg", "state"):
        table = re.search(rf"{part}_fields\[\] = {{(.*?)}};", text, re.S)
        assert table is not None, f"{_SOURCE} has no table of {part}"
        for name, width, count in _entries(table.group(1), macros):
            found.append(Field(part, name, offset, width, count))
            offset += width * count
    return tuple(found)


@cache
def snapshot_bytes() -> int:
    last = fields()[-1]
    return last.offset + last.width * last.count


def _macros(text: str) -> dict[str, str]:
    """Macros that stand for several fields: name -> text over `member`."""
    joined = text.replace("\\\n", " ")
    found = re.findall(r"^#define ([A-Z]+)\(member\)\s+(.*)$", joined, re.M)
    return dict(found)


def _entries(table: str, macros: dict[str, str]) -> list[tuple[str, int, int]]:
    entries = []
    for name, arguments in _CALL.findall(table):
        parts = [part.strip() for part in arguments.split(",")]
        if name in macros:
            entries += _entries(re.sub(r"\bmember\b", parts[0], macros[name]), macros)
        else:
            entries.append((parts[0], int(parts[1]), _count(parts[2]) if len(parts) > 2 else 1))
    return entries


def _count(text: str) -> int:
    """'2', 'NAME' or 'NAME + 1'."""
    return sum(int(term) if term.strip().isdigit() else _constant(term.strip()) for term in text.split("+"))


@cache
def _constant(name: str) -> int:
    text = (paths.repository_root() / _CONSTANTS[name]).read_text(encoding="utf-8")
    match = re.search(rf"\b{name}\s*(?:=\s*)?(\d+)", text)
    assert match is not None, f"{_CONSTANTS[name]} does not define {name}"
    return int(match.group(1))
