import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from wineglass.console import Console, plain


@dataclasses.dataclass
class Row:
    rate_rad_s: float
    name: str


def test_plain_knows_what_commands_hand_out():
    value = {"row": Row(float("inf"), "x"), "array": np.array([1.0, np.nan]), "n": np.int32(3), "f": np.float32(0.5),
             "flag": np.bool_(True), "path": Path("a/b"), 3: (1, 2)}
    expected = {"row": {"rate_rad_s": None, "name": "x"}, "array": [1.0, None], "n": 3, "f": 0.5, "flag": True,
                "path": "a/b", "3": [1, 2]}
    assert plain(value) == expected
    json.dumps(plain(value), allow_nan=False)


@pytest.mark.parametrize("console", [Console(quiet=True), Console(json_mode=True)])
def test_silent_consoles_print_nothing(console, capsys):
    console.print("x")
    console.table("t", ["a"], [["1"]])
    assert capsys.readouterr().out == ""


def test_tables_keep_units_and_align_numbers(capsys):
    Console().table("Residuals", ["method", "rate [rad/s]"], [["static", "1.5"], ["G2 [tuned]", "-22.5"]])
    out = capsys.readouterr().out
    assert "rate [rad/s]" in out and "G2 [tuned]" in out
    lines = [line.rstrip() for line in out.splitlines() if "static" in line or "tuned" in line]
    assert lines[0].endswith(" 1.5") and len(lines[0]) == len(lines[1])


def test_long_lines_are_not_broken(capsys):
    Console().print("x" * 300)
    assert capsys.readouterr().out == "x" * 300 + "\n"


def test_progress_does_nothing_without_a_terminal(capsys):
    with Console().progress("working", total=3) as bar:
        bar.advance()
        bar.update(completed=3)
    assert capsys.readouterr() == ("", "")


def test_warnings_are_one_line_on_stderr_even_when_quiet(capsys):
    Console(quiet=True).warn("two\nlines")
    assert capsys.readouterr().err == "wineglass: warning: two lines\n"
