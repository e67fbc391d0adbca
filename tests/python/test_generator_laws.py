"""Pieces of the generator's laws against other ways to the same."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wineglass.blind.generator import laws

STEP = 0.01


def test_lag_follows_the_differential_equation():
    t = np.arange(0, 5, STEP)
    values = np.interp(t, [0, 1, 2, 5], [20.0, 20.0, 50.0, 30.0])
    solved = solve_ivp(lambda now, y: (np.interp(now, t, values) - y) / 0.7, (0, t[-1]), [20.0], t_eval=t, max_step=STEP, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(laws.lag(values, STEP, 0.7), solved.y[0], atol=2e-6)


@pytest.mark.parametrize("law", [lambda v: laws.lag(v, STEP, 0.8), lambda v: laws.lags(v, STEP, (0.5, 0.3)), lambda v: laws.diffusion(v, STEP, 0.8)])
def test_every_lag_is_behind_a_ramp_by_its_time(law):
    ramp = np.arange(0, 20, STEP) * 2.0
    assert (ramp - law(ramp))[-1] == pytest.approx(2.0 * 0.8, rel=1e-6)


def test_play_holds_and_follows():
    values = np.concatenate([np.linspace(0, 10, 101), np.linspace(10, 0, 101)])
    out = laws.play(values, 2.0)
    assert out[100] == pytest.approx(8.0) and out[101 + 39] == pytest.approx(8.0) and out[-1] == pytest.approx(2.0)


def test_preisach_returns_to_the_same_point_after_a_minor_loop():
    up = np.linspace(0, 40, 400)
    minor = np.concatenate([up, np.linspace(40, 20, 200), np.linspace(20, 40, 200)])
    out = laws.preisach(minor, -20.0, 60.0, cells=16)
    assert out[len(up) - 1] == pytest.approx(out[-1]) and out[len(up) + 199] < out[-1]
    falling = laws.preisach(np.concatenate([up, up[::-1]]), -20.0, 60.0, cells=16)
    assert np.all(falling[400:] >= falling[:400][::-1]) and np.ptp(falling) > 0.2


def test_flicker_has_a_flat_allan_deviation():
    """Overlapping-free Allan deviation of many realisations at three averaging times."""
    floor, found = 3e-6, {0.8: [], 3.2: [], 12.8: []}
    for seed in range(60):
        noise = laws.flicker(np.random.default_rng(seed), 4000, 0.1, floor)
        for tau in found:
            size = round(tau / 0.1)
            means = noise[: len(noise) // size * size].reshape(-1, size).mean(axis=1)
            found[tau].append(0.5 * np.mean(np.diff(means) ** 2))
    for tau, variances in found.items():
        assert np.sqrt(np.mean(variances)) == pytest.approx(floor, rel=0.15), tau


def test_telegraph_dwells_as_long_as_asked():
    signal = laws.telegraph(np.random.default_rng(3), 400_000, 0.1, 5.0)
    assert set(np.unique(signal)) == {-1.0, 1.0}
    assert 40_000 / np.count_nonzero(np.diff(signal)) == pytest.approx(5.0, rel=0.06)
