"""The figures of a measurement by name, those of the last commit (tests/golden/cost.json), and their bars."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from wineglass import atomic, paths
from wineglass.cost import rows

if TYPE_CHECKING:
    from wineglass.cost.measure import Cost

FILE = paths.repository_root() / "tests" / "golden" / "cost.json"

BARS: dict[str, float] = {
    **{f"{kernel.name}, worst": kernel.worst_bar for kernel in rows.KERNELS if kernel.worst_bar is not None},
    **rows.BARS,
}


def figures(cost: Cost) -> dict[str, float]:
    """Every figure in the order of the table; means to a tenth."""
    found: dict[str, float] = {}
    for name, count in (*cost.kernels.items(), *cost.sample.items(), ("application_poll", cost.background)):
        found[f"{name}, mean"] = round(count.mean, 1)
        found[f"{name}, worst"] = count.worst
    core = cost.core
    found |= {"flash, bytes": core.flash_bytes, "memory, bytes": core.memory_bytes, "stack, bytes": core.stack_bytes,
              "software division and floating point, functions": len(core.forbidden)}
    return found


def missed(found: dict[str, float]) -> list[str]:
    """Figures above their bars, as text."""
    return [f"{name} is {found[name]:g}, bar {bar:g}" for name, bar in BARS.items() if name in found and found[name] > bar]


def load() -> dict[str, float]:
    try:
        return json.loads(FILE.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}


def save(found: dict[str, float]) -> None:
    FILE.parent.mkdir(exist_ok=True)
    atomic.write_text(FILE, json.dumps(found, indent=2) + "\n")
