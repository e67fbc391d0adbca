"""wineglass export REC -o X.csv (one tap) or -o X.sigmf-meta (raw bursts)"""

from __future__ import annotations

import argparse
from pathlib import Path

from wineglass.console import Console
from wineglass.errors import BadInput

HELP = "write a recording's tap as CSV, or its raw bursts as SigMF"
NEEDS_BUILD = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="REC.h5")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE",
                        help="NAME.csv, or NAME.sigmf-meta (its data go to NAME.sigmf-data)")
    parser.add_argument("--tap", choices=["baseband", "output", "reference"],
                        help="tap to write as CSV (default: output, or the only one there is)")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.exporters.csv import export_csv
    from wineglass.exporters.sigmf import export_sigmf
    from wineglass.recording import Recording

    if args.output.resolve() == args.recording.resolve():
        raise BadInput("the output is the input file", args.recording, "choose another name with -o")
    with Recording.open(args.recording) as recording:
        if args.output.suffix == ".csv":
            result = export_csv(recording, args.tap, args.output)
        elif args.output.suffix == ".sigmf-meta":
            result = export_sigmf(recording, args.output)
        else:
            raise BadInput("unknown kind of file", args.output, "end the name in .csv or .sigmf-meta")
    console.json({"output": args.output, **result})
    facts = ", ".join(f"{value} {key.replace('_', ' ')}" for key, value in result.items())
    console.print(f"{args.output}: {facts}")
    return 0
