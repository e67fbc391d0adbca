"""`wineglass reference REC.h5 -o OUT.h5 --log BENCH.csv` or `--plan SCENARIO.toml`"""

from __future__ import annotations

import argparse
from pathlib import Path

from wineglass.console import Console

HELP = "put the bench's true rate and chamber temperature, logged or planned, into a recording made live"
NEEDS_BUILD = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="REC.h5", help="recording without a reference")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--log", type=Path, metavar="BENCH.csv", help="log of rate table or chamber, with a time column")
    source.add_argument("--plan", metavar="FILE.toml", help="what both followed: a scenario, as `protocol NAME --scenario` writes it")
    parser.add_argument("--column", action="append", default=[], metavar="ROLE=COLUMN",
                        help="log: column to use as time, true_rate, chamber_temperature or shell_temperature; may be repeated")
    parser.add_argument("--unit", action="append", default=[], metavar="COLUMN=UNIT", help="log: unit of a column, where the header has none")
    parser.add_argument("--offset", type=float, default=0.0, metavar="S", help="by which the log's or the plan's zero is later than the script's start")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.h5", help="recording to write")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass import references
    from wineglass import scenario as scenarios
    from wineglass.commands.import_ import parse_pairs
    from wineglass.errors import BadInput
    from wineglass.importers.csv import ImportOptions, read_csv

    columns, units = parse_pairs(args.column, "--column", "ROLE=COLUMN"), parse_pairs(args.unit, "--unit", "COLUMN=UNIT")
    if args.output.resolve() == args.recording.resolve():
        raise BadInput("the output is the input file", "-o", "choose another name")
    if args.log is None:
        if columns or units:
            raise BadInput("a plan knows its columns and units", "--plan", "leave --column and --unit away")
        source = references.from_plan(scenarios.load(args.plan), args.offset)
    else:
        source = references.from_log(read_csv(args.log, ImportOptions(columns, units)), args.log.name, args.offset)
    added = references.add(args.recording, args.output, source)
    console.print(f"{args.output}: {', '.join(added.channels)} {source.what}; {added.samples} samples"
                  + (f", {added.unknown} of them outside its time" if added.unknown else ""))
    console.json({"output": args.output, "source": source.what, "channels": added.channels, "samples": added.samples, "unknown": added.unknown})
    return 0
