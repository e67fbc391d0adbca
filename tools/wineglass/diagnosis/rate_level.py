"""The rate-level engine: time, temperature and rate of any gyro -> diagnosis. docs/DIAGNOSIS.md argues every step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wineglass.diagnosis import bayes, columns, gap, noise_models, split
from wineglass.diagnosis.blocks import Blocks, make_blocks
from wineglass.diagnosis.columns import Design
from wineglass.diagnosis.evidence import Evidence
from wineglass.diagnosis.gap import Floor, Fraction
from wineglass.diagnosis.probabilities import Posterior, alternatives, posterior, share_left
from wineglass.diagnosis.split import Split

ENGINE = "rate_level"
BEYOND_DOUBT = 1e-3
FOLLOWED = 14  # best supports whose residuals are computed


@dataclass(frozen=True)
class Analysis:
    """Everything that verdict and report need. Residuals (n,) in rad/s, from coefficients of the fit part alone.

    left: support -> rms left in sample; held: support -> rms left on held-out blocks
    """

    blocks: Blocks
    design: Design
    scores: bayes.Scores
    split: Split
    fit_scores: bayes.Scores
    posterior: Posterior
    alternatives: list[tuple[str, ...]]
    left: dict[tuple[str, ...], float]
    held: dict[tuple[str, ...], float]
    best: tuple[str, ...]
    before: np.ndarray
    after: np.ndarray
    floor: Floor
    fraction: Fraction

    @property
    def gap(self) -> bool:
        """More than noise on the held-out blocks, or beyond doubt in all of them."""
        above = gap.rms(self.before[self.split.held]) > self.floor.threshold
        return self.posterior.none < (0.5 if above else BEYOND_DOUBT)

    @property
    def share_left(self) -> float:
        """Least share of the gap that a named explanation leaves, in sample."""
        named = [self.left[ids] for ids in self.alternatives if ids in self.left]
        return share_left(min(named), self.left[()], self.floor.rms) if named else 1.0


def analyse(evidence: Evidence, advance: Callable[[], None] = lambda: None, without: frozenset[str] = frozenset()) -> Analysis | None:
    """None where the recording is too short. without: effects taken out of the catalogue (for tests of honesty)."""
    blocks = make_blocks(evidence)
    if blocks is None:
        return None
    design = columns.build(blocks)
    noise = noise_models.candidates(blocks.time_s, blocks.sample_noise_rad_s / blocks.white_rad_s)
    candidates = bayes.enumerate_candidates(design, without)
    advance()
    scores = bayes.score(design, noise, blocks.white_rad_s, candidates)
    advance()
    held = split.primary(blocks)
    followed = _followed(scores)
    everything = np.arange(len(blocks))
    rows = np.flatnonzero(held.fit)
    fit_scores = bayes.score(design, noise, blocks.white_rad_s, [c for c in candidates if c.support in followed], rows)
    advance()
    left = {s: gap.rms(bayes.residual(design, bayes.fits(design, scores, blocks.white_rad_s, s, everything, 0.05))) for s in followed}
    left[()] = gap.rms(gap.nominal_residual(design, Split("", np.ones(len(blocks), bool), np.ones(len(blocks), bool))))
    residuals = {s: bayes.residual(design, bayes.fits(design, fit_scores, blocks.white_rad_s, s, rows, 0.05)) for s in followed}
    before = gap.nominal_residual(design, held)
    held_rms = {s: gap.rms(r[held.held]) for s, r in residuals.items()} | {(): gap.rms(before[held.held])}
    advance()
    null = gap.floor(design, held, blocks.white_rad_s, _null_fits(design, scores, blocks, scores.supports[int(np.argmax(_totals(scores)))]))
    found = posterior(scores, left, held_rms, null.threshold)
    explanations = alternatives(found, left, held_rms, null.rms, null.threshold)
    best = next((s for s in explanations if s in residuals), ())
    after = residuals[best] if best else before
    return Analysis(
        blocks=blocks, design=design, scores=scores, split=held, fit_scores=fit_scores, posterior=found,
        alternatives=explanations, left=left, held=held_rms, best=best, before=before, after=after,
        floor=null, fraction=gap.fraction(before[held.held], after[held.held], null),
    )


def _followed(scores: bayes.Scores) -> list[tuple[str, ...]]:
    """The best supports, and all single effects, which may imitate."""
    totals = _totals(scores)
    order = [scores.supports[i] for i in np.argsort(-totals)]
    singles = [s for s in order if len(s) <= 1]
    return list(dict.fromkeys([*order[:FOLLOWED], *singles]))


def _totals(scores: bayes.Scores) -> np.ndarray:
    return np.logaddexp.reduce(scores.by_support, axis=1)


def _null_fits(design: Design, scores: bayes.Scores, blocks: Blocks, support: tuple[str, ...]) -> list[bayes.Fit]:
    """Mixture over the noise models of the floor class, under the best explanation."""
    floors = [j for j, m in enumerate(scores.noise) if m.kind == "floor"]
    restricted = bayes.Scores(scores.candidates, [scores.noise[j] for j in floors], scores.log_evidence[:, floors])
    return bayes.fits(design, restricted, blocks.white_rad_s, support, np.arange(len(blocks)), 0.05)
