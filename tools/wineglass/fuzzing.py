"""The harnesses of tests/fuzz under libFuzzer: built, run side by side, their findings collected.

    rows = fuzz(600.0, progress)       # every harness gets its share of ten minutes on all cores
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from wineglass.errors import BadInput, WineglassError
from wineglass.launch import build, system_packages
from wineglass.paths import repository_root

PRESET = "fuzz"
LONGEST_INPUT = {"cobs": 300, "frame": 600, "commands": 1024, "calibration": 512, "snapshot": 2048, "store": 1200}
"""Harness -> bytes: as much as it looks at"""


@dataclass(frozen=True)
class Row:
    """One harness's run. finding: the input that broke a promise, empty when none did"""

    harness: str
    executions: int
    seconds: float
    coverage: int
    finding: str
    what: str


def fuzz(seconds: float, progress: Callable[[], None] | None = None, harnesses: list[str] | None = None, cores: int | None = None) -> list[Row]:
    """Runs the harnesses for `seconds` together, on all cores unless told; progress() is called as each ends."""
    chosen = _chosen(harnesses)
    folder = _build()
    jobs = min(cores or build.jobs(), len(chosen))
    share = max(1, round(seconds * jobs / len(chosen)))

    def work(harness: str) -> Row:
        row = _run(folder, harness, share)
        if progress is not None:
            progress()
        return row

    with ThreadPoolExecutor(jobs) as pool:
        return list(pool.map(work, chosen))


def _chosen(names: list[str] | None) -> list[str]:
    for name in names or []:
        if name not in LONGEST_INPUT:
            raise BadInput(f"no harness is called {name}", "--only", f"choose from {', '.join(LONGEST_INPUT)}")
    return [name for name in LONGEST_INPUT if not names or name in names]


def _build() -> Path:
    root = repository_root()
    _require_libfuzzer(root)
    folder = root / "build" / PRESET
    log = root / "build" / "fuzz-build.log"
    variables = build.prepare(root, PRESET)
    with open(log, "wb") as stream:
        for command in (["cmake", "--preset", PRESET], ["cmake", "--build", "--preset", PRESET, "--parallel", str(build.jobs())]):
            if subprocess.run(command, cwd=root, env=variables, stdout=stream, stderr=subprocess.STDOUT, check=False).returncode:
                raise WineglassError(f"the harnesses do not build; see {log}")
    return folder


def _require_libfuzzer(root: Path) -> None:
    """clang and its run-time library of the fuzzer, installed where that is allowed."""
    if _has_libfuzzer():
        return
    version = _output("clang", "-dumpversion").partition(".")[0] if shutil.which("clang") else "14"
    packages = ["clang", f"libclang-rt-{version}-dev"]
    if system_packages.may_install():
        system_packages.install(packages, root / "build" / "setup-packages.log")
    if not _has_libfuzzer():
        raise BadInput("clang with libFuzzer is needed", "fuzz", f"run: {system_packages.install_line(packages)}")


def _has_libfuzzer() -> bool:
    if not shutil.which("clang"):
        return False
    machine = os.uname().machine
    return any(Path(_output("clang", f"--print-file-name={name}")).is_file()
               for name in (f"libclang_rt.fuzzer-{machine}.a", "libclang_rt.fuzzer.a"))


def _output(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


def _run(folder: Path, harness: str, seconds: int) -> Row:
    corpus, findings = folder / "corpus" / harness, folder / "findings"
    for made in (corpus, findings):
        made.mkdir(parents=True, exist_ok=True)
    known = repository_root() / "tests/fuzz/corpus" / harness
    log = folder / f"{harness}.log"
    command = [folder / "bin" / f"fuzz_{harness}", f"-max_total_time={seconds}", f"-max_len={LONGEST_INPUT[harness]}", "-timeout=10",
               "-print_final_stats=1", f"-artifact_prefix={findings}/{harness}-", corpus, known]
    variables = {**os.environ, "UBSAN_OPTIONS": "print_stacktrace=1"}
    with open(log, "wb") as stream:
        status = subprocess.run(command, cwd=folder, env=variables, stdout=stream, stderr=subprocess.STDOUT, check=False).returncode
    return _row(harness, log, float(seconds), status)


def _row(harness: str, log: Path, seconds: float, status: int) -> Row:
    text = log.read_text(encoding="utf-8", errors="replace")
    executions = _last_number(r"stat::number_of_executed_units:\s*(\d+)", text) or _last_number(r"^#(\d+)\t", text)
    written = re.findall(r"Test unit written to (\S+)", text)
    words = re.search(r"broken: .*|runtime error: .*|SUMMARY: .*|ERROR: .*", text)
    finding = (written[-1] if written else str(log)) if status else ""
    return Row(harness, executions, seconds, _last_number(r"\bcov: (\d+)", text), finding, words.group(0) if status and words else "")


def _last_number(pattern: str, text: str) -> int:
    found = re.findall(pattern, text, re.MULTILINE)
    return int(found[-1]) if found else 0
