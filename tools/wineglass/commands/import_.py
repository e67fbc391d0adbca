"""wineglass import FILE.csv -o REC.h5"""

from __future__ import annotations

import argparse
from pathlib import Path

from wineglass.console import Console
from wineglass.errors import BadInput

HELP = "turn a CSV table into a recording"
NEEDS_BUILD = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE.csv", help="table whose first line is name[unit],name[unit],...")
    parser.add_argument("-o", "--output", type=Path, metavar="REC.h5", help="recording to write (default: FILE.h5)")
    parser.add_argument("--map", action="append", default=[], metavar="ROLE=COLUMN",
                        help="column to use as time, temperature, rate or any channel name; may be repeated")
    parser.add_argument("--unit", action="append", default=[], metavar="COLUMN=UNIT",
                        help="unit of a column, where the header has none; may be repeated")
    parser.add_argument("--drop-rows", default="", metavar="0,1,5-9", help="data rows to leave out, counted from 0")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.importers.csv import ImportOptions, import_csv

    target = args.output if args.output is not None else args.file.with_suffix(".h5")
    if target.resolve() == args.file.resolve():
        raise BadInput("the output is the input file", args.file, "choose another name with -o")
    options = ImportOptions(
        columns=parse_pairs(args.map, "--map", "ROLE=COLUMN"),
        unit_of=parse_pairs(args.unit, "--unit", "COLUMN=UNIT"),
        drop_rows=parse_rows(args.drop_rows),
    )
    with console.progress(f"importing {args.file.name}"):
        result = import_csv(args.file, target, options)
    console.json({"output": target, "rows": result.rows, "duration_s": result.duration_s,
                  "sample_rate_hz": result.sample_rate_hz, "uniform": result.uniform,
                  "channels": result.channels, "ignored": result.ignored})
    console.print(f"{target}: {result.rows} samples, {result.duration_s:.6g} s, {result.sample_rate_hz:.6g} Hz"
                  + ("" if result.uniform else " in the mean (uneven, so the times are kept)"))
    for channel, column in result.channels.items():
        console.print(f"  {channel} from column {column}")
    if result.ignored:
        console.print(f"  not imported: {', '.join(result.ignored)}")
    return 0


def parse_pairs(words: list[str], flag: str, form: str) -> dict[str, str]:
    """["a=b", ...] -> {"a": "b", ...}"""
    pairs: dict[str, str] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not key.strip() or not value.strip():
            raise BadInput(f"{word!r} is not {form}", flag, f"write {flag} {form}")
        if key.strip() in pairs:
            raise BadInput(f"{key.strip()} is given twice", flag, "give it once")
        pairs[key.strip()] = value.strip()
    return pairs


def parse_rows(text: str) -> frozenset[int]:
    """"0,1,5-7" -> {0, 1, 5, 6, 7}"""
    rows: set[int] = set()
    for word in filter(None, (part.strip() for part in text.split(","))):
        first, _, last = word.partition("-")
        if not first.isdecimal() or (last and not last.isdecimal()) or word.endswith("-"):
            raise BadInput(f"{word!r} is not a row number", "--drop-rows", "write for example --drop-rows 0,1 or 5-9")
        if int(last or first) - int(first) > 10_000_000 or int(last or first) < int(first):
            raise BadInput(f"{word!r} is not a range of rows", "--drop-rows", "write for example 5-9")
        rows.update(range(int(first), int(last or first) + 1))
    return frozenset(rows)
