"""What the report draws, whichever engine found it: channels with their gap before and after, what drove them, and how alike the explanations look.

    page.render(view.of_rate_level(evidence, analysis, diagnosis))
    page.render(view.of_twin_level(examined))
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from wineglass.diagnosis.contract import Diagnosis
from wineglass.diagnosis.vocabulary import OTHER, STAGES

if TYPE_CHECKING:
    from wineglass.diagnosis.evidence import Evidence
    from wineglass.diagnosis.rate_level import Analysis
    from wineglass.diagnosis.twin_engine import Examined

RATE_STAGES = frozenset({"coupling", "temperature"})


@dataclass(frozen=True)
class Channel:
    """Arrays (n,) on the view's time. before, after: recorded minus twin, NaN where they are not used; floor: rms of noise"""

    name: str
    unit: str
    before: np.ndarray
    after: np.ndarray
    floor: float

    @property
    def ratio(self) -> float:
        """Gap before over the floor."""
        values = self.before[np.isfinite(self.before)]
        return float(np.sqrt(np.mean(values**2)) / max(self.floor, 1e-300)) if len(values) else 0.0


@dataclass(frozen=True)
class Alikeness:
    """matrix (k, k): correlation of what the named explanations do, beyond what nuisances take"""

    names: list[str]
    matrix: np.ndarray


@dataclass(frozen=True)
class View:
    """time_s, temperature_degc (n,); rate_deg_s, amplitude_fs (n,) or None where they are not known or do not change; held (n,): the held-out stretch,
    None where every stretch is held out once; seen: stages that this recording can show."""

    diagnosis: Diagnosis
    samples: str
    seen: frozenset[str]
    time_s: np.ndarray = field(default_factory=lambda: np.zeros(0))
    temperature_degc: np.ndarray = field(default_factory=lambda: np.zeros(0))
    rate_deg_s: np.ndarray | None = None
    amplitude_fs: np.ndarray | None = None
    held: np.ndarray | None = None
    channels: list[Channel] = field(default_factory=list)
    best: tuple[str, ...] = ()
    branches: str = ""
    alike: Alikeness | None = None

    @property
    def worst(self) -> list[Channel]:
        """Channels with a gap, the largest in floors first; the largest of all where none has one."""
        order = sorted(self.channels, key=lambda c: -c.ratio)
        with_gap = {c.channel for c in self.diagnosis.shrink.channels if c.fraction is not None}
        return [c for c in order if c.name in with_gap] or order[:1]


def of_rate_level(evidence: Evidence, found: Analysis | None, diagnosis: Diagnosis) -> View:
    seen = RATE_STAGES | ({"environment"} if evidence.true_rate_rad_s is not None else frozenset())
    samples = f"{len(evidence.time_s)} samples"
    if found is None:
        return View(diagnosis, samples, seen)
    blocks = found.blocks
    turning = None if blocks.fine_true_rate is None else np.degrees(blocks.mean(blocks.fine_true_rate))
    return View(
        diagnosis, samples, seen, blocks.time_s, blocks.temperature_degc, _moving(turning), None, None if found.split.held.mean() > 0.7 else found.split.held,
        [Channel("rate", "rad/s", found.before, found.after, found.floor.rms)], found.best,
        "; ".join(f"{b.kind} {blocks.time_s[b.start] / 60:.3g} to {blocks.time_s[b.stop - 1] / 60:.3g} min" for b in blocks.branches),
        _alike_at_rate_level(found, diagnosis))


def of_twin_level(examined: Examined) -> View:
    found, verdict = examined.analysis, examined.verdict
    confirmed = verdict.confirmed
    run, time_s = found.driven.run, found.grid.time_s
    channels = [Channel(change.channel, _unit(verdict.diagnosis, change.channel), *(np.where(use, values, np.nan) for values in (before, after)), change.floor)
                for change, before, after, use in zip(confirmed.changes, confirmed.before, confirmed.after, confirmed.use)]
    amplitude = found.recorded["primary_in_phase"] if "primary_in_phase" in found.recorded.names else None
    best = verdict.outcome.chosen.support if verdict.outcome.chosen is not None else ()
    return View(verdict.diagnosis, f"{found.grid.count} frames of {found.grid.frame_s:g} s", frozenset(STAGES), time_s, run.scenario.temperature.at(time_s),
                _moving(np.degrees(run.scenario.rate.at(time_s))) if found.driven.rate_known else None, _moving(amplitude, 0.02), None, channels, tuple(best), "",
                _alike_at_twin_level(examined))


def _unit(diagnosis: Diagnosis, channel: str) -> str:
    return next((c.unit for c in diagnosis.shrink.channels if c.channel == channel), "")


def _moving(values: np.ndarray | None, least: float = 1e-3) -> np.ndarray | None:
    if values is None or not len(values):
        return None
    low, high = np.quantile(values, [0.01, 0.99])  # a start-up is no step
    return values if high - low > least else None


def _alike_at_rate_level(found: Analysis, diagnosis: Diagnosis) -> Alikeness | None:
    """Single effects: correlation of their signals beyond the nominal curve."""
    from wineglass.diagnosis import bayes, parameters

    names = [effect.id for effect in diagnosis.effects if effect.id in found.design.effects]
    if len(names) < 2:
        return None
    nominal = found.design.matrix[:, list(found.design.statics[0])]
    signals = []
    for name in names:
        sets = [tuple(ids) for ids in [*diagnosis.alternatives, *(h.ids for h in diagnosis.hypotheses), [name]] if name in ids]
        holder = next(ids for ids in sets if ids in found.scores.supports)  # others have effects that noise or the thermometer showed
        mixture = bayes.fits(found.design, found.scores, found.blocks.white_rad_s, holder, np.arange(len(found.blocks)), 0.05)
        signal = parameters.contribution(found.design, mixture, name)
        if nominal.shape[1]:
            signal = signal - nominal @ np.linalg.lstsq(nominal, signal, rcond=None)[0]
        signals.append(signal)
    return Alikeness(names, _correlation(np.array(signals)))


def _alike_at_twin_level(examined: Examined) -> Alikeness | None:
    """Named explanations: correlation of their whitened responses over all channels, beyond what the description leaves uncertain."""
    found = examined.analysis
    sets = [ids for ids in examined.verdict.outcome.named if OTHER not in ids and found.closed_for(ids) is not None]
    if len(sets) < 2:
        return None
    signals = np.array([found.system.whiten(found.closed_for(ids).response).ravel() for ids in sets])
    nuisance = found.system.whiten(found.responses.values[list(found.responses.nuisances)][:, found.pick, :])
    flat = nuisance.reshape(len(nuisance), -1).T
    signals = signals - (flat @ np.linalg.lstsq(flat, signals.T, rcond=None)[0]).T if flat.size else signals
    return Alikeness([" with ".join(ids) for ids in sets], _correlation(signals))


def _correlation(signals: np.ndarray) -> np.ndarray:
    size = np.sqrt(np.sum(signals**2, axis=1))
    return (signals @ signals.T) / np.maximum(np.outer(size, size), 1e-300)
