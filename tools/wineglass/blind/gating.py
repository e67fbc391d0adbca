"""Engines that only rank explanations and say how large the gap is: the threshold for a gap is set so that they have as many false gaps as the diagnosis.

The threshold, and how likely a null is on either side of it, come from the scored set itself: to their advantage."""

from __future__ import annotations

from typing import Any

import numpy as np


def gate(answers: dict[str, dict[str, Any]], nulls: set[str], false_gaps: float) -> dict[str, dict[str, Any]]:
    """Answers below the threshold become `no_gap`. nulls: names of the cases without effect; false_gaps: share of them that may lie above."""
    limit = threshold([answers[name]["gap_statistic"] for name in sorted(nulls)], false_gaps)
    above = {name for name, one in answers.items() if one["gap_statistic"] > limit}
    none = {True: _share(above & nulls, above), False: _share(nulls - above, set(answers) - above)}
    return {name: {**one, "diagnosis": _gated(one["diagnosis"], name in above, none[name in above])} for name, one in answers.items()}


def threshold(nulls: list[float], false_gaps: float) -> float:
    """Smallest of the nulls' own values that no more than this share of them exceed."""
    ordered = np.sort(np.asarray(nulls, float))
    if not len(ordered):
        return -np.inf
    return float(ordered[len(ordered) - 1 - int(false_gaps * len(ordered) + 1e-9)]) if false_gaps < 1.0 else -np.inf


def _share(part: set[str], whole: set[str]) -> float:
    """Never quite 0 or 1: a set says no more than its size."""
    return (len(part) + 0.5) / (len(whole) + 1.0)


def _gated(diagnosis: dict[str, Any], gap: bool, none: float) -> dict[str, Any]:
    weights = [{**one, "probability": none if one["ids"] == ["none"] else (1.0 - none) * one["probability"]} for one in diagnosis["hypotheses"]]
    if gap:
        return {**diagnosis, "hypotheses": weights}
    return {**diagnosis, "hypotheses": weights, "verdict": "no_gap", "effects": [], "alternatives": [], "where": []}
