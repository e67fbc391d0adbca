"""The scores of some cases."""

from __future__ import annotations

from statistics import fmean, median
from typing import Any

from wineglass.blind.marks import Mark
from wineglass.blind.statistics import calibration_error, share


def figures(marks: list[Mark]) -> dict[str, Any]:
    """The scores of some cases. Shares: {k, n, value, interval}; others numbers or null."""
    nulls, gaps = [one for one in marks if one.null], [one for one in marks if not one.null]
    known = [one for one in gaps if one.in_catalogue]
    pairs, outside = [one for one in gaps if one.sheet.tier == "pair" and len(one.truth) == 2], [one for one in gaps if not one.in_catalogue]
    removed = [one.removed for one in known if one.removed is not None and one.verdict in ("attributed", "ambiguous")]
    residual = [one.residual for one in known if one.residual is not None and one.verdict in ("attributed", "ambiguous")]
    shares = {
        "false_gap": share([one.gap for one in nulls]),
        "truth_in_set": share([one.in_set for one in known]),
        "unique_and_wrong": share([one.unique_wrong for one in gaps]),
        "unique_and_right": share([one.in_set and len(one.claims) == 1 for one in known]),
        "missed": share([not one.gap for one in gaps]),
        "pairs_exact": share([one.claims == (one.truth,) for one in pairs]),
        "unknown_flagged": share([one.flagged for one in outside]),
        "unknown_flagged_falsely": share([one.flagged for one in known]),
        "place": share([one.place_right for one in gaps]),
        "interval_coverage": share([inside for one in gaps for _, inside in one.covered]),
        "failed": share([bool(one.error) for one in marks]),
    }
    return {**{name: value.plain() for name, value in shares.items()},
            "removed_median": median(removed) if removed else None, "residual_median": median(residual) if residual else None,
            "brier": fmean(one.brier for one in marks) if marks else None,
            "ece": calibration_error([one.confidence for one in marks], [one.right for one in marks])}
