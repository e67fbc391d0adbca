"""View -> HTML text: one page that needs nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wineglass.diagnosis import curves
from wineglass.diagnosis.contract import Hypothesis
from wineglass.diagnosis.vocabulary import EFFECTS, NONE, OTHER
from wineglass.report import figures
from wineglass.report.view import View

CHAIN = ("environment", "primary", "coupling", "secondary", "pickoff", "clock", "firmware")
BESIDE = ("actuation", "temperature")


def render(view: View) -> str:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
                              lstrip_blocks=True)
    environment.filters["short"] = lambda value: f"{value:.3g}"
    environment.filters["percent"] = _percent
    environment.globals["parted"] = curves.parted
    environment.filters["spoken"] = lambda name: name.replace("_", " ")
    pictures = {} if not view.channels else {
        "time": figures.over_time(view), "map": figures.over_temperature_and_slope(view), "spectrum": figures.spectrum(view),
        "ambiguity": figures.ambiguity(view), "branches": view.branches, "channel": view.worst[0].name, "shown": len(view.worst[:figures.MOST_CHANNELS]),
    }
    return environment.get_template("page.html.j2").render(
        d=view.diagnosis, pictures=pictures, chain=[_stage(name, view) for name in CHAIN], beside=[_stage(name, view) for name in BESIDE],
        says={name: entry.says for name, entry in EFFECTS.items()}, samples=view.samples, hypotheses=_worth_listing(view),
    )


def _worth_listing(view: View) -> list[Hypothesis]:
    """What has at least a hundredth, and none and other."""
    return [h for h in view.diagnosis.hypotheses if h.probability >= 0.01 or h.ids in ([NONE], [OTHER])]


def _percent(value: float) -> str:
    if 0.0 < value < 0.01:
        return "< 1 %"
    if 0.99 < value < 1.0:
        return f"{np.floor(1000.0 * value) / 10.0:.1f} %"
    return f"{100.0 * value:z.0f} %"


def _stage(name: str, view: View) -> dict[str, object]:
    share = sum(w.share for w in view.diagnosis.where if w.stage == name)
    components = sorted({w.component for w in view.diagnosis.where if w.stage == name and w.share >= 0.005})
    return {"name": name, "share": share, "seen": name in view.seen and view.diagnosis.verdict != "insufficient", "shade": f"{min(1.0, 0.85 * share):.2f}", "components": components}
