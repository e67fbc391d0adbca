"""Diagnosis and analysis -> HTML text."""

from __future__ import annotations

from pathlib import Path

from wineglass.diagnosis.contract import Diagnosis
from wineglass.diagnosis.evidence import Evidence
from wineglass.diagnosis.rate_level import Analysis
from wineglass.diagnosis.vocabulary import EFFECTS, STAGES
from wineglass.report import figures

CHAIN = ("environment", "primary", "coupling", "secondary", "pickoff", "clock", "firmware")
BESIDE = ("actuation", "temperature")
SEEN_BY = {"rate_level": {"coupling", "temperature"}}  # stages that the engine's effects reach


def render(evidence: Evidence, found: Analysis | None, diagnosis: Diagnosis) -> str:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
                              lstrip_blocks=True)
    environment.filters["short"] = lambda value: f"{value:.3g}"
    environment.filters["percent"] = _percent
    pictures = {} if found is None else {
        "time": figures.over_time(found), "map": figures.over_temperature_and_slope(found), "spectrum": figures.spectrum(found),
        "ambiguity": figures.ambiguity(diagnosis, found), "branches": figures.branches(found.blocks),
    }
    return environment.get_template("page.html.j2").render(
        d=diagnosis, pictures=pictures, chain=[_stage(name, diagnosis, evidence) for name in CHAIN], beside=[_stage(name, diagnosis, evidence) for name in BESIDE],
        says={name: entry.says for name, entry in EFFECTS.items()}, samples=len(evidence.time_s),
    )


def _percent(value: float) -> str:
    if 0.0 < value < 0.01:
        return "< 1 %"
    return f"{100.0 * value:.0f} %"


def _stage(name: str, diagnosis: Diagnosis, evidence: Evidence) -> dict[str, object]:
    seen = set(SEEN_BY.get(diagnosis.provenance.engine, STAGES)) | ({"environment"} if evidence.true_rate_rad_s is not None else set())
    share = sum(w.share for w in diagnosis.where if w.stage == name)
    return {"name": name, "share": share, "seen": name in seen,
            "shade": f"{min(1.0, share):.2f}"}
