"""All marks of one engine into scores: every share with Wilson's interval, for everything and by tier, protocol and SNR."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from wineglass.blind import bars, limits
from wineglass.blind.figures import figures
from wineglass.blind.choices import CLEAR, DETECTABLE
from wineglass.blind.marks import Mark
from wineglass.blind.statistics import reliability, risk_over_coverage, share

SNR_EDGES = (DETECTABLE, CLEAR, 50.0, 200.0, 1000.0, float("inf"))


def score(marks: list[Mark]) -> dict[str, Any]:
    knowable = [one for one in marks if one.null or one.detectable]
    clear = [one for one in knowable if one.null or one.snr >= CLEAR]
    return {
        "cases": len(marks), "undetectable": _hidden([one for one in marks if not one.null and not one.detectable]), "bars": bars.reached(knowable), "failed": {one.case: one.error for one in marks if one.error}, "cpu_s": sum(one.cpu_s for one in marks),
        "clear": figures(clear), "all": figures(knowable),
        "by_tier": _by(knowable, lambda one: one.sheet.tier), "by_protocol": _by(clear, lambda one: one.sheet.protocol),
        "by_loop": _by(clear, lambda one: one.sheet.loop), "by_snr": dict(sorted(_by((one for one in knowable if not one.null), snr_bin).items(), key=lambda item: bin_start(item[0]))),
        "reliability": [{"confidence": one.confidence, "right": one.right.plain()} for one in
                        reliability([one.confidence for one in clear], [one.right for one in clear])],
        "risk_over_coverage": _risk(clear), "confusion": confusion(clear), "detection": limits.curves(marks),
        "worst": [_in_short(one) for one in worst(clear)],
    }


def _hidden(marks: list[Mark]) -> dict[str, Any]:
    """Of cases whose effects a healthy unit could have as well; nothing to be found, yet nothing wrong to be said of them either."""
    return {"cases": len(marks), "claimed": share([one.gap for one in marks]).plain(), "unique_and_wrong": share([one.unique_wrong for one in marks]).plain()}


def snr_bin(one: Mark) -> str:
    low, high = next((low, high) for low, high in zip(SNR_EDGES, SNR_EDGES[1:]) if low <= one.snr < high)
    return f"{low:g} to {high:g}" if high < float("inf") else f"from {low:g}"


def bin_start(name: str) -> float:
    return float(name.removeprefix("from ").split(" ")[0])


def confusion(marks: Iterable[Mark]) -> dict[str, dict[str, int]]:
    """Singles: true effect -> what was answered -> how often."""
    found: dict[str, dict[str, int]] = {}
    for one in marks:
        if one.sheet.tier == "single":
            row = found.setdefault(one.sheet.effects[0].id, {})
            said = answered(one)
            row[said] = row.get(said, 0) + 1
    return dict(sorted(found.items()))


def answered(one: Mark) -> str:
    """In a word: an effect alone, several at once, in doubt with or without the truth, nothing, or unknown."""
    if one.verdict == "ambiguous":
        return "in doubt, truth among them" if one.in_set else "in doubt, truth not among them"
    if one.verdict == "attributed":
        ids = one.claims[0]
        return next(iter(ids)) if len(ids) == 1 else ("truth and more" if one.truth < ids else "several others")
    return one.verdict


def worst(marks: list[Mark], most: int = 40) -> list[Mark]:
    """Named wrongly with most confidence, false gaps, then what failed or was missed."""
    wrong = [one for one in marks if one.unique_wrong or (one.null and one.gap) or one.error or (not one.null and not one.right)]
    return sorted(wrong, key=lambda one: (not one.unique_wrong, not one.null, -one.confidence, -one.snr))[:most]


def _in_short(one: Mark) -> dict[str, Any]:
    effects = [f"{e.id}/{e.variant} {e.strength:g}" for e in one.sheet.effects]
    return {"case": one.case, "tier": one.sheet.tier, "protocol": one.sheet.protocol, "loop": one.sheet.loop, "seed": one.sheet.seed, "effects": effects,
            "factor": one.sheet.factor, "snr": one.snr, "channel": one.channel, "verdict": one.verdict,
            "claims": [sorted(ids) for ids in one.claims], "best": sorted(one.best), "confidence": one.confidence, "error": one.error,
            "unique_wrong": one.unique_wrong, "sentence": one.sentence}


def _by(marks: Iterable[Mark], key: Callable[[Mark], str]) -> dict[str, Any]:
    groups: dict[str, list[Mark]] = {}
    for one in marks:
        groups.setdefault(key(one), []).append(one)
    return {name: {"cases": len(group), **figures(group)} for name, group in sorted(groups.items())}


def _risk(marks: list[Mark]) -> dict[str, list[float]]:
    coverage, risk = risk_over_coverage([one.confidence for one in marks], [not one.right for one in marks])
    return {"coverage": coverage.tolist(), "risk": risk.tolist()}
