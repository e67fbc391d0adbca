"""Noise that is there all the time, against what comes and goes: drawn series, whose course is known; no twin."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from wineglass.diagnosis import noise_level, noise_lines, noise_spectra, noise_trend
from wineglass.diagnosis.noise_lines import Line, Lines
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


def switching(rng, dwell_s, n=COUNT * LENGTH):
    """Two values by turns, as long as the last one by chance."""
    return np.cumsum(rng.uniform(size=n) < 1.0 / (dwell_s * RATE_HZ)) % 2 * 2.0 - 1.0


@pytest.mark.parametrize("seed", range(SEED, SEED + 5))
@pytest.mark.parametrize("dwell_s", [1.0, 3.0, 12.0])
def test_a_bias_that_switches_is_no_noise(seed, dwell_s):
    rng = np.random.default_rng(seed)
    assert noise_spectra.switches(windows_of(), switching(rng, dwell_s) + 0.5 * rng.standard_normal(COUNT * LENGTH))


@pytest.mark.parametrize("seed", range(SEED, SEED + 20))
def test_noise_of_any_colour_does_not_switch_nor_does_a_single_step(seed):
    rng = np.random.default_rng(seed)
    white = rng.standard_normal(COUNT * LENGTH)
    step = 50.0 * (np.arange(COUNT * LENGTH) > 3000)
    for values in (white, red(rng, COUNT * LENGTH) + 0.1 * white, np.geomspace(1.0, 10.0, COUNT * LENGTH) * white, white + step):
        assert not noise_spectra.switches(windows_of(), values)


def test_what_switches_is_never_called_a_wander():
    evidence = {frozenset(some): 20.0 if "flicker_noise" in some else 0.0 for size in range(3) for some in combinations(noise_spectra.EFFECTS, size)}
    spectral = SimpleNamespace(log_evidence=evidence, bands=[])
    still, switches = (noise_level._Looks(SimpleNamespace(ok=None), SimpleNamespace(ok=None), spectral, None, None, None, None, [], found) for found in (False, True))
    assert still._of(frozenset({"flicker_noise"})) > 15.0
    assert switches._of(frozenset({"flicker_noise"})) < -15.0


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


# ---- what a form is worth -----------------------------------------------------------------------------------------------------------


def test_a_spectrum_that_misses_its_form_is_not_saved_by_being_loud():
    """Up to 100 nats count as they are, then 100 (1 + ln(nats/100)/2); a form may be off by 0.4, which 1,000 terms see as 80 nats."""
    assert noise_level._held_to_form(50.0, 55.0, 1000.0) == 50.0
    assert noise_level._held_to_form(4950.0, 5000.0, 1000.0) == pytest.approx(100.0 * (1.0 + 0.5 * np.log(49.5)))
    assert noise_level._held_to_form(4000.0, 5000.0, 1000.0) == pytest.approx(50.0 * (np.log(50.0) - np.log(9.2)))
    assert noise_level._held_to_form(0.0, 5000.0, 1000.0) < 1.0


def test_noise_that_grows_in_both_quadratures_is_more_likely_excess_noise_than_unknown():
    evidence = {frozenset(some): 0.0 for size in range(3) for some in combinations(noise_spectra.EFFECTS, size)}
    looks = noise_level._Looks(None, None, SimpleNamespace(log_evidence=evidence, bands=[]), None, None, None, None, [SimpleNamespace(log_evidence=12.0)])
    known, unknown = (looks._broadband(frozenset({name})) for name in ("excess_noise", noise_level.OTHER))
    assert (known, unknown) == (12.0, 8.0)


# ---- noise under a line ---------------------------------------------------------------------------------------------------------------


class Recorded(SimpleNamespace):
    def __getitem__(self, name):
        return self.values[name]


def test_a_strong_tone_is_taken_out_while_the_carrier_moves():
    """The carrier goes by 0.4 Hz within a window; the tone stands still."""
    rng, windows = np.random.default_rng(SEED), windows_of()
    time_s = windows.tap.time_s
    drive_hz = 5000.0 - 0.2 * np.sin(2.0 * np.pi * time_s / 25.0)
    turns = np.concatenate([[0.0], np.cumsum(5006.7 - 0.5 * (drive_hz[1:] + drive_hz[:-1]))]) / RATE_HZ
    noise = rng.standard_normal(len(time_s))
    line = Line("interference", 5006.7, 0.01, 1.0, 0.1, 1e4, 1e4, 1e5, "tone")
    carrier = Recorded(time_s=time_s, sample_rate_hz=RATE_HZ, values={"drive_frequency": drive_hz})
    left, done = noise_lines.without(noise + 300.0 * np.cos(2.0 * np.pi * turns + 0.7), Lines([{"interference": line}], COUNT), windows, carrier, None)
    assert done
    assert np.std(left - noise) < 0.15  # ten numbers of 512 are fitted in every window
