"""Where a gap is: of what is named, the place that each effect has in the chain; of what is not, the stage that the channel reads."""

from __future__ import annotations

import numpy as np

from wineglass.diagnosis import confirmation
from wineglass.diagnosis.changes import Change
from wineglass.diagnosis.channels import unit_of
from wineglass.diagnosis.confirmation import Confirmed
from wineglass.diagnosis.contract import EffectFound, Region, Where
from wineglass.diagnosis.decisions import Outcome
from wineglass.diagnosis.noise_level import NoiseEvidence
from wineglass.diagnosis.twin_level import TwinAnalysis
from wineglass.diagnosis.vocabulary import component_of

PLACES = {"primary_in_phase": ("primary", "level"), "primary_quadrature": ("primary", "quadrature"), "drive_frequency": ("primary", "frequency"),
          "drive_level": ("primary", "level"), "secondary_in_phase": ("coupling", "in_phase"), "secondary_quadrature": ("coupling", "quadrature"),
          "rebalance_in_phase": ("coupling", "in_phase"), "rebalance_quadrature": ("coupling", "quadrature"), "rate": ("coupling", "in_phase"),
          "rate_uncompensated": ("coupling", "in_phase"), "quadrature": ("coupling", "quadrature"), "temperature_measured": ("temperature", "temperature")}
"""Where a gap that nothing explains is booked: the stage that the channel reads"""
LARGEST = 1e9  # of a ratio: where there is no noise at all


def where(found: TwinAnalysis, outcome: Outcome, confirmed: Confirmed, named: list[EffectFound], noise: NoiseEvidence | None) -> list[Where]:
    if outcome.verdict in ("no_gap", "insufficient"):
        return []
    places: dict[tuple[str, str], float] = {}
    slow = {e for closed in found.closed for e in closed.support}
    for effect in (e for e in named if e.id in slow):
        key = (effect.stage, component_of(effect.id))
        places[key] = places.get(key, 0.0) + effect.share
    rest = max(0.0, 1.0 - sum(places.values()))
    entries = [_named_place(found, confirmed, named, place, share) for place, share in places.items()]
    entries += _traces(found, confirmed, named, slow, noise, rest)
    if outcome.verdict == "unknown":
        entries += _unexplained(found, confirmed, rest if len(entries) == len(places) else 0.0)
    total = max(1.0, sum(w.share for w in entries))
    return sorted((w.model_copy(update={"share": w.share / total}) for w in entries), key=lambda w: -w.share)


def _traces(found: TwinAnalysis, confirmed: Confirmed, named: list[EffectFound], slow: set[str], noise: NoiseEvidence | None, rest: float) -> list[Where]:
    """Of the effects that only noise, lines, events or codes show: they share what slow channels do not. What none of these looks shows is in the channel with the
    largest gap."""
    mine = [e for e in named if e.id not in slow]
    time_s = found.grid.time_s
    whole = Region(variable="time", start=float(time_s[0]), stop=float(time_s[-1]), unit="s")
    worst = max(confirmed.changes, key=lambda c: c.in_floors if c.fraction is not None else 0.0)
    entries = []
    for effect in mine:
        seen = next((w for w in (noise.where if noise is not None else []) if w[0] == effect.stage), None)
        channel, component, ratio = (seen[1], seen[2], abs(float(seen[3]))) if seen else (worst.channel, component_of(effect.id), worst.in_floors)
        ratio = min(ratio, LARGEST)
        entries.append(Where(stage=effect.stage, channel=channel, component=component, share=rest / len(mine), region=whole, size=ratio,
                             unit="floor", ratio_over_floor=ratio))
    return entries


def _named_place(found: TwinAnalysis, confirmed: Confirmed, named: list[EffectFound], place: tuple[str, str], share: float) -> Where:
    """In the channel that shows most of these effects on held-out data; where several effects move it, their part of it. Where none is beyond its floor, in the
    channel of which most is foretold; where nothing is, in the one that they move most."""
    mine = {e.id for e in named if (e.stage, component_of(e.id)) == place}
    closed = next((c for c in found.closed if set(c.support) & mine), None)
    parts = confirmation.contributions(found, closed) if closed is not None else {}
    own = sum((parts[e] for e in mine if e in parts), np.zeros((len(found.names), found.grid.count)))
    energy, whole = np.sum(own**2, axis=1), sum((np.sum(part**2, axis=1) for part in parts.values()), np.zeros(len(found.names)))
    beyond, foretold = _excess(confirmed, [c.before for c in confirmed.changes]), np.array([max(0.0, c.foretold) for c in confirmed.changes])
    shown = next((weight for weight in (beyond, foretold) if weight.any()), whole)
    channel = int(np.argmax(shown * energy / np.maximum(whole, 1e-300)))
    return _place(found, *place, confirmed.changes[channel], share, own[channel])


def _excess(confirmed: Confirmed, sizes: list[float]) -> np.ndarray:
    """(channels,): energy on held-out data above the floor, in floors; of channels without a gap none. sizes: rms, before or after"""
    beyond = [max(0.0, (size / max(c.floor, 1e-300)) ** 2 - 1.0) if c.fraction is not None else 0.0 for c, size in zip(confirmed.changes, sizes, strict=True)]
    return np.array(beyond) * np.count_nonzero(confirmed.use, axis=1)


def _unexplained(found: TwinAnalysis, confirmed: Confirmed, rest: float) -> list[Where]:
    """What is left on held-out data, channel by channel, in the stage that the channel reads."""
    excess = _excess(confirmed, [c.after for c in confirmed.changes])
    total = float(excess.sum())
    order = [int(i) for i in np.argsort(-excess) if excess[i] > 0.05 * total]
    left = np.where(confirmed.use, confirmed.after, 0.0)
    return [_place(found, *PLACES[found.names[i]], confirmed.changes[i], rest * float(excess[i]) / total, left[i]) for i in order]


def _place(found: TwinAnalysis, stage: str, component: str, change: Change, share: float, series: np.ndarray) -> Where:
    return Where(stage=stage, channel=change.channel, component=component, share=min(1.0, share), region=_region(found, series),
                 size=change.before, unit=unit_of(change.channel), ratio_over_floor=change.in_floors)


def _region(found: TwinAnalysis, series: np.ndarray) -> Region:
    """The stretch of time that holds nine tenths of the energy."""
    time_s = found.grid.time_s
    energy = np.cumsum(series**2)
    if energy[-1] <= 0.0:
        return Region(variable="time", start=float(time_s[0]), stop=float(time_s[-1]), unit="s")
    low, high = np.searchsorted(energy, 0.05 * energy[-1]), np.searchsorted(energy, 0.95 * energy[-1])
    return Region(variable="time", start=float(time_s[low]), stop=float(time_s[min(high, len(time_s) - 1)]), unit="s")
