"""wineglass compare REC.h5 --device A --device B"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wineglass.console import Console
from wineglass.errors import BadInput

if TYPE_CHECKING:
    from wineglass.diagnosis.comparison import Comparison, Interval

HELP = "run two device descriptions as twins against one recording: which is closer, in which channel, by how much"
FORMAT, FORMAT_VERSION = "wineglass-comparison", 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="REC.h5", help="recording that both twins are compared with")
    parser.add_argument("--device", action="append", default=[], metavar="NAME|D.toml", help="device description; give it twice")
    parser.add_argument("--json", type=Path, metavar="F.json", help="file for the result as JSON")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass import device as devices
    from wineglass.atomic import write_text
    from wineglass.diagnosis import comparison, drive, soundness
    from wineglass.recording import Recording

    _check(args)
    a, b = (devices.load(name) for name in args.device)
    with Recording.open(args.recording, tolerant=True) as recording:
        notes = [note for device in (b, a) for note in soundness.check(recording, device)]
        blocks = drive.from_recording(recording, a).run.n_blocks
        with console.progress("running both twins", total=comparison.runs() * blocks) as bar:
            found = comparison.compare(recording, a, b, bar.advance)
    result = _result(found, args, notes)
    if args.json is not None:
        write_text(args.json, _text(result))
    console.json(result)
    _print(found, args, notes, console)
    return 0


def _check(args: argparse.Namespace) -> None:
    if len(args.device) != 2:
        raise BadInput(f"{len(args.device)} devices given", "--device", "give it twice: --device A --device B")
    if args.recording.suffix.lower() == ".csv":
        raise BadInput("a table holds no inputs for the twins", args.recording, "give a recording")
    if args.json is not None:
        if args.json.suffix != ".json":
            raise BadInput(f"{args.json} does not end in .json", "--json", "name a .json file")
        if not args.json.parent.is_dir():
            raise BadInput("the folder does not exist", args.json.parent, "create it or choose another output path")


def _result(found: Comparison, args: argparse.Namespace, notes: list[str]) -> dict[str, Any]:
    from wineglass import __version__
    from wineglass.diagnosis.evidence import file_hash

    facts = asdict(found) | {"notes": [*dict.fromkeys(notes), *found.notes]}
    return {"format": FORMAT, "format_version": FORMAT_VERSION, "program": f"wineglass {__version__}", "recording": str(args.recording),
            "sha256": file_hash(args.recording), "devices": {"a": args.device[0], "b": args.device[1]}, **facts}


def _text(result: dict[str, Any]) -> str:
    import json

    return json.dumps(result, indent=2) + "\n"


def _print(found: Comparison, args: argparse.Namespace, notes: list[str], console: Console) -> None:
    a, b = args.device
    rows = [(c.name, c.unit, f"{c.a:.3g}", f"{c.b:.3g}", f"{c.floor:.3g}", _words(c.ratio)) for c in found.channels]
    rows.append(("all", "floors", f"{found.a:.3g}", f"{found.b:.3g}", "1", _words(found.ratio)))
    console.table("Recorded minus twin, rms", ["channel", "unit", f"A: {a}", f"B: {b}", "floor", "B over A (95 %)"], rows)
    console.print(sentence(found, a, b))
    for note in (*dict.fromkeys(notes), *found.notes):
        console.print(f"note: {note}")
    if args.json is not None:
        console.print(f"written: {args.json}")


def sentence(found: Comparison, a: str, b: str) -> str:
    if not found.closer:
        return f"Neither is closer: B leaves {_words(found.ratio)} of what A leaves."
    near, far = (b, a) if found.closer == "b" else (a, b)
    if found.removed is None:
        return f"{near} is closer, but {far} is within the noise floor as well."
    share = found.removed
    return f"{near} is closer: {share.value:.2%} of the gap of {far} above the floor is gone (95 %: {share.low:.2%} to {share.high:.2%})."


def _words(interval: Interval) -> str:
    return f"{interval.value:.3g} ({interval.low:.3g} to {interval.high:.3g})"
