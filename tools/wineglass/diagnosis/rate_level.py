"""The rate-level engine: time, temperature and rate of any gyro -> diagnosis. docs/DIAGNOSIS.md argues every step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from wineglass.diagnosis import bayes, columns, gap, noise_models, parameters, split
from wineglass.diagnosis.blocks import STEADY_DEGC, Blocks, make_blocks
from wineglass.diagnosis.columns import Design
from wineglass.diagnosis.evidence import Evidence
from wineglass.diagnosis.gap import Floor, Fraction
from wineglass.diagnosis.probabilities import HeldOut, Leftover, Posterior, alternatives, posterior, share_left
from wineglass.diagnosis.split import Split

ENGINE = "rate_level"
BEYOND_DOUBT = 1e-3
FOLLOWED = 14  # best supports whose residuals are computed
CANCELLING = 0.7  # the sum over the largest part
LEAST_NOISE = 1e-3  # noise models with less weight than this take no part in the held-out fits


@dataclass(frozen=True)
class Analysis:
    """Everything that verdict and report need. Residuals (n,) in rad/s, from coefficients of the fit part alone.

    split: the one that before and after are told of. left: support -> rms left in sample; held: support -> what it leaves on held-out blocks, every
    power-up, branch or rate segment held out once
    """

    blocks: Blocks
    design: Design
    scores: bayes.Scores
    split: Split
    groups: list[Split]
    posterior: Posterior
    alternatives: list[tuple[str, ...]]
    left: dict[tuple[str, ...], float]
    held: dict[tuple[str, ...], HeldOut]
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

    def cancelling(self, ids: tuple[str, ...]) -> bool:
        """Do its effects mostly cancel each other? Then their difference is what was seen, and that may be something else."""
        if len(ids) < 2:
            return False
        mixture = bayes.fits(self.design, self.scores, self.blocks.white_rad_s, ids, np.arange(len(self.blocks)), 0.05)
        nominal = self.design.matrix[:, list(self.design.statics[0])]
        signals = np.array([parameters.contribution(self.design, mixture, name) for name in ids])
        if nominal.shape[1]:
            signals = signals - (nominal @ np.linalg.lstsq(nominal, signals.T, rcond=None)[0]).T
        return gap.rms(signals.sum(axis=0)) < CANCELLING * max(gap.rms(signal) for signal in signals)

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
    advance()
    scores = bayes.score_all(design, noise, blocks.white_rad_s, without)
    advance()
    parts = split.told(blocks)
    held = split.joined(parts)
    groups = split.groups(blocks)
    followed = _followed(scores)
    everything = np.arange(len(blocks))
    trial = _Trial(design, blocks.white_rad_s, [c for c in scores.candidates if c.support in followed], _likely(scores, followed), followed)
    advance()
    left = {s: gap.rms(bayes.residual(design, bayes.fits(design, scores, blocks.white_rad_s, s, everything, 0.05))) for s in followed}
    left[()] = gap.rms(gap.nominal_residual(design, Split("", np.ones(len(blocks), bool), np.ones(len(blocks), bool))))
    residuals = trial.residuals(parts)
    held_rms = trial.cross_validated(groups)
    advance()
    null = gap.floor(design, parts, blocks.white_rad_s, _null_fits(design, scores, blocks, scores.supports[int(np.argmax(_totals(scores)))]))
    one_branch = len(blocks.branches) < 2 and float(np.ptp(blocks.temperature_degc)) >= STEADY_DEGC and not design.calibrated
    found = posterior(scores, Leftover(left, held_rms, null.rms, null.threshold, one_branch))
    explanations = alternatives(found, left, held_rms, null.rms, null.threshold)
    best = next((s for s in explanations if s in residuals), ())
    before = residuals[()]
    after = residuals[best] if best else before
    return Analysis(
        blocks=blocks, design=design, scores=scores, split=held, groups=groups, posterior=found,
        alternatives=explanations, left=left, held=held_rms, best=best, before=before, after=after,
        floor=null, fraction=gap.fraction(before[held.held], after[held.held], null),
    )


@dataclass(frozen=True)
class _Trial:
    """Fits of the followed supports on a part of the blocks."""

    design: Design
    white: float
    candidates: list[bayes.Candidate]
    noise: list[noise_models.NoiseModel]
    followed: list[tuple[str, ...]]
    known: dict[bytes, dict[tuple[str, ...], list[bayes.Fit]]] = field(default_factory=dict)

    def residuals(self, parts: list[Split]) -> dict[tuple[str, ...], np.ndarray]:
        """support -> recorded minus explained (n,), from coefficients of the fit parts; () is the nominal twin."""
        fitted = [self._fits(part) for part in parts]
        found = {s: gap.assembled(parts, [bayes.residual(self.design, fits[s]) for fits in fitted]) for s in self.followed if s}
        return found | {(): gap.assembled(parts, [gap.nominal_residual(self.design, part) for part in parts])}

    def _fits(self, part: Split) -> dict[tuple[str, ...], list[bayes.Fit]]:
        key = part.fit.tobytes()
        if key not in self.known:
            rows = np.flatnonzero(part.fit)
            scores = bayes.score(self.design, self.noise, self.white, self.candidates, rows)
            self.known[key] = {s: bayes.fits(self.design, scores, self.white, s, rows, 0.05) for s in self.followed if s}
        return self.known[key]

    def cross_validated(self, groups: list[Split]) -> dict[tuple[str, ...], HeldOut]:
        """Over all groups, each held out once."""
        squares = {support: np.zeros(2) for support in [*self.followed, ()]}
        count = 0
        for part in groups:
            count += int(part.held.sum())
            squares[()][0] += float(np.sum(gap.nominal_residual(self.design, part)[part.held] ** 2))
            for support, mixture in self._fits(part).items():
                values, uncertain = bayes.residual(self.design, mixture), bayes.variance(self.design, mixture)
                squares[support] += [float(np.sum(values[part.held] ** 2)), float(np.sum(uncertain[part.held]))]
        return {support: HeldOut(*(float(root) for root in np.sqrt(total / count))) for support, total in squares.items()}


def _likely(scores: bayes.Scores, followed: list[tuple[str, ...]]) -> list[noise_models.NoiseModel]:
    """Noise models that count for at least one of the supports."""
    kept = np.zeros(len(scores.noise), bool)
    for support in followed:
        rows = [i for i, c in enumerate(scores.candidates) if c.support == support]
        each = np.logaddexp.reduce(scores.log_evidence[rows], axis=0)
        kept |= each > each.max() + np.log(LEAST_NOISE)
    return [model for model, keep in zip(scores.noise, kept) if keep]


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
