"""Noise that is there all the time, against what comes and goes: drawn series, whose course is known; no twin."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from wineglass.diagnosis import noise_spectra, noise_trend
from wineglass.diagnosis.noise_windows import Windows

SEED = 83
RATE_HZ, LENGTH, COUNT = 50.0, 512, 17


def windows_of(count=COUNT, length=LENGTH):
    n = count * length
    tap = SimpleNamespace(sample_rate_hz=RATE_HZ, time_s=np.arange(n) / RATE_HZ)
    return Windows(tap, np.arange(count) * length, np.full(count, np.nan), length, 5)


def red(rng, n, pole=0.999):
    return lfilter([1.0], [1.0, -pole], rng.standard_normal(n))


def goes(values, length=LENGTH, count=COUNT):
    windows = windows_of(count, length)
    return noise_spectra.comes_and_goes(windows, values, np.zeros((count, length // 2), bool))


@pytest.mark.parametrize("seed", range(SEED, SEED + 5))
def test_a_bias_that_wanders_all_the_time_is_noise(seed):
    rng = np.random.default_rng(seed)
    assert not goes(0.1 * rng.standard_normal(COUNT * LENGTH))
    assert not goes(red(rng, COUNT * LENGTH) + 0.1 * rng.standard_normal(COUNT * LENGTH))


@pytest.mark.parametrize("seed", range(SEED, SEED + 5))
def test_white_noise_that_grows_is_no_strain_that_is_let_go(seed):
    rng = np.random.default_rng(seed)
    assert not goes(np.geomspace(1.0, 10.0, COUNT * LENGTH) * rng.standard_normal(COUNT * LENGTH))


@pytest.mark.parametrize("seed", range(SEED, SEED + 5))
def test_jumps_in_a_few_windows_are_no_noise(seed):
    rng = np.random.default_rng(seed)
    jumps = np.cumsum(np.where(rng.uniform(size=COUNT * LENGTH) < 1.0 / 1200.0, 30.0 * rng.standard_normal(COUNT * LENGTH), 0.0))
    assert goes(jumps + 0.3 * rng.standard_normal(COUNT * LENGTH))


# ---- noise that follows the temperature -------------------------------------------------------------------------------------------


def trend_of(size):
    """size: of the noise against the temperature [degC]; 42 windows over 80 degC"""
    rng, windows = np.random.default_rng(SEED), windows_of(42, 256)
    degc = 25.0 + 40.0 * np.sin(np.linspace(0.0, 7.0, 42))
    steps = np.repeat(size(degc), 256)
    channels = {name: steps * rng.standard_normal(42 * 256) for name in ("a", "b")}
    white = {name: np.full(128, 2.0 / RATE_HZ) for name in channels}
    return noise_trend.find("secondary", windows, channels, white, np.zeros((42, 128), bool), degc, 1.0)


def test_noise_that_grows_by_a_third_in_the_warmth_is_seen_and_steady_noise_is_not():
    assert trend_of(lambda t: np.ones_like(t)).log_evidence < 0.0
    assert trend_of(lambda t: np.hypot(1.0, 0.02 * np.maximum(t - 25.0, 0.0))).log_evidence > 6.0


def test_windows_are_brought_to_one_level_only_where_the_level_changes():
    steady, growing = trend_of(lambda t: np.ones_like(t)), trend_of(lambda t: np.exp(0.02 * (t - 25.0)))
    assert steady.relative == pytest.approx(np.ones(42))
    assert growing.relative.max() / growing.relative.min() == pytest.approx(np.exp(0.04 * 80.0), rel=0.5)
