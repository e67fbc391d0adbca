"""One answer held against its opened label."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from wineglass.blind import equivalents, generator
from wineglass.blind.choices import DETECTABLE
from wineglass.blind.sheet import NULLS, Sheet
from wineglass.blind.statistics import brier

NONE, OTHER = frozenset({"none"}), frozenset({"other"})
NO_CLAIM = ("no_gap", "insufficient")


@dataclass(frozen=True)
class Mark:
    """snr: of the weakest effect that can be known at all, beyond what a healthy unit could do
    detectable: can any?
    truth: ids of these, `none` of a null, `other` for what is not in the catalogue
    claims: explanations that the answer holds possible; empty where it claims nothing
    in_set: the truth is among the claims; unique_wrong: one claim alone, and it names what is not so
    right: the likeliest hypothesis is the truth (or, where nobody can tell twins apart, one of them)
    covered: per parameter that truth and diagnosis both have, whether the 95 % interval holds the truth"""

    case: str
    sheet: Sheet
    snr: float
    detectable: bool
    channel: str
    truth: frozenset[str]
    verdict: str
    claims: tuple[frozenset[str], ...]
    in_set: bool
    unique_wrong: bool
    flagged: bool
    place: str
    place_right: bool
    confidence: float
    right: bool
    brier: float
    removed: float | None
    residual: float | None
    covered: tuple[tuple[str, bool], ...]
    best: frozenset[str]
    sentence: str
    error: str
    cpu_s: float
    gap_statistic: float | None

    @property
    def null(self) -> bool:
        return self.sheet.tier in NULLS

    @property
    def gap(self) -> bool:
        """Was a gap claimed?"""
        return self.verdict not in (*NO_CLAIM, "error")

    @property
    def in_catalogue(self) -> bool:
        return not self.null and "other" not in self.truth


def mark(label: dict[str, Any], answer: dict[str, Any]) -> Mark:
    sheet = Sheet.model_validate(label["sheet"])
    seen = seen_of(label["grade"], sheet)
    truth = truth_of(sheet, seen)
    found = answer.get("diagnosis")
    common = {"case": sheet.name, "sheet": sheet, "snr": min((snr for snr in seen.values()), default=label["grade"]["snr"]),
              "detectable": bool(seen), "channel": label["grade"]["channel"], "truth": truth, "error": answer.get("error", ""), "cpu_s": answer.get("cpu_s", 0.0), "gap_statistic": answer.get("gap_statistic")}
    if found is None:
        return Mark(**common, verdict="error", claims=(), in_set=False, unique_wrong=False, flagged=False, place="", place_right=False, confidence=0.0,
                    right=False, brier=1.0, removed=None, residual=None, covered=(), best=frozenset(), sentence="")
    probabilities = {frozenset(one["ids"]): one["probability"] for one in found["hypotheses"]}
    best, claims, accepted = max(probabilities, key=probabilities.__getitem__), claims_of(found), truths_of(sheet, seen)
    twins = {frozenset(one) for one in sheet.twins} - {truth}
    place = max(found["where"], key=lambda one: one["share"])["stage"] if found["where"] else ""
    return Mark(
        **common, verdict=found["verdict"], claims=claims, in_set=any(one in claims for one in accepted - twins), unique_wrong=_wrong_alone(claims, accepted),
        flagged=found["verdict"] == "unknown", place=place, place_right=place in stages_of(sheet), confidence=probabilities[best], right=best in accepted,
        brier=brier(probabilities, max(accepted - twins, key=lambda ids: (probabilities.get(ids, 0.0), ids == truth))), removed=found["shrink"]["all"]["fraction"], residual=_residual(found), best=best, sentence=found["sentence"],
        covered=tuple(equivalents.covered(sheet.effects[0], found["effects"], equivalents.Day(sheet, label.get("unit", {})))) if sheet.tier == "single" else ())


def _wrong_alone(claims: tuple[frozenset[str], ...], accepted: set[frozenset[str]]) -> bool:
    """One claim that is not true. `unknown` by itself claims nothing wrong; effects named with it may be wrong."""
    if len(claims) != 1 or claims[0] in accepted:
        return False
    return "other" not in claims[0] or not any(claims[0] - OTHER <= truth for truth in accepted)


def seen_of(grade: dict[str, Any], sheet: Sheet) -> dict[int, float]:
    """SNR of the effects, by place, that are more than a healthy unit could do. Where only all together are, they are all of it."""
    each = grade.get("effects") or [{"snr": grade["snr"]} for _ in sheet.effects]
    found = {place: one["snr"] for place, one in enumerate(each) if one["snr"] >= DETECTABLE}
    if not found and grade["snr"] >= DETECTABLE:
        return dict.fromkeys(range(len(each)), grade["snr"])
    return found


def truth_of(sheet: Sheet, places: Iterable[int] | None = None) -> frozenset[str]:
    """places: of the effects that count; None: all. Of a case without any: `none`."""
    effects = sheet.effects if places is None else [sheet.effects[place] for place in places]
    known = frozenset(one.id for one in effects if one.id in _catalogue())
    return (known | OTHER if len(known) < len(effects) else known) or NONE


def truths_of(sheet: Sheet, seen: Iterable[int]) -> set[frozenset[str]]:
    """What nobody could be blamed for naming: what can be known, with or without what is there but cannot, or a twin of it."""
    seen = set(seen)
    hidden = [place for place in range(len(sheet.effects)) if place not in seen]
    more = [set(some) for count in range(len(hidden) + 1) for some in combinations(hidden, count)]
    return {*(truth_of(sheet, seen | some) for some in more), *(frozenset(one) for one in sheet.twins)}


def claims_of(found: dict[str, Any]) -> tuple[frozenset[str], ...]:
    """Of `unknown`: what is known of it, with `other`."""
    if found["verdict"] in NO_CLAIM:
        return ()
    if found["verdict"] == "ambiguous":
        return tuple(frozenset(ids) for ids in found["alternatives"])
    named = frozenset(one["id"] for one in found["effects"])
    return (named | OTHER if found["verdict"] == "unknown" else named,)


def stages_of(sheet: Sheet) -> set[str]:
    """Where it truly is, or where nobody could tell that it is not."""
    stages = {generator.find(one.id, one.variant).stage for one in sheet.effects}
    return stages | {generator.variants(id)[0].stage for ids in sheet.twins for id in ids}


def _catalogue() -> set[str]:
    return set(generator.ids(in_catalogue=True))


def _residual(found: dict[str, Any]) -> float | None:
    """What is left on held-out data over the floor."""
    total = found["shrink"]["all"]
    return total["after"] / total["floor"] if total["after"] is not None and total["floor"] else None
