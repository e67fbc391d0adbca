"""What to run next: the experiment of a short menu under which the two best explanations would differ most.

Every entry of the menu is a temperature profile. What the first explanation predicts for it is computed with its fitted coefficients; the
separation is the difference in log evidence between both explanations on that prediction (no noise added, noise models as fitted).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wineglass.diagnosis import bayes, columns, noise_models
from wineglass.diagnosis.blocks import Blocks, make_blocks
from wineglass.diagnosis.columns import Design
from wineglass.diagnosis.evidence import Evidence

SAMPLES = 960


@dataclass(frozen=True)
class Proposal:
    run: str
    separation: float
    why: str


Profile = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def _back(time_s: np.ndarray, temperature: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
    """A bridge from the last temperature to the first, so that the next cycle starts where this one did."""
    bridge = np.linspace(temperature[-1], temperature[0], max(2, len(temperature) // 8))[1:]
    step = float(np.median(np.diff(time_s))) * share
    return time_s[-1] + step * np.arange(1, len(bridge) + 1), bridge


def _then(time_s: np.ndarray, temperature: np.ndarray, share: float, repeats: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """The same profile again, `share` times as long."""
    times, degrees = [time_s], [temperature]
    for _ in range(repeats):
        more_time, more = _back(times[-1], temperature, share)
        start = more_time[-1] + float(np.median(np.diff(time_s))) * share
        times += [more_time, start + (time_s - time_s[0]) * share]
        degrees += [more, temperature]
    return np.concatenate(times), np.concatenate(degrees)


MENU: list[tuple[str, str, Profile]] = [
    ("a second thermal cycle over the same temperatures at half the speed, without a pause",
     "a lag scales with the speed, a drift with the time, a hysteresis with neither", lambda t, x: _then(t, x, 2.0)),
    ("a second thermal cycle over the same temperatures at twice the speed, without a pause",
     "a lag scales with the speed, a drift with the time, a hysteresis with neither", lambda t, x: _then(t, x, 0.5)),
    ("the same thermal cycle once more at the same speed, without a pause",
     "a drift goes on, a hysteresis closes its loop, a lag repeats", lambda t, x: _then(t, x, 1.0)),
]


def propose(blocks: Blocks, design: Design, scores: bayes.Scores, pair: list[tuple[str, ...]]) -> list[Proposal]:
    """The menu for two explanations, the best first."""
    white = blocks.white_rad_s
    mixture = bayes.fits(design, scores, white, pair[0], np.arange(len(blocks)))
    best = max(mixture, key=lambda f: f.weight)
    found = [_try(entry, blocks, design, best, pair) for entry in MENU]
    return sorted(found, key=lambda p: -p.separation)


def _try(entry: tuple[str, str, Profile], blocks: Blocks, design: Design, best: bayes.Fit, pair: list[tuple[str, ...]]) -> Proposal:
    run, why, profile = entry
    time_s, temperature = profile(blocks.fine_time_s, blocks.fine_temperature_degc)
    wanted = np.linspace(time_s[0], time_s[-1], SAMPLES)
    degrees = np.interp(wanted, time_s, temperature)
    fresh = make_blocks(_evidence(blocks.evidence, wanted, degrees))
    if fresh is None:
        return Proposal(run, 0.0, why)
    noise = replace(fresh, white_rad_s=blocks.white_rad_s, sample_noise_rad_s=blocks.sample_noise_rad_s,
                    residual_rad_s=np.interp(fresh.time_s, blocks.time_s, blocks.residual_rad_s))
    other = columns.build(noise)
    target = _predict(design, other, best, noise)
    imagined = replace(other, target=target, static_targets=np.tile(target, (len(other.statics), 1)))
    models = [m for m in noise_models.candidates(fresh.time_s, blocks.sample_noise_rad_s / blocks.white_rad_s)
              if m.kind == "floor" or m.amplitude <= max(best.noise.amplitude, 1.0)]
    candidates = [c for c in bayes.enumerate_candidates(other) if c.support in pair]
    scored = bayes.score(imagined, models, blocks.white_rad_s, candidates)
    totals = dict(zip(scored.supports, np.logaddexp.reduce(scored.by_support, axis=1)))
    return Proposal(run, float(max(0.0, totals[pair[0]] - totals[pair[1]])), why)


def _evidence(evidence: Evidence, time_s: np.ndarray, temperature: np.ndarray) -> Evidence:
    """The same sensor over another profile; its rate holds nothing but a trace of noise."""
    trace = np.random.default_rng(22).standard_normal(len(time_s)) * 1e-12
    return replace(evidence, time_s=time_s, temperature_degc=temperature, rate_rad_s=trace, true_rate_rad_s=None, bias_rad_s=None,
                   bias_slope=None, measured_degc=None, expected=None)


def _predict(design: Design, other: Design, best: bayes.Fit, fresh: Blocks) -> np.ndarray:
    """The fitted explanation's effects on the new profile, its time scales being those of the fit."""
    total = np.zeros(len(fresh))
    for place, name in enumerate(best.candidate.support):
        fitted = best.candidate.variants[place]
        options = [v for v in other.effects.get(name, []) if v.shape == fitted.shape and len(v.columns) == len(fitted.columns)]
        if not options or not fitted.columns:
            continue
        variant = min(options, key=lambda v: abs(v.value - fitted.value))
        coefficients = dict(zip(best.candidate.columns, best.mean))
        physical = np.array([coefficients[c] * design.scale[c] for c in fitted.columns])
        total += other.matrix[:, list(variant.columns)] @ (physical / other.scale[list(variant.columns)])
    return total
