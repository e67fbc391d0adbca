"""`wineglass cost`: what the firmware costs on a Cortex-M4."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from wineglass.console import Console

if TYPE_CHECKING:
    from wineglass.cost.measure import Cost

HELP = "count what the firmware costs on an emulated Cortex-M4: instructions of every kernel, flash, memory, stack"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--update", action="store_true", help="write the counts to tests/golden/cost.json, the table to compare with")
    parser.add_argument("--against", metavar="REV", help="compare with the counts of this commit (default: the previous one, or the last while the firmware is changed)")
    parser.add_argument("--check", action="store_true", help="exit status 1 if a figure is above its bar")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.cost import golden, measure

    revision, before = golden.load(args.against)
    with console.progress("counting instructions"):
        cost = measure.measure()
    figures = golden.figures(cost)
    missed = golden.missed(figures)
    _print(cost, figures, before, console)
    console.print(_changes(figures, before, revision))
    console.json({"figures": figures, "against": revision, "before": before, "image_stack_paths": [path.path for path in cost.image.paths], "by_slot": cost.by_slot, "stack_path": cost.core.stack_path,
                  "library_functions": cost.core.library_functions, "missed": missed})
    if args.update:
        golden.save(figures)
    for text in missed:
        console.print(f"above its bar: {text}")
    return 1 if args.check and missed else 0


def _print(cost: Cost, figures: dict[str, float], before: dict[str, float], console: Console) -> None:
    from wineglass.cost import golden, rows

    peers = {kernel.name: kernel.peers for kernel in rows.KERNELS}

    def cell(name: str) -> tuple[str, str]:
        bar = golden.BARS.get(name)
        return _with_change(figures[name], before.get(name)), "" if bar is None else f"{bar:g}"

    calls = []
    for name in (figure.removesuffix(", mean") for figure in figures if figure.endswith(", mean")):
        mean, mean_bar = cell(f"{name}, mean")
        worst, worst_bar = cell(f"{name}, worst")
        calls.append((name, mean, mean_bar, worst, worst_bar, peers.get(name, "")))
    console.table(f"Instructions executed by one call, Cortex-M4, {cost.compiler} -O2", ["function", "mean", "bar", "worst", "bar", "others"], calls)
    sizes = [name for name in figures if not name.endswith((", mean", ", worst"))]
    console.table("Core without application", ["what", "now", "bar"], [(name, *cell(name)) for name in sizes if not name.startswith(golden.IMAGE)])
    console.table("Image for the STM32F405", ["what", "now", "bar"],
                  [(name.removeprefix(golden.IMAGE), *cell(name)) for name in sizes if name.startswith(golden.IMAGE)])
    for mode, slots in cost.by_slot.items():
        console.print(f"worst of each sample of a slow period, {mode}: {' '.join(map(str, slots))}")
    console.print(f"deepest stack of the core: {' -> '.join(cost.core.stack_path)}")
    for worst in cost.image.paths:
        console.print(f"deepest stack of the image, {worst.bytes} bytes of {cost.image.stack_reserved_bytes}: {' -> '.join(worst.path)}")
    console.print(f"library functions in the core: {', '.join(cost.core.library_functions) or 'none'}")


def _changes(figures: dict[str, float], before: dict[str, float], revision: str) -> str:
    """One line for a commit message or a log."""
    changed = [f"{name} {before[name]:g} -> {figures[name]:g}" for name in figures if name in before and figures[name] != before[name]]
    return f"against {revision}: {'; '.join(changed) or 'nothing has changed'}"


def _with_change(value: float, before: float | None) -> str:
    return f"{value:g}" if before is None or value == before else f"{value:g} ({value - before:+g})"
