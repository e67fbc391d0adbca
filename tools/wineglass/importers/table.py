"""A CSV file as a table of numbers: header `name[unit]`, then one row per sample. Whatever is wrong is refused with its line."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wineglass.errors import BadInput


@dataclass(frozen=True)
class Column:
    """unit: as in the header, or None where it has no brackets; values (n,) float64 as written"""

    name: str
    unit: str | None
    values: np.ndarray


@dataclass(frozen=True)
class Table:
    """lines (n,): line of the file each row came from, for messages"""

    path: str
    columns: list[Column]
    lines: np.ndarray

    def column(self, name: str) -> Column | None:
        return next((column for column in self.columns if column.name == name), None)


def read_table(path: Path, drop_rows: frozenset[int] = frozenset()) -> Table:
    """drop_rows: data rows to leave out, counted from 0; what stands in them is not looked at."""
    where = str(path)
    header, rows, lines = _read_cells(path, where)
    names = _parse_header(header, where)
    if drop_rows and max(drop_rows) >= len(rows):
        raise BadInput(f"row {max(drop_rows)} is to be dropped, but there are {len(rows)} rows", where, "rows count from 0 after the header")
    kept = [i for i in range(len(rows)) if i not in drop_rows]
    if not kept:
        raise BadInput("no data rows", where, "the table is empty after its header")
    values = _to_numbers([rows[i] for i in kept], [lines[i] for i in kept], names, where)
    columns = [Column(name, unit, values[:, i]) for i, (name, unit) in enumerate(names)]
    return Table(where, columns, np.array([lines[i] for i in kept]))


def _read_cells(path: Path, where: str) -> tuple[list[str], list[list[str]], list[int]]:
    if not path.is_file():
        raise BadInput("no such file", where, "check the name")
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            cells = [(row, reader.line_num) for row in reader]
    except UnicodeDecodeError as error:
        raise BadInput("not a text file (UTF-8)", where, "export it as CSV in UTF-8") from error
    except csv.Error as error:
        raise BadInput(f"not a CSV table ({error})", where, "export it with commas and one row per line") from error
    except OSError as error:
        raise BadInput(f"the file cannot be read ({error.strerror})", where, "check its permissions") from error
    while cells and not any(cell.strip() for cell in cells[-1][0]):
        cells.pop()
    if not cells:
        raise BadInput("the file is empty", where, "the first line must be a header: name[unit],...")
    (header, _), body = cells[0], cells[1:]
    return header, [row for row, _ in body], [line for _, line in body]


def _parse_header(header: list[str], where: str) -> list[tuple[str, str | None]]:
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        raise BadInput("the columns are not separated by commas", f"{where}, line 1", "export the table with commas")
    names = [_parse_name(cell.strip(), where) for cell in header]
    for i, (name, _) in enumerate(names):
        if not name:
            raise BadInput(f"column {i + 1} has no name", f"{where}, line 1", "the header is name[unit],name[unit],...")
        if name in [other for other, _ in names[:i]]:
            raise BadInput(f"two columns are named {name}", f"{where}, line 1", "give every column its own name")
    if all(_is_number(name) for name, _ in names):
        raise BadInput("the header is missing", f"{where}, line 1", "put a line name[unit],name[unit],... on top")
    return names


def _parse_name(cell: str, where: str) -> tuple[str, str | None]:
    if "[" not in cell and "]" not in cell:
        return cell, None
    name, _, rest = cell.partition("[")
    if not rest.endswith("]") or "[" in rest or "]" in rest[:-1]:
        raise BadInput(f"header {cell!r} is not name[unit]", f"{where}, line 1", "write it as name[unit]")
    return name.strip(), rest[:-1].strip()


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _to_numbers(rows: list[list[str]], lines: list[int], names: list[tuple[str, str | None]], where: str) -> np.ndarray:
    values = np.empty((len(rows), len(names)))
    for i, (row, line) in enumerate(zip(rows, lines)):
        if len(row) != len(names):
            raise BadInput(f"{len(row)} cells where the header has {len(names)}", f"{where}, line {line}", "every row needs all columns")
        for j, cell in enumerate(row):
            values[i, j] = _to_number(cell, names[j][0], f"{where}, line {line}")
    return values


def _to_number(cell: str, name: str, place: str) -> float:
    try:
        value = float(cell) if "_" not in cell else math.nan
        if math.isfinite(value):
            return value
    except ValueError:
        pass
    shown = "empty" if not cell.strip() else repr(cell.strip())
    raise BadInput(f"column {name} is {shown}", place, "give a finite number, or leave the row out with --drop-rows")
