"""One tap -> CSV with the header name[unit]; the import reads it back to the same values."""

from __future__ import annotations

import csv
from pathlib import Path

from wineglass.atomic import atomic_path
from wineglass.errors import BadInput
from wineglass.recording import Recording, Tap
from wineglass.recording.channels import TIME


def export_csv(recording: Recording, tap_name: str | None, target: Path) -> dict[str, object]:
    """Lost samples are left out, which the times show."""
    tap = _choose(recording, tap_name)
    names = [name for name in tap.channels if name != TIME.name]
    keep = tap.valid
    columns = [tap.time_s[keep], *(tap[name][keep] for name in names)]
    header = [f"{TIME.name}[{TIME.unit}]", *(f"{name}[{tap.channels[name]}]" for name in names)]
    with atomic_path(target) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(zip(*(map(repr, column.tolist()) for column in columns)))
    return {"rows": int(keep.sum()), "channels": len(names), "lost_samples_left_out": int(tap.lost.sum())}


def _choose(recording: Recording, name: str | None) -> Tap:
    if name is not None:
        return recording.tap(name)
    if "output" in recording.taps or len(recording.taps) != 1:
        if len(recording.taps) == 0:
            raise BadInput("the recording holds raw bursts only", recording.path, "export them with -o NAME.sigmf-meta")
        return recording.tap("output")
    return next(iter(recording.taps.values()))
