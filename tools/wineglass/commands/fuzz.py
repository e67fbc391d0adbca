"""`wineglass fuzz [--seconds N]`"""

from __future__ import annotations

import argparse

from wineglass.console import Console

HELP = "fuzz every C parser of bytes from outside, under address and undefined-behaviour sanitizers"
NEEDS_BUILD = False  # it has a build of its own


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=3600.0, metavar="S", help="time for all harnesses together, on all cores")
    parser.add_argument("--cores", type=int, metavar="N", help="use so many (default: all)")
    parser.add_argument("--only", action="append", metavar="HARNESS", help="this harness (may be repeated)")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.errors import BadInput
    from wineglass.fuzzing import LONGEST_INPUT, fuzz

    if not args.seconds > 0 or (args.cores is not None and args.cores < 1):
        raise BadInput("a time above 0 and one core at least are needed", "--seconds, --cores", "give other numbers")
    with console.progress(f"fuzzing for {args.seconds:g} s", total=len(args.only or LONGEST_INPUT)) as bar:
        rows = fuzz(args.seconds, bar.advance, args.only, args.cores)
    console.table("", ["harness", "executions", "a second", "edges covered", "finding"],
                  [(row.harness, row.executions, f"{row.executions / row.seconds:.0f}", row.coverage, row.finding or "none") for row in rows])
    found = [row for row in rows if row.finding]
    for row in found:
        console.warn(f"{row.harness}: {row.what}; repeat it with build/fuzz/bin/fuzz_{row.harness} {row.finding}, "
                     f"and keep it in tests/fuzz/corpus/{row.harness} when it is mended")
    console.print(f"{sum(row.executions for row in rows)} executions, {len(found)} findings")
    console.json({"executions": sum(row.executions for row in rows), "findings": len(found), "harnesses": rows})
    return 1 if found else 0
