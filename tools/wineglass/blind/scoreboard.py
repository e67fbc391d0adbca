"""The scores as one HTML page that needs nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from wineglass.blind import pictures

# What a score has to reach; (name, bar as text, does the value reach it). Shares by value, others by number.
BARS = {
    "false_gap": ("at most 1 %", lambda value: value <= 0.01), "truth_in_set": ("at least 99 %", lambda value: value >= 0.99),
    "unique_and_wrong": ("at most 1 %", lambda value: value <= 0.01), "pairs_exact": ("at least 95 %", lambda value: value >= 0.95),
    "unknown_flagged": ("at least 97 %", lambda value: value >= 0.97), "place": ("at least 98 %", lambda value: value >= 0.98),
    "removed_median": ("at least 0.98", lambda value: value >= 0.98), "residual_median": ("at most 1.1", lambda value: value <= 1.1),
    "brier": ("at most 0.05", lambda value: value <= 0.05), "ece": ("at most 0.03", lambda value: value <= 0.03),
}
IN_TABLES = ("false_gap", "truth_in_set", "unique_and_wrong", "missed", "unknown_flagged", "place", "failed", "brier")


def render(scores: dict[str, Any], main: str) -> str:
    """scores: as in scores.json; main: the engine shown in detail."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["spoken"] = lambda name: name.replace("_", " ")
    environment.filters["value"] = _value
    environment.filters["interval"] = _interval
    environment.filters["short"] = lambda value: f"{value:.3g}"
    engines = scores["engines"]
    chosen = engines[main]
    drawn = {"reliability": pictures.reliability(engines), "risk": pictures.risk(engines), "by_snr": pictures.by_snr(engines),
             "detection": pictures.detection(chosen), "confusion": pictures.confusion(chosen)}
    bars = {name: (text, _reached(chosen["clear"][name], reaches)) for name, (text, reaches) in BARS.items()}
    return environment.get_template("scoreboard.html.j2").render(scores=scores, main=main, engines=engines, chosen=chosen, pictures=drawn, bars=bars,
                                                                 in_tables=IN_TABLES)


def _reached(score: Any, reaches: Any) -> bool | None:
    """None: there was nothing to measure."""
    value = score["value"] if isinstance(score, dict) else score
    return None if value is None else bool(reaches(value))


def _value(score: Any) -> str:
    if score is None:
        return "–"
    if not isinstance(score, dict):
        return f"{score:.3f}"
    return f"{100 * score['value']:.1f} %" if score["n"] else "–"


def _interval(score: Any) -> str:
    if not isinstance(score, dict) or not score["n"]:
        return ""
    low, high = score["interval"]
    return f"{score['k']} of {score['n']}, {100 * low:.1f} to {100 * high:.1f} %"
