"""Small blind sets with stand-ins for recordings, and answers written by hand."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any

from wineglass.blind import sealing
from wineglass.blind.folders import Folders
from wineglass.blind.sheet import Effect, Sheet


def sheet(name: str, tier: str, *effects: tuple[str, str], factor: float = 1.0, **more: Any) -> Sheet:
    return Sheet(**{"name": name, "tier": tier, "protocol": "full", "loop": "open", "seed": 1, "factor": factor if effects else 0.0,
                    "effects": tuple(Effect(id=id, variant=variant, strength=factor) for id, variant in effects), **more})


def label(one: Sheet, snr: float = 100.0) -> dict[str, Any]:
    return {"sheet": one.label(), "grade": {"snr": snr if one.effects else 0.0, "channel": "rate", "channels": {}}, "clipped_codes": 0, "unit": {}}


def sealed_set(root: Path, labels: list[dict[str, Any]]) -> Folders:
    """A sealed set whose recordings are a few bytes each."""
    folders = Folders(root)
    folders.recordings.mkdir(parents=True)
    folders.sealed.mkdir()
    envelopes = {}
    for number, one in enumerate(labels):
        name = one["sheet"]["name"]
        folders.recording(name).write_bytes(f"recording {number}".encode())
        envelopes[name] = {"salt": f"{number:032x}", "label": one}
    sealing.seal(folders.recordings, folders.sealed, envelopes)
    return folders


def diagnosis(verdict: str, *hypotheses: tuple[float, str], named: tuple[str, ...] = (), alternatives: tuple[str, ...] = (), place: str = "",
              fraction: float | None = None) -> dict[str, Any]:
    """hypotheses: (probability, ids joined by +); named: ids, or id:parameter:low:high."""
    effects = []
    for text in named:
        id, *parameter = text.split(":")
        parameters = [{"name": parameter[0], "value": 0.0, "interval": [float(parameter[1]), float(parameter[2])], "unit": ""}] if parameter else []
        effects.append({"id": id, "parameters": parameters})
    return {"verdict": verdict, "sentence": "", "hypotheses": [{"ids": ids.split("+"), "probability": p} for p, ids in hypotheses], "effects": effects,
            "alternatives": [ids.split("+") for ids in alternatives], "where": [{"stage": place, "share": 1.0}] if place else [],
            "shrink": {"all": {"before": None, "after": None if fraction is None else 1.05, "floor": 1.0, "fraction": fraction}}}


def answer(folders: Folders, name: str, found: dict[str, Any] | None, engine: str = "diagnose", **more: Any) -> None:
    folder = folders.results(engine)
    folder.mkdir(parents=True, exist_ok=True)
    entry = {"case": name, "engine": engine, "recording": sealing.file_digest(folders.recording(name)), "commit": "x", "date": "2026-01-01", "cpu_s": 1.0,
             **({"error": "it broke"} if found is None else {"diagnosis": found}), **more}
    (folder / f"{name}.json").write_text(json.dumps(entry))


def stub(engine: str, recording: bytes) -> dict[str, Any]:
    """Stands in for an engine: answers with what it was given, after a moment, and says which process it was."""
    time.sleep(float(os.environ.get("BLIND_STUB_S", "0.05")))
    return {"diagnosis": diagnosis("no_gap", (1.0, "none"), (0.0, "other")), "elapsed_s": 0.0, "cpu_s": 0.0, "machine": str(os.getpid()),
            "seen": recording.decode()}
