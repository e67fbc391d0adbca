"""Marginal likelihood, floors and splits against other methods: scipy's multivariate t, closed forms, counting."""

import diagnosis_synthetic as synthetic
import numpy as np
import pytest
from scipy.stats import multivariate_t

from wineglass.diagnosis import bayes, columns, gap, noise_models, split
from wineglass.diagnosis.blocks import make_blocks


@pytest.fixture(scope="module")
def problem():
    blocks = make_blocks(synthetic.make([synthetic.drift(3e-3)], 5))
    return blocks, columns.build(blocks), noise_models.candidates(blocks.time_s, blocks.sample_noise_rad_s / blocks.white_rad_s)


def test_log_evidence_is_a_multivariate_t(problem):
    """The same model written as one density: y ~ t(0, K + C C', nu), no Gram matrix, no Cholesky of the inner system."""
    blocks, design, noise = problem
    chosen = [c for c in bayes.enumerate_candidates(design) if len(c.support) <= 2][::40]
    models = noise[::7]
    rows = np.arange(0, len(blocks), 2)
    found = bayes.score(design, models, blocks.white_rad_s, chosen, rows).log_evidence
    for i, candidate in enumerate(chosen):
        c = design.matrix[np.ix_(rows, candidate.columns)] / blocks.white_rad_s
        y = design.static_targets[candidate.static][rows] / blocks.white_rad_s
        for j, model in enumerate(models):
            shape = model.covariance[np.ix_(rows, rows)] + c @ c.T
            expected = multivariate_t(np.zeros(len(rows)), shape, df=bayes.FREEDOM).logpdf(y) + candidate.log_prior + model.log_prior
            assert found[i, j] == pytest.approx(expected, abs=1e-4 * abs(expected) + 1e-3)


def test_supports_are_all_there_once(problem):
    _, design, _ = problem
    supports = {c.support for c in bayes.enumerate_candidates(design)}
    names = len(design.effects)
    assert names == 5 and len(supports) == 1 + 5 + 10 + 10


def test_white_noise_is_measured_inside_blocks():
    for seed in range(3):
        blocks = make_blocks(synthetic.make([], seed, markov=0.0))
        assert blocks.white_rad_s == pytest.approx(synthetic.SIGMA / np.sqrt(blocks.samples_per_block), rel=0.12)
        assert blocks.sample_noise_rad_s == pytest.approx(synthetic.SIGMA, rel=0.08)


def test_fit_and_held_out_never_overlap_and_branches_stay_whole():
    for profile in (synthetic.one_cycle, synthetic.two_cycles):
        blocks = make_blocks(synthetic.make([], 1, profile))
        found = split.primary(blocks)
        assert not np.any(found.fit & found.held)
        assert found.held.sum() >= 20
        first = int(np.argmax(~found.fit))
        assert not np.any(found.fit[first:]) and np.all(found.fit[:first])


@pytest.mark.parametrize("after, expected", [(1.0, 0.0), (0.5, 0.5), (0.0, 1.0)])
def test_fraction_is_of_amplitude(after, expected):
    before = np.full(120, 2.0)
    null = gap.Floor(1e-6, 2e-6, 60.0)
    found = gap.fraction(before, after * before, null)
    assert found.value == pytest.approx(expected, abs=1e-6) and found.interval[0] <= found.value <= found.interval[1]


def test_fraction_is_null_without_a_gap_and_negative_when_worse():
    noise = np.random.default_rng(0).standard_normal(200)
    assert gap.fraction(noise, noise, gap.Floor(1.0, 1.2, 100.0)).value is None
    assert gap.fraction(np.full(200, 2.0), np.full(200, 4.0), gap.Floor(0.1, 0.2, 50.0)).value < -0.9


def test_noise_classes_keep_their_prior_weight(problem):
    _, _, noise = problem
    for kind, weight in noise_models.CLASS_PRIOR.items():
        total = np.logaddexp.reduce([m.log_prior for m in noise if m.kind == kind])
        assert np.exp(total) == pytest.approx(weight, rel=1e-9)
