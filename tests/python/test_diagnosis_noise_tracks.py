"""Courses of a line from window to window: places by formula, with noise, and the course that must be read from them."""

import numpy as np
import pytest

from wineglass.diagnosis import noise_tracks
from wineglass.diagnosis.noise_tracks import Peaks

SEED = 61
TOP_HZ, BIN_HZ = 25.0, 0.195
N = 40


def day(rng):
    """Middles of windows, temperature with the thermometer's own way, and the carrier's frequency, with a curvature and a lag."""
    time_s = np.sort(rng.uniform(0.0, 600.0, N))
    degc = 25.0 + 40.0 * np.sin(2.0 * np.pi * time_s / 600.0)
    shell = 25.0 + 40.0 * np.sin(2.0 * np.pi * (time_s - 5.0) / 600.0)
    return time_s, degc, 5000.0 - 0.025 * (shell - 25.0) + 2e-5 * (shell - 25.0) ** 2


def peaks_at(time_s, place_hz, rng, astray=0.05):
    folded = np.abs(place_hz - 2.0 * TOP_HZ * np.round(place_hz / (2.0 * TOP_HZ)))
    seen = folded + 0.05 * rng.standard_normal(len(folded))
    seen = np.where(rng.uniform(size=len(seen)) < astray, rng.uniform(1.5, TOP_HZ, len(seen)), seen)
    return Peaks(time_s, seen, np.full(len(seen), 300.0), np.full(len(seen), 0.07), np.zeros(len(seen)))


def followed(course, seed=SEED, **more):
    rng = np.random.default_rng(seed)
    time_s, degc, carrier = day(rng)
    return noise_tracks.follow(peaks_at(time_s, course(time_s, degc, carrier), rng, **more), carrier, degc, TOP_HZ)


USUAL = {"a rate": lambda t, T, f: np.full(N, 7.3), "a tone": lambda t, T, f: 5006.7 - f, "a tone that folds": lambda t, T, f: 5024.9 - f,
         "a tone of another oscillator": lambda t, T, f: 5005.0 + 0.15 * (T - 25.0) - f,
         "a tone and a rate by turns": lambda t, T, f: np.where(np.arange(N) % 3 > 0, 5009.0 - f, 7.3),
         "two rates, one in the morning": lambda t, T, f: np.where(t < 300.0, 4.0, 12.0)}


@pytest.mark.parametrize("seed", [SEED, SEED + 1, SEED + 2])
@pytest.mark.parametrize("name", USUAL)
def test_lines_of_structures_and_oscillators_are_usual(name, seed):
    assert followed(USUAL[name], seed) is None


@pytest.mark.parametrize("seed", [SEED, SEED + 1, SEED + 2])
def test_the_image_in_a_pumped_stiffness_goes_twice_as_far_as_the_carrier(seed):
    found = followed(lambda t, T, f: 10000.0 + 5.3 - 2.0 * f, seed)
    assert found is not None and found.form == "twice" and found.margin > 10.0
    rng = np.random.default_rng(seed)
    _, _, carrier = day(rng)
    assert found.place_hz == pytest.approx(np.abs(10005.3 - 2.0 * carrier), abs=0.1)


@pytest.mark.parametrize("seed", [SEED, SEED + 1, SEED + 2])
def test_a_line_that_sweeps_with_the_day_goes_its_own_way(seed):
    found = followed(lambda t, T, f: 7.0 - 5.0 * np.cos(2.0 * np.pi * t / 600.0), seed)
    assert found is not None and found.form == "moving" and found.margin > 10.0


def test_places_without_order_are_no_line_that_moves():
    """What jumps from window to window without any course is left to other looks."""
    assert followed(lambda t, T, f: np.random.default_rng(SEED).uniform(1.5, 24.0, N)) is None


def test_a_carrier_that_stands_still_tells_nothing():
    rng = np.random.default_rng(SEED)
    time_s = np.linspace(0.0, 300.0, N)
    found = noise_tracks.follow(peaks_at(time_s, np.full(N, 5.3), rng), np.full(N, 5000.0), np.full(N, 25.0), TOP_HZ)
    assert found is None


def test_a_few_strong_peaks_are_too_few():
    found = peaks_at(np.arange(3.0), np.array([3.0, 6.0, 9.0]), np.random.default_rng(SEED), 0.0)
    assert noise_tracks.follow(found, np.zeros(3), None, TOP_HZ) is None


# ---- peaks ------------------------------------------------------------------------------------------------------------------------


def spectra(n=200, m=127):
    rng = np.random.default_rng(SEED)
    return rng.gamma(1.6, 1.0 / 1.6, (n, m)), BIN_HZ * np.arange(1, m + 1)


def test_noise_and_slopes_have_no_peaks():
    power, frequency = spectra()
    assert not noise_tracks.peaks(power, frequency, np.arange(200.0), np.zeros(200)).strong.any()
    red = power * (1.0 + (12.0 / frequency) ** 4)
    assert np.mean(noise_tracks.peaks(red, frequency, np.arange(200.0), np.zeros(200)).strong) < 0.02


def test_the_place_of_a_peak_is_that_of_its_power():
    power, frequency = spectra()
    at = np.random.default_rng(SEED).uniform(4.0, 22.0, 200)
    power += 2e3 * np.exp(-0.5 * ((frequency - at[:, None]) / BIN_HZ) ** 2)
    found = noise_tracks.peaks(power, frequency, np.arange(200.0), np.zeros(200))
    assert found.strong.all() and found.place_hz == pytest.approx(at, abs=0.1)


def test_a_peak_beside_bins_that_do_not_count_is_none():
    """Its top may be hidden there."""
    power, frequency = spectra(20)
    power[:, 40:47] += 1e3
    power[:, 42] = np.nan
    assert not noise_tracks.peaks(power, frequency, np.arange(20.0), np.zeros(20)).strong.any()
