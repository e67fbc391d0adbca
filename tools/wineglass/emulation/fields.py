"""Names of the numbers in a snapshot, so that two snapshots that differ say where.

The one table of fields stands in firmware/application/snapshot.c. It is read from there, after the preprocessor has expanded it."""

from __future__ import annotations

import ast
import os
import re
import subprocess
from dataclasses import dataclass
from functools import cache

from wineglass import paths
from wineglass.errors import WineglassError

HEADER_BYTES = 12
_SOURCE = "firmware/application/snapshot.c"
_ENTRY = re.compile(r"offsetof\s*\(struct gyro_(cfg|state),\s*([\w.\[\]]+)\s*\)\s*,\s*([^,{}]+),\s*([^,{}]+)\}")


@dataclass(frozen=True)
class Field:
    part: str
    """cfg or state"""
    name: str
    offset: int
    """of its first byte in the snapshot"""
    size: int

    @property
    def module(self) -> str:
        """What the field belongs to: the part of its name in front of the first dot."""
        return self.name.partition(".")[0]


@cache
def fields() -> tuple[Field, ...]:
    """In the order of the bytes, which is that of the signal's way for the state."""
    found, offset = [], HEADER_BYTES
    for part, name, width, count in _ENTRY.findall(_expanded()):
        size = _number(width) * _number(count)
        found.append(Field(part, name, offset, size))
        offset += size
    if not found:
        raise WineglassError(f"no table of fields in {_SOURCE}")
    return tuple(found)


def differing(first: bytes, second: bytes) -> list[Field]:
    """Fields whose bytes differ; a snapshot of another length differs everywhere."""
    if len(first) != len(second):
        return list(fields())
    return [field for field in fields()
            if first[field.offset : field.offset + field.size] != second[field.offset : field.offset + field.size]]


def _expanded() -> str:
    root = paths.repository_root()
    compiler = (os.environ.get("CC") or "cc").split()
    done = subprocess.run([*compiler, "-E", "-P", "-I", root / "firmware", "-I", root, root / _SOURCE], capture_output=True,
                          text=True, check=False)
    if done.returncode != 0:
        raise WineglassError(f"{_SOURCE}: {done.stderr.strip()[:300]}")
    return done.stdout


def _number(text: str) -> int:
    """Value of a constant expression of sums and products, e.g. `(5 + 1)`."""
    def value(node: ast.expr) -> int:
        if isinstance(node, ast.Constant) and isinstance(node.value, int):
            return node.value
        if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Add, ast.Mult)):
            left, right = value(node.left), value(node.right)
            return left + right if isinstance(node.op, ast.Add) else left * right
        raise WineglassError(f"{_SOURCE}: cannot read the number {text}")

    return value(ast.parse(text.strip(), mode="eval").body)
