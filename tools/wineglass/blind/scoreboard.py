"""The scores as one HTML page that needs nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from wineglass.blind import bars, pictures

IN_TABLES = ("false_gap", "truth_in_set", "unique_and_wrong", "missed", "unknown_flagged", "place", "failed", "brier")


def render(scores: dict[str, Any], main: str) -> str:
    """scores: as in scores.json; main: the engine shown in detail."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["spoken"] = lambda name: name.replace("_", " ")
    environment.filters["value"] = _value
    environment.filters["interval"] = _interval
    environment.filters["limit"] = limit
    environment.filters["short"] = lambda value: f"{value:.3g}"
    engines = scores["engines"]
    chosen = engines[main]
    drawn = {"reliability": pictures.reliability(engines), "risk": pictures.risk(engines), "by_snr": pictures.by_snr(engines),
             "detection": pictures.detection(chosen), "confusion": pictures.confusion(chosen)}
    lines = [*chosen["bars"], *bars.beside(engines, main)]
    return environment.get_template("scoreboard.html.j2").render(scores=scores, main=main, engines=engines, chosen=chosen, pictures=drawn, bars=lines,
                                                                 in_tables=IN_TABLES)


def limit(line: dict[str, Any]) -> str:
    """A bar in words."""
    is_share = isinstance(line["measured"], dict)
    if line["protocol"] == "all":
        return f"{'above' if line['at_least'] else 'below'} {100 * line['limit']:.3g} %" if is_share else f"below {line['limit']:.3g}"
    return f"at {'least' if line['at_least'] else 'most'} {100 * line['limit']:.3g} %" if is_share else f"at {'least' if line['at_least'] else 'most'} {line['limit']:.3g}"


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
