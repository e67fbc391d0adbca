"""Raw bursts -> SigMF: interleaved codes of all channels, one capture segment per burst, events as annotations."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

from wineglass.atomic import atomic_path, write_text
from wineglass.errors import BadInput
from wineglass.recording import Event, Recording, Tap

SIGMF_VERSION = "1.2.0"


def export_sigmf(recording: Recording, target: Path) -> dict[str, object]:
    """Writes NAME.sigmf-data, then NAME.sigmf-meta."""
    bursts = [burst for burst in recording.bursts if burst.length]
    if not bursts:
        raise BadInput("the recording holds no raw burst", recording.path, "SigMF holds raw samples only; export CSV")
    channels = list(bursts[0].channels)
    _check_alike(bursts, channels, recording.path)
    dtype = _common_type([burst.codes(name).dtype for burst in bursts for name in channels], recording.path)
    digest = hashlib.sha512()
    with atomic_path(target.with_suffix(".sigmf-data")) as part, part.open("wb") as file:
        for burst in bursts:
            block = np.stack([burst.codes(name) for name in channels], axis=1).astype(dtype).tobytes()
            digest.update(block)
            file.write(block)
    meta = _metadata(recording, bursts, channels, dtype, digest.hexdigest())
    write_text(target, json.dumps(meta, indent=2) + "\n")
    return {"bursts": len(bursts), "channels": len(channels), "samples": sum(burst.length for burst in bursts)}


def _check_alike(bursts: list[Tap], channels: list[str], where: str) -> None:
    for burst in bursts:
        if list(burst.channels) != channels or burst.sample_rate_hz != bursts[0].sample_rate_hz:
            raise BadInput(f"{burst.name} has other channels or another rate", where, "such bursts need files of their own")


def _common_type(dtypes: list[np.dtype], where: str) -> np.dtype:
    """SigMF real types: ri8, ri16, ri32, rf32, rf64, little-endian."""
    dtype = np.result_type(*dtypes)
    if dtype.kind not in "if" or dtype.itemsize > (4 if dtype.kind == "i" else 8):
        raise BadInput(f"codes of type {dtype} do not fit SigMF", where, "it holds integers up to 32 bit and floats")
    return dtype.newbyteorder("<")


def _datatype(dtype: np.dtype) -> str:
    bits = 8 * dtype.itemsize
    return f"r{dtype.kind}{bits}" + ("" if bits == 8 else "_le")


def _metadata(recording: Recording, bursts: list[Tap], channels: list[str], dtype: np.dtype, digest: str) -> dict:
    rate = bursts[0].sample_rate_hz
    starts = np.cumsum([0, *(burst.length for burst in bursts)])
    return {
        "global": {
            "core:datatype": _datatype(dtype),
            "core:sample_rate": rate,
            "core:num_channels": len(channels),
            "core:version": SIGMF_VERSION,
            "core:sha512": digest,
            "core:description": "raw codes of the channels: " + ", ".join(channels),
            "core:recorder": f"wineglass, firmware {recording.firmware_version or 'unknown'}",
        },
        "captures": [
            {"core:sample_start": int(start), "core:global_index": burst.first_sample}
            for start, burst in zip(starts, bursts)
        ],
        "annotations": _annotations(recording, bursts, starts),
    }


def _annotations(recording: Recording, bursts: list[Tap], starts: np.ndarray) -> list[dict]:
    """Events that fall into a burst, at their sample of the data file."""
    found = []
    for event in recording.events:
        for start, burst in zip(starts, bursts):
            at = _sample_of(event, burst)
            if 0 <= at < burst.length:
                found.append({"core:sample_start": int(start) + at, "core:label": event.kind[:20], "core:comment": event.value})
    return sorted(found, key=lambda annotation: annotation["core:sample_start"])


def _sample_of(event: Event, burst: Tap) -> int:
    return int((event.sample - burst.first_sample) * burst.sample_rate_hz // burst.counter_rate_hz)
