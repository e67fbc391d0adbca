"""Who answers: functions from a recording's path to the diagnosis as plain data. They see the recording and nothing else."""

from __future__ import annotations

import json
import os
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from wineglass.errors import WineglassError

Engine = Callable[[Path], dict[str, Any]]


def by_command(recording: Path) -> dict[str, Any]:
    """As a user does it: `wineglass diagnose case.h5 --json answer.json`."""
    import argparse

    from wineglass.commands import diagnose
    from wineglass.console import Console

    answer = recording.with_suffix(".json")
    parser = argparse.ArgumentParser()
    diagnose.add_arguments(parser)
    diagnose.run(parser.parse_args([str(recording), "--json", str(answer)]), Console(quiet=True))
    return json.loads(answer.read_text(encoding="utf-8"))


def by_twin(recording: Path) -> dict[str, Any]:
    """The twin level alone."""
    from wineglass.diagnosis import twin_engine

    found = twin_engine.examine(recording)
    if found is None:
        raise WineglassError("the twin level does not apply to this recording")
    return json.loads(found.verdict.diagnosis.to_json())


ENGINES: dict[str, Engine] = {"diagnose": by_command, "twin": by_twin}


def answer(engine: str, recording: bytes) -> dict[str, Any]:
    """One case, in whatever process, in an empty folder of its own. A failure is an answer, too: `error` in place of `diagnosis`."""
    begin, cpu = time.monotonic(), time.process_time()
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "case.h5"
        path.write_bytes(recording)
        try:
            found["diagnosis"] = ENGINES[engine](path)
        except Exception as error:
            found["error"] = _in_short(error)
    return {**found, "elapsed_s": time.monotonic() - begin, "cpu_s": time.process_time() - cpu, "machine": os.uname().nodename}


def _in_short(error: Exception) -> str:
    where = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__} at {Path(where.filename).name}:{where.lineno}: {' '.join(str(error).split())[:300]}"
