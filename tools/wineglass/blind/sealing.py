"""Envelopes: a label's salted SHA-256 stands beside the recordings before anybody diagnoses, the label and its salt elsewhere.

manifest.json, open: of every case the SHA-256 of its recording and of salt and label. Whoever keeps it, or only the seal printed by `blind make`
(the SHA-256 of the manifest), can tell later whether a label or a recording was exchanged."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from wineglass.atomic import write_text
from wineglass.errors import BadInput

FORMAT = "wineglass-blind"
VERSION = 1
MANIFEST = "manifest.json"
LABELS = "labels.json"


def canonical(value: Any) -> str:
    """One text per value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def label_digest(salt: str, label: dict[str, Any]) -> str:
    return hashlib.sha256((salt + canonical(label)).encode()).hexdigest()


def file_digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def seal(recordings: Path, sealed: Path, envelopes: dict[str, dict[str, Any]]) -> str:
    """Writes labels, then manifest; returns the seal. envelopes: per case `salt` (hex) and `label`."""
    write_text(sealed / LABELS, json.dumps({"format": FORMAT, "version": VERSION, "cases": envelopes}, indent=1) + "\n")
    cases = {name: {"recording": file_digest(recordings / f"{name}.h5"), "label": label_digest(one["salt"], one["label"])}
             for name, one in sorted(envelopes.items())}
    write_text(recordings / MANIFEST, json.dumps({"format": FORMAT, "version": VERSION, "cases": cases}, indent=1) + "\n")
    return file_digest(recordings / MANIFEST)


def manifest(recordings: Path) -> dict[str, dict[str, str]]:
    """Per case the digests of recording and label."""
    return _read(recordings / MANIFEST, "run `wineglass blind make` to its end")


def check_recordings(recordings: Path) -> dict[str, dict[str, str]]:
    """The manifest, once every recording is the one that was sealed."""
    cases = manifest(recordings)
    for name, digests in cases.items():
        path = recordings / f"{name}.h5"
        if not path.is_file():
            raise BadInput("the recording is missing", path, "restore it: a sealed set is scored as a whole")
        if file_digest(path) != digests.get("recording"):
            raise BadInput("the recording is not the one that was sealed", path, "restore it, or make a new set")
    return cases


def opened(recordings: Path, sealed: Path) -> dict[str, dict[str, Any]]:
    """The labels, once they and the recordings are those that were sealed."""
    cases = check_recordings(recordings)
    envelopes = _read(sealed / LABELS, "name the folder of the labels with --labels")
    for name in sorted(set(cases) | set(envelopes)):
        if name not in cases or name not in envelopes:
            raise BadInput(f"{name} is in only one of labels and manifest", sealed / LABELS, "restore the labels that were sealed")
        if not _matches(envelopes[name], cases[name]):
            raise BadInput(f"the label of {name} is not the one that was sealed", sealed / LABELS, "restore the labels that were sealed")
    return {name: one["label"] for name, one in envelopes.items()}


def _matches(envelope: Any, digests: dict[str, str]) -> bool:
    try:
        return label_digest(envelope["salt"], envelope["label"]) == digests["label"]
    except (KeyError, TypeError, ValueError):
        return False


def _read(path: Path, todo: str) -> dict[str, Any]:
    if not path.is_file():
        raise BadInput("is not there", path, todo)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] != FORMAT or content["version"] != VERSION:
            raise BadInput("is of another format", path, "make the set with this version")
        return dict(content["cases"])
    except (ValueError, KeyError, TypeError):
        raise BadInput("is damaged", path, todo) from None
