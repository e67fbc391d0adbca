"""wineglass info REC"""

from __future__ import annotations

import argparse
from pathlib import Path

from wineglass.console import Console

HELP = "print what a recording holds"
NEEDS_BUILD = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="REC.h5")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.recording import Recording
    from wineglass.recording.describe import channel_rows, summary

    with Recording.open(args.recording) as recording:
        facts = summary(recording)
        rows = channel_rows(recording)
    console.json({**facts, "channels": rows})
    _print_facts(facts, console)
    for tap in dict.fromkeys(row["tap"] for row in rows):
        _print_tap(tap, facts, [row for row in rows if row["tap"] == tap], console)
    for event in facts["events"][:20]:
        console.print(f"event at {event['sample']}: {event['kind']} {event['value']}".rstrip())
    if len(facts["events"]) > 20:
        console.print(f"... and {len(facts['events']) - 20} more events")
    return 0


def _print_facts(facts: dict, console: Console) -> None:
    console.print(f"{facts['file']}: recording format {facts['format_version']}")
    console.print(f"source: {facts['source'] or '-'}; firmware: {facts['firmware_version'] or '-'}; "
                  f"sample counter {facts['counter_rate_hz']:.9g} Hz")
    console.print(f"device description: {facts['device_toml_bytes']} bytes; calibration: "
                  f"{facts['calibration_json_bytes']} bytes JSON, {facts['calibration_block_bytes']} bytes binary")


def _print_tap(tap: str, facts: dict, rows: list[dict], console: Console) -> None:
    tap_facts = facts["taps"][tap]
    title = (f"{tap}: {tap_facts['samples']} samples, {tap_facts['sample_rate_hz']:.9g} Hz, from counter "
             f"{tap_facts['first_sample']}, {tap_facts['duration_s']:.6g} s, {tap_facts['lost']} lost")
    if tap_facts["state_snapshot_bytes"]:
        title += f", state snapshot of {tap_facts['state_snapshot_bytes']} bytes"
    console.table(title, ["channel", "unit", "minimum", "mean", "maximum", "meaning"],
                  [[row["channel"], row["unit"], *(f"{row[key]:.6g}" for key in ("minimum", "mean", "maximum")),
                    row["meaning"]] for row in rows])
    if tap_facts["ignored"]:
        console.print(f"unknown datasets, not read: {', '.join(tap_facts['ignored'])}")
