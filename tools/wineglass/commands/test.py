"""./wineglass test: everything that the continuous integration checks."""

from __future__ import annotations

import argparse
import difflib

from wineglass.checks.runner import RESULTS, Result, run as run_step
from wineglass.checks.steps import STEPS, Step, absent_packages
from wineglass.console import Console
from wineglass.errors import BadInput
from wineglass.launch import system_packages
from wineglass.launch.notice import tail

HELP = "run every check: C tests under all presets, Python tests, golden traces, static analysis"
NEEDS_BUILD = False  # a build that fails is one of the results

FAILURE_LINES = 60


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--only", metavar="NAME", action="append", help="run this step (may be repeated)")
    parser.add_argument("--list", action="store_true", help="list the steps and stop")


def run(args: argparse.Namespace, console: Console) -> int:
    steps = _chosen(args.only)
    if args.list:
        return _list(steps, console)
    _offer_packages(steps, console)
    results = [_run_and_tell(step, console) for step in steps]
    passed = sum(result.passed for result in results)
    failed = sum(result.failed for result in results)
    console.json({"passed": passed, "failed": failed, "steps": [_record(result) for result in results]})
    console.print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


def _chosen(names: list[str] | None) -> list[Step]:
    known = {step.name: step for step in STEPS}
    for name in names or []:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
            raise BadInput(f"no step is called {name}", "--only", f"did you mean {near[0]}?" if near else
                           f"choose one of {', '.join(known)}")
    return [step for step in STEPS if not names or step.name in names]


def _list(steps: list[Step], console: Console) -> int:
    console.json([{"name": step.name, "what": step.what} for step in steps])
    for step in steps:
        console.print(f"{step.name:14} {step.what}")
    return 0


def _offer_packages(steps: list[Step], console: Console) -> None:
    """Installs the programs that only tests use where that is allowed; a step whose program is absent is skipped."""
    absent = absent_packages(steps)
    if not absent:
        return
    if system_packages.may_install():
        console.print(f"installing for the tests: {' '.join(absent)}")
        system_packages.install(absent, RESULTS / "packages.log")
    else:
        console.warn(f"some steps are skipped; to run them: {system_packages.install_line(absent)}")


def _run_and_tell(step: Step, console: Console) -> Result:
    with console.progress(step.name):
        result = run_step(step)
    counts = f"{result.passed} passed, {result.failed} failed" + (f", {result.skipped} skipped" if result.skipped else "")
    told = result.reason or counts
    console.print(f"{step.name:14} {result.verdict:8} {result.seconds:6.1f} s   {told}")
    if result.failed:
        console.print(tail(result.log, FAILURE_LINES))
        console.print(f"  (all of it: {result.log})")
    return result


def _record(result: Result) -> dict[str, object]:
    return {"step": result.step, "verdict": result.verdict, "passed": result.passed, "failed": result.failed,
            "skipped": result.skipped, "seconds": round(result.seconds, 3), "reason": result.reason,
            "log": str(result.log)}
