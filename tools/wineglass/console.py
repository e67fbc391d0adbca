"""What a command says: lines and tables on stdout, progress and warnings on stderr, or one JSON value.

    console.print("residual", value)                  nothing with --quiet or --json
    console.table("Residuals", ["method", "rad/s"], rows)
    with console.progress("simulating", total=n) as bar: bar.advance(k)
    console.json({"residual_rad_s": value})           only with --json
    console.warn("2 samples lost")                    always, on stderr

Text is printed as it is: square brackets (units!) are no markup. rich loads only when something is printed with it.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any

PIPE_WIDTH = 110


class Console:
    def __init__(self, quiet: bool = False, json_mode: bool = False) -> None:
        self.quiet = quiet
        self.json_mode = json_mode

    @property
    def silent(self) -> bool:
        """No human output wanted on stdout."""
        return self.quiet or self.json_mode

    def print(self, *objects: object, **options: Any) -> None:
        """Strings or rich renderables, on stdout, for people."""
        if not self.silent:
            options.setdefault("soft_wrap", all(isinstance(item, (str, int, float)) for item in objects))
            self._out.print(*objects, **options)

    def table(self, title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """A table; columns whose every cell is a number or starts like one are aligned to the right."""
        if self.silent:
            return
        from rich.box import SIMPLE_HEAD
        from rich.table import Table

        cells = [[str(cell) for cell in row] for row in rows]
        table = Table(title=title or None, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
        for index, column in enumerate(columns):
            numeric = bool(cells) and all(_looks_numeric(row[index]) for row in cells)
            table.add_column(column, justify="right" if numeric else "left", overflow="fold")
        for row in cells:
            table.add_row(*row)
        self._out.print(table)

    def warn(self, text: str) -> None:
        print(f"wineglass: warning: {' '.join(text.split())}", file=sys.stderr, flush=True)

    def json(self, value: object) -> None:
        """The machine-readable result: one JSON value on stdout. NaN and infinity become null."""
        if self.json_mode:
            print(json.dumps(plain(value), indent=2, allow_nan=False), flush=True)

    @contextmanager
    def progress(self, description: str, total: float | None = None) -> Iterator[ProgressBar]:
        """A bar on stderr when that is a terminal; nothing otherwise or with --quiet."""
        if self.quiet or not sys.stderr.isatty():
            yield ProgressBar(None, None)
            return
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}", markup=False), BarColumn(),
                   TextColumn("{task.percentage:>3.0f}%"), TimeElapsedColumn(), TimeRemainingColumn())
        with Progress(*columns, console=self._err, transient=True) as progress:
            yield ProgressBar(progress, progress.add_task(description, total=total))

    @cached_property
    def _out(self) -> Any:
        return _rich_console(sys.stdout)

    @cached_property
    def _err(self) -> Any:
        return _rich_console(sys.stderr)


class ProgressBar:
    """Handle of a running bar; every method also works when no bar is shown."""

    def __init__(self, progress: Any, task: Any) -> None:
        self._progress = progress
        self._task = task

    def advance(self, amount: float = 1.0) -> None:
        if self._progress is not None:
            self._progress.advance(self._task, amount)

    def update(self, completed: float | None = None, total: float | None = None,
               description: str | None = None) -> None:
        if self._progress is not None:
            self._progress.update(self._task, completed=completed, total=total, description=description)


def plain(value: Any) -> Any:
    """`value` as JSON knows it: numpy, pydantic, dataclasses, paths and sets become plain values."""
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    if hasattr(value, "model_dump"):
        return plain(value.model_dump())
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return str(value)


def _looks_numeric(cell: str) -> bool:
    head = cell.strip().lstrip("+-−≤≥<>±")
    return head[:1].isdigit() or cell.strip() in {"", "-", "–", "nan"}


def _rich_console(stream: Any) -> Any:
    from rich.console import Console as RichConsole

    width = None if stream.isatty() or "COLUMNS" in os.environ else PIPE_WIDTH
    return RichConsole(file=stream, markup=False, highlight=False, emoji=False, width=width)
