"""What the diagnosis has to reach, line by line, and whether it does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from wineglass.blind.choices import CLEAR
from wineglass.blind.figures import figures
from wineglass.blind.marks import Mark


@dataclass(frozen=True)
class Bar:
    """score: a name of `figures`; limit: at most (or at least) this; protocol, snr: of which cases, nulls have no SNR"""

    name: str
    score: str
    limit: float
    at_least: bool
    protocol: str = "full"
    snr: float = CLEAR

    def reached(self, value: float) -> bool:
        return value >= self.limit if self.at_least else value <= self.limit


BARS = (
    Bar("false gap, hard nulls included", "false_gap", 0.01, False),
    Bar("truth in set", "truth_in_set", 0.99, True),
    Bar("unique and wrong", "unique_and_wrong", 0.01, False),
    Bar("pairs exact", "pairs_exact", 0.95, True),
    Bar("unknown flagged, SNR 50", "unknown_flagged", 0.97, True, snr=50.0),
    Bar("unknown flagged, SNR 200", "unknown_flagged", 0.995, True, snr=200.0),
    Bar("place", "place", 0.98, True),
    Bar("held-out gap removed, median", "removed_median", 0.98, True),
    Bar("residual over floor, median", "residual_median", 1.1, False),
    Bar("Brier", "brier", 0.05, False),
    Bar("ECE", "ece", 0.03, False),
    Bar("operating: unique and wrong", "unique_and_wrong", 0.01, False, protocol="operating"),
)
BASELINES = (("brier", False), ("truth_in_set", True))


def reached(marks: list[Mark]) -> list[dict[str, Any]]:
    """A line per bar: name, limit, at_least, measured (a share as in `figures`, a number or null), reached (null: nothing to measure)."""
    return [_line(bar, figures(_of(bar, marks))[bar.score]) for bar in BARS]


def _of(bar: Bar, marks: list[Mark]) -> list[Mark]:
    return [one for one in marks if one.sheet.protocol == bar.protocol and (one.null or one.snr >= bar.snr)]


def _line(bar: Bar, measured: Any) -> dict[str, Any]:
    value = measured["value"] if isinstance(measured, dict) else measured
    return {"name": bar.name, "limit": bar.limit, "at_least": bar.at_least, "protocol": bar.protocol, "snr": bar.snr, "measured": measured,
            "reached": None if value is None else bar.reached(value)}


def beside(engines: dict[str, dict[str, Any]], main: str) -> list[dict[str, Any]]:
    """Lines that say whether every other engine is behind, on clear cases."""
    found: list[dict[str, Any]] = []
    for score, more_is_better in BASELINES:
        values = {name: _number(one["clear"][score]) for name, one in engines.items()}
        others = {name: value for name, value in values.items() if name not in (main, "twin") and value is not None}
        if others and values[main] is not None:
            better: Callable[..., str] = max if more_is_better else min
            best = better(others, key=others.__getitem__)
            ahead = values[main] > others[best] if more_is_better else values[main] < others[best]
            found.append({"name": f"ahead of the best baseline ({best}): {score}", "limit": others[best], "at_least": more_is_better, "protocol": "all",
                          "snr": CLEAR, "measured": engines[main]["clear"][score], "reached": ahead})
    return found


def _number(score: Any) -> float | None:
    return score["value"] if isinstance(score, dict) else score
