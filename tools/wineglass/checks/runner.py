"""Runs steps, counts their tests, keeps their output."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

from wineglass.checks.steps import ROOT, Step, missing_need
from wineglass.launch import build

RESULTS = ROOT / "build" / "test"


@dataclass(frozen=True)
class Result:
    step: str
    passed: int
    failed: int
    skipped: int
    seconds: float
    log: Path
    reason: str = ""  # why the whole step was skipped

    @property
    def verdict(self) -> str:
        return "failed" if self.failed else "skipped" if self.reason else "passed"


def run(step: Step) -> Result:
    RESULTS.mkdir(parents=True, exist_ok=True)
    log = RESULTS / f"{step.name}.log"
    log.write_bytes(b"")
    reason = skip_reason(step)
    if reason:
        return Result(step.name, 0, 0, 0, 0.0, log, reason)
    junit = RESULTS / f"{step.name}.xml"
    junit.unlink(missing_ok=True)
    start = time.monotonic()
    succeeded = _run_commands(step, junit, log)
    passed, failed, skipped = count(junit, succeeded)
    return Result(step.name, passed, failed, skipped, time.monotonic() - start, log)


def skip_reason(step: Step) -> str:
    if missing_need(step):
        return f"no {step.needs}"
    absent = [tool for tool in step.tools if not shutil.which(tool)]
    return f"{', '.join(absent)} not installed" if absent else ""


def count(junit: Path, succeeded: bool) -> tuple[int, int, int]:
    """Passed, failed, skipped tests in a JUnit file; without one, the step is one test. A command that fails for
    another reason than a failed test (no build, a crash) is one failure more."""
    if not junit.is_file():
        return (1, 0, 0) if succeeded else (0, 1, 0)
    passed = failed = skipped = 0
    for case in ElementTree.parse(junit).iter("testcase"):
        if case.find("failure") is not None or case.find("error") is not None:
            failed += 1
        elif case.find("skipped") is not None or case.get("status") in ("notrun", "disabled"):
            skipped += 1
        else:
            passed += 1
    return passed, max(failed, 0 if succeeded else 1), skipped


def _run_commands(step: Step, junit: Path, log: Path) -> bool:
    variables = build.prepare(ROOT, step.preset) if step.preset else dict(os.environ)
    with open(log, "ab") as stream:
        for command in step.commands:
            words = [word.replace("{junit}", str(junit)) for word in command]
            stream.write(f"$ {' '.join(words)}\n".encode())
            stream.flush()
            status = subprocess.run(words, cwd=ROOT, env=variables, stdin=subprocess.DEVNULL, stdout=stream,
                                    stderr=subprocess.STDOUT, check=False).returncode
            if status != 0:
                stream.write(f"exit status {status}\n".encode())
                return False
    return True
