"""The figures of a measurement by name, those of a commit (tests/golden/cost.json), and their bars."""

from __future__ import annotations

import json
import subprocess
from typing import TYPE_CHECKING

from wineglass import atomic, paths
from wineglass.cost import image, rows
from wineglass.errors import BadInput

if TYPE_CHECKING:
    from wineglass.cost.measure import Cost

FILE = paths.repository_root() / "tests" / "golden" / "cost.json"

IMAGE = "STM32F405 image, "
_WHAT_COSTS = ("firmware", "hal", "cmake", "tests/target/kernels.c")

BARS: dict[str, float] = {
    **{f"{kernel.name}, worst": kernel.worst_bar for kernel in rows.KERNELS if kernel.worst_bar is not None},
    **rows.BARS,
    f"{IMAGE}flash, bytes": image.FLASH_BAR_BYTES,
    f"{IMAGE}memory with stack, bytes": image.MEMORY_BAR_BYTES,
}


def figures(cost: Cost) -> dict[str, float]:
    """Every figure in the order of the table; means to a tenth."""
    found: dict[str, float] = {}
    for name, count in (*cost.kernels.items(), *cost.sample.items(), ("application_poll", cost.background)):
        found[f"{name}, mean"] = round(count.mean, 1)
        found[f"{name}, worst"] = count.worst
    core = cost.core
    found |= {"flash, bytes": core.flash_bytes, "memory, bytes": core.memory_bytes, "stack, bytes": core.stack_bytes,
              "software division and floating point, functions": len(core.forbidden),
              f"{IMAGE}flash, bytes": cost.image.flash_bytes,
              f"{IMAGE}memory with stack, bytes": cost.image.memory_bytes,
              f"{IMAGE}stack bound, bytes": cost.image.stack_bytes}
    return found


def missed(found: dict[str, float]) -> list[str]:
    """Figures above their bars, as text."""
    return [f"{name} is {found[name]:g}, bar {bar:g}" for name, bar in BARS.items() if name in found and found[name] > bar]


def load(revision: str | None = None) -> tuple[str, dict[str, float]]:
    """The figures that a commit kept, and which one it was. None: the last commit while something that costs is changed, else the one
    before it; the file as it stands where there is no history."""
    root = FILE.parents[2]
    if revision is None:
        clean = subprocess.run(["git", "diff", "--quiet", "HEAD", "--", *_WHAT_COSTS], cwd=root, capture_output=True, check=False)
        revision = "HEAD~" if clean.returncode == 0 else "HEAD"
        found = _show(revision)
        return (revision, found) if found is not None else ("the file", _read())
    found = _show(revision)
    if found is None:
        raise BadInput("no counts are kept there", f"--against {revision}", f"give a commit that has {FILE.relative_to(root)}")
    return revision, found


def _show(revision: str) -> dict[str, float] | None:
    root = FILE.parents[2]
    done = subprocess.run(["git", "show", f"{revision}:{FILE.relative_to(root)}"], cwd=root, capture_output=True, text=True, check=False)
    return json.loads(done.stdout) if done.returncode == 0 else None


def _read() -> dict[str, float]:
    try:
        return json.loads(FILE.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}


def save(found: dict[str, float]) -> None:
    FILE.parent.mkdir(exist_ok=True)
    atomic.write_text(FILE, json.dumps(found, indent=2) + "\n")
