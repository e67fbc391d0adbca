"""wineglass diagnose REC.h5|FILE.csv"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from wineglass.console import Console
from wineglass.errors import BadInput

if TYPE_CHECKING:
    from wineglass.device import Device
    from wineglass.diagnosis.contract import Diagnosis
    from wineglass.diagnosis.evidence import Evidence
    from wineglass.report.view import View

HELP = "say where a recording differs from the twin, which effect it is, how sure that is, and what to run next"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="REC.h5|FILE.csv", help="recording, or table with time, temperature and rate of any gyro")
    parser.add_argument("--column", action="append", default=[], metavar="ROLE=COLUMN",
                        help="tables: column to use as time, temperature, rate or true_rate; may be repeated")
    parser.add_argument("--unit", action="append", default=[], metavar="COLUMN=UNIT", help="tables: unit of a column, where the header has none")
    parser.add_argument("--drop-rows", default="", metavar="0,1,5-9", help="tables: data rows to leave out, counted from 0")
    parser.add_argument("--device", metavar="NAME|D.toml", help="what the gyro nominally is; left out: the description in the recording")
    parser.add_argument("--json", type=Path, metavar="F.json", help="file for the diagnosis as JSON")
    parser.add_argument("--apply", type=Path, metavar="F.toml", help="file for the device description with the named effects in it, for `simulate --device`")
    parser.add_argument("--report", type=Path, metavar="F.html", help="file for the report, one HTML page that needs nothing else")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.atomic import write_text

    _check_targets(args)
    device = _device(args)
    with console.progress("diagnosing", total=8) as bar:
        diagnosis, view = _twin_level(args, bar.advance) or _rate_level(args, bar.advance)
        page = _page(args, view)
        amended = "" if device is None else _amended(device, diagnosis)
        bar.advance()
    for target, text in ((args.json, diagnosis.to_json()), (args.report, page), (args.apply, amended)):
        if target is not None:
            write_text(target, text)
    console.json(diagnosis.model_dump(by_alias=True))
    _print(diagnosis, args, console)
    return 0


def _check_targets(args: argparse.Namespace) -> None:
    for flag, target, ending in (("--json", args.json, ".json"), ("--report", args.report, ".html"), ("--apply", args.apply, ".toml")):
        if target is None:
            continue
        if target.suffix != ending:
            raise BadInput(f"{target} does not end in {ending}", flag, f"name a {ending} file")
        if not target.parent.is_dir():
            raise BadInput("the folder does not exist", target.parent, "create it or choose another output path")
        if target.resolve() == args.recording.resolve():
            raise BadInput("the output is the input file", flag, "choose another name")


def _device(args: argparse.Namespace) -> Device | None:
    """The description that --apply amends; None without --apply."""
    if args.apply is None:
        return None
    from wineglass import device as devices
    from wineglass.diagnosis import soundness
    from wineglass.recording import Recording

    if args.recording.suffix.lower() == ".csv":
        if args.device is None:
            raise BadInput("a table has no device description to amend", "--apply", "name the device with --device")
        return devices.load(args.device)
    with Recording.open(args.recording, tolerant=True) as recording:
        device = soundness.described(recording, args.device)
    if device is None:
        raise BadInput("the recording has no device description to amend", "--apply", "name the device with --device")
    return device


def _amended(device: Device, diagnosis: Diagnosis) -> str:
    from wineglass.diagnosis.amended import amend, text

    return text(amend(device, diagnosis), diagnosis)


def _evidence(args: argparse.Namespace) -> Evidence:
    from dataclasses import replace

    from wineglass import device as devices
    from wineglass.commands.import_ import parse_pairs, parse_rows
    from wineglass.diagnosis.evidence import from_csv, from_recording

    columns, units = parse_pairs(args.column, "--column", "ROLE=COLUMN"), parse_pairs(args.unit, "--unit", "COLUMN=UNIT")
    rows = parse_rows(args.drop_rows)
    if args.recording.suffix.lower() == ".csv":
        return replace(from_csv(args.recording, columns, units, rows), device=None if args.device is None else devices.load(args.device).name)
    if columns or units or rows:
        raise BadInput("a recording knows its channels and units", args.recording, "leave --column, --unit and --drop-rows away")
    return from_recording(args.recording, args.device)


def _twin_level(args: argparse.Namespace, advance: Callable[[], None]) -> tuple[Diagnosis, View] | None:
    """None where the recording does not allow it: then its rate is all there is to look at."""
    if args.recording.suffix.lower() == ".csv" or args.column or args.unit or args.drop_rows:
        return None
    from wineglass.diagnosis import twin_engine
    from wineglass.report.view import of_twin_level

    examined = twin_engine.examine(args.recording, args.device, advance)
    return None if examined is None else (examined.verdict.diagnosis, of_twin_level(examined))


def _rate_level(args: argparse.Namespace, advance: Callable[[], None]) -> tuple[Diagnosis, View]:
    from wineglass.diagnosis.rate_level import analyse
    from wineglass.diagnosis.verdict import diagnose
    from wineglass.report.view import of_rate_level

    evidence = _evidence(args)
    found = analyse(evidence, advance)
    diagnosis = diagnose(evidence, found)
    return diagnosis, of_rate_level(evidence, found, diagnosis)


def _page(args: argparse.Namespace, view: View) -> str:
    if args.report is None:
        return ""
    from wineglass.report.page import render

    return render(view)


def _print(diagnosis: Diagnosis, args: argparse.Namespace, console: Console) -> None:
    """A dozen lines."""
    from wineglass.diagnosis import curves

    console.print(f"verdict: {diagnosis.verdict}")
    console.print(diagnosis.sentence)
    if diagnosis.where:
        stages = ", ".join(f"{w.stage}/{w.component} {w.share:.0%}" for w in diagnosis.where)
        console.print(f"where: {stages} of the gap")
    for hypothesis in diagnosis.hypotheses[:4]:
        console.print(f"  {hypothesis.probability:5.1%}  {' with '.join(hypothesis.ids)}")
    for effect in diagnosis.effects[:3]:
        plain, curve = curves.parted(effect)
        numbers = [f"{p.name} {p.text} {p.unit}" for p in plain]
        console.print(f"  {effect.id} (confidence {effect.confidence:.2f}): {', '.join([*numbers, *([curve] if curve else [])])}")
    for channel in sorted(diagnosis.shrink.channels, key=lambda c: -c.before / max(c.floor, 1e-300))[:3]:
        line = f"{channel.channel}: {channel.before:.3g} -> {channel.after:.3g} {channel.unit}, floor {channel.floor:.3g}"
        console.print(line + ("" if channel.fraction is None else f": {channel.fraction:.0%} of the gap removed; {diagnosis.shrink.held_out}"))
    if diagnosis.next_experiment is not None:
        console.print(f"next: {diagnosis.next_experiment.run} ({diagnosis.next_experiment.why})")
    for target in (args.json, args.report, args.apply):
        if target is not None:
            console.print(f"written: {target}")
