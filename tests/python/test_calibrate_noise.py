"""Intervals: over 1000 seeds they cover what they promise, whatever the noise remembers, and white noise does not widen them."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from wineglass.calibration.noise import LeastSquares

SEEDS = 1000
SAMPLES = 3000
BLOCK = 20
ORDER = 3


def noise(kind: str, rng: np.random.Generator, cases: int) -> np.ndarray:
    """(SAMPLES, cases) of stationary noise: warmed up, then cut."""
    warm = 2000
    white = rng.standard_normal((SAMPLES + warm, cases))
    if kind == "white":
        return white[warm:]
    rho = float(kind.split()[-1])
    coloured = lfilter([1.0], [1.0, -rho], white, axis=0)[warm:]
    if kind.startswith("ar"):
        return coloured
    return coloured * 0.5 * np.sqrt(1.0 - rho**2) + rng.standard_normal((SAMPLES, cases))


def two_branches() -> np.ndarray:
    return -50.0 + 100.0 * (1.0 - np.abs(2.0 * np.arange(SAMPLES) / SAMPLES - 1.0))


def dwells() -> np.ndarray:
    """Up, wait, down, wait: the chamber's everyday profile."""
    return np.interp(np.arange(SAMPLES), [0, 900, 1400, 2400, 3000], [-40.0, 85.0, 85.0, -40.0, -40.0])


def averaged(values: np.ndarray) -> np.ndarray:
    return values.reshape(SAMPLES // BLOCK, BLOCK, *values.shape[1:]).mean(axis=1)


@pytest.mark.parametrize("kind, profile", [
    ("white", two_branches), ("ar 0.3", two_branches), ("ar 0.9", two_branches), ("white and ar 0.98", two_branches),
    ("white", dwells), ("ar 0.9", dwells), ("ar 0.98", dwells),
], ids=lambda value: getattr(value, "__name__", value))
def test_intervals_cover_95_percent(kind, profile):
    """Four coefficients, 1000 seeds: the binomial error of one coverage is 0.7 %."""
    rng = np.random.default_rng(20)
    design = np.vander(profile() / 50.0, ORDER + 1, increasing=True)
    truth = np.array([0.3, -1.0, 0.5, 0.2])
    measured = (design @ truth)[:, None] + noise(kind, rng, SEEDS)
    solver = LeastSquares(averaged(np.arange(SAMPLES) * 0.5), averaged(design))
    found = solver.intervals(averaged(measured), np.eye(ORDER + 1))
    covered = np.mean(np.abs(found.estimate - truth[:, None]) <= found.half_width, axis=1)
    assert np.all((covered >= 0.93) & (covered <= 0.97)), covered


def test_white_noise_gives_the_textbook_interval():
    """Against the classical Student interval of ordinary least squares, computed here: at most a tenth wider in the mean."""
    rng = np.random.default_rng(21)
    design = averaged(np.vander(two_branches() / 50.0, ORDER + 1, increasing=True))
    measured = averaged(noise("white", rng, 400))
    found = LeastSquares(averaged(np.arange(SAMPLES) * 0.5), design).intervals(measured, np.eye(ORDER + 1))
    beta, squares, _, _ = np.linalg.lstsq(design, measured, rcond=None)
    freedom = len(design) - ORDER - 1
    spread = np.sqrt(np.diag(np.linalg.inv(design.T @ design))[:, None] * squares / freedom)
    np.testing.assert_allclose(found.estimate, beta, atol=1e-10)
    ratio = np.mean(found.half_width, axis=1) / np.mean(stats.t.ppf(0.975, freedom) * spread, axis=1)
    assert np.all((ratio > 0.98) & (ratio < 1.1)), ratio


def test_correlated_noise_widens_as_its_long_run_variance():
    """AR(1) with 0.9: the deviation of a mean is sqrt((1 + rho)/(1 - rho)) = 4.36 times the white one's (closed form)."""
    rng = np.random.default_rng(22)
    design = averaged(np.ones((SAMPLES, 1)))
    solver = LeastSquares(averaged(np.arange(SAMPLES) * 0.5), design)
    found = solver.intervals(averaged(noise("ar 0.9", rng, 200)), np.eye(1))
    expected = 1.96 / (1.0 - 0.9) / np.sqrt(SAMPLES)
    assert np.median(found.half_width) == pytest.approx(expected, rel=0.15)


def test_cases_do_not_disturb_each_other():
    rng = np.random.default_rng(23)
    solver = LeastSquares(np.arange(150.0), np.vander(np.linspace(-1, 1, 150), 3))
    y = rng.standard_normal((150, 5)).cumsum(axis=0)
    together = solver.intervals(y, np.eye(3))
    for i in range(5):
        alone = solver.intervals(y[:, i], np.eye(3))
        np.testing.assert_allclose(alone.half_width, together.half_width[:, i], rtol=1e-9)
