"""Gaps on held-out data of made-up channels: floors that wander, shares that are known, columns that only noise has."""

from __future__ import annotations

import numpy as np
import pytest

from wineglass.diagnosis import changes, system
from wineglass.diagnosis.changes import Left
from wineglass.diagnosis.channels import Grid
from wineglass.diagnosis.floors import ORDER, Floor
from wineglass.diagnosis.system import FOLDS, System

SEED, N = 31, 3000


def made(data: np.ndarray, pole: float = 0.0) -> System:
    """One channel with noise of unit rms, autoregressive of first order."""
    coefficients = np.zeros((1, ORDER))
    coefficients[0, 0] = pole
    floor = Floor(np.ones(1), np.array([np.sqrt(1.0 - pole**2)]), coefficients)
    empty = System(Grid(1.0, 0, N), ("a",), floor, np.ones((1, N)), np.arange(N) * FOLDS // N, (np.zeros((N, 0)),), data)
    return System(empty.grid, empty.names, floor, empty.weight, empty.fold, empty.basis, empty.whiten(data))


def wandering(pole: float, seed: int) -> np.ndarray:
    """(1, N) of unit rms."""
    new = np.random.default_rng(seed).standard_normal(N) * np.sqrt(1.0 - pole**2)
    found = np.empty(N)
    found[0] = new[0] / np.sqrt(1.0 - pole**2)
    for i in range(1, N):
        found[i] = pole * found[i - 1] + new[i]
    return found[None]


def sure(values: np.ndarray) -> Left:
    return Left(values, np.sqrt(np.mean(values**2, axis=1)))


@pytest.mark.parametrize("pole", [0.0, 0.5, 0.9])
def test_independent_frames_of_a_first_order_noise(pole: float) -> None:
    """The variance of a mean of squares is 2/n times the sum of squared correlations, (1 + p^2)/(1 - p^2)."""
    assert made(np.zeros((1, N)), pole).floor.independent(0) == pytest.approx((1.0 - pole**2) / (1.0 + pole**2), rel=1e-6)


@pytest.mark.parametrize("pole", [0.0, 0.95])
def test_noise_of_the_floor_is_no_gap(pole: float) -> None:
    wrong = 0
    for seed in range(SEED, SEED + 40):
        noise = wandering(pole, seed)
        wrong += changes.changes(made(noise, pole), sure(noise), noise)[1].fraction is not None
    assert wrong == 0


def test_a_share_that_is_known_comes_out() -> None:
    noise, gap = wandering(0.0, SEED), 5.0 * np.sin(np.arange(N) / 40.0)[None]
    each, total = changes.changes(made(noise + gap), sure(noise + gap), noise + 0.1 * gap)
    for change in (each[0], total):
        assert change.fraction == pytest.approx(0.9, abs=0.02) and change.interval is not None
        assert change.interval[0] <= change.fraction <= change.interval[1]
    assert each[0].before == pytest.approx(np.sqrt(1.0 + 12.5), rel=0.02)


def test_a_fold_is_fitted_on_the_others_and_noise_is_not_foretold() -> None:
    """A steady column is taken off wherever it is; one that is declared noise helps the fit of the other and is left in."""
    rng = np.random.default_rng(SEED)
    steady, noise = np.ones((1, N)), np.cos(np.pi * 3 * (np.arange(N) + 0.5) / N)[None]
    data = 7.0 * steady + 4.0 * noise + 0.01 * rng.standard_normal((1, N))
    columns = np.stack([10.0 * steady, 10.0 * noise])
    built = made(data)
    table = system.products(built, built.whiten(columns))
    left = changes.held_out(built, table, np.ones(1), columns, data, noise=[1]).values
    assert np.max(np.abs(left - 4.0 * noise)) < 0.06
    left = changes.held_out(built, table, np.ones(1), columns, data, noise=[]).values
    assert np.max(np.abs(left)) < 0.08


def test_what_a_slope_may_be_off_is_no_gap() -> None:
    """A slope that shows hardly anything in four folds and much in the fifth cannot be foretold there, but it can be fitted; a gap that is no slope's stays."""
    slope, gaps, wave = np.where(np.arange(N) >= N - N // FOLDS, 1.0, 0.02)[None], 0, np.sin(np.arange(N) / 40.0)[None]
    for seed in range(SEED, SEED + 100):
        rng = np.random.default_rng(seed)
        for gap in (0.0, wave):
            data = 2.0 * rng.standard_normal() * slope + rng.standard_normal((1, N)) + gap
            built = made(data)
            left = changes.held_out(built, system.products(built, built.whiten(2.0 * slope[None])), np.ones(1), 2.0 * slope[None], data, noise=[])
            found = changes.changes(built, left, left.values)[1].fraction is not None
            gaps += found if gap is not wave else 0
            assert found or gap is not wave
    assert gaps == 0


def test_what_is_foretold_within_the_floor_counts_in_independent_frames() -> None:
    """A gap of a quarter of the floor: no channel is beyond it, but what foretells all of it gains its energy, and what foretells noise nothing."""
    gap = 0.25 * np.sqrt(2.0) * np.sin(np.arange(N) / 40.0)[None]
    for seed in range(SEED, SEED + 20):
        noise = 0.95 * wandering(0.0, seed)
        data, other = noise + gap, 0.25 * wandering(0.0, seed + 1000)
        each, total = changes.changes(made(data), sure(data), noise)
        assert each[0].fraction is None and total.fraction is None
        assert total.foretold == each[0].foretold == pytest.approx(N * 0.0625, abs=100.0)  # the cross term's deviation is 2 x 0.25 sqrt(N), 27
        assert changes.changes(made(data), sure(data), data - other)[1].foretold < 0.0
        assert changes.changes(made(data), Left(data, 0.95 * sure(data).least), noise)[1].foretold < total.foretold  # a unit that is fitted there leaves less


def brief(seed: int, offset: float, transient: float, later: float) -> tuple[System, np.ndarray]:
    """A channel that speaks in two stretches of a hundredth of the record, the first begun by a transient of eight frames; later: for the last two fifths of each."""
    data = np.random.default_rng(seed).standard_normal((1, N)) + offset
    data[0, 618:630] += later
    data[0, 2418:2430] += later
    data[0, 600:608] += transient * np.exp(-np.arange(8) / 3.0)
    empty = made(data)
    weight = np.zeros((1, N))
    weight[0, 600:630] = weight[0, 2400:2430] = 1.0
    return System(empty.grid, empty.names, empty.floor, weight, empty.fold, empty.basis, empty.data), data


@pytest.mark.parametrize(("offset", "transient", "later", "gap"), [
    (0.0, 0.0, 0.0, False), (0.0, -35.0, 0.0, False), (1.2, 0.0, 0.0, False), (8.0, 0.0, 0.0, True), (0.0, 0.0, 60.0, True)])
def test_a_channel_that_speaks_briefly_has_a_gap_only_if_enough_of_it_says_so(offset: float, transient: float, later: float, gap: bool) -> None:
    """Its frames are many, its stretches two: what is slow in them was seen twice."""
    nothing = np.full((1, 1, N), 1e-9)
    for seed in range(SEED, SEED + 20):
        built, data = brief(seed, offset, transient, later)
        left = changes.held_out(built, system.products(built, built.whiten(nothing)), np.ones(1), nothing, data, noise=[])
        assert (changes.changes(built, left, left.values)[1].fraction is not None) == gap


def test_what_a_channel_that_speaks_briefly_shows_is_not_foretold() -> None:
    built, data = brief(SEED, 8.0, 0.0, 0.0)
    assert changes.changes(built, sure(data), np.zeros((1, N)))[1].foretold == 0.0
    assert changes.brief(changes.counted(built)).tolist() == [True] and changes.brief(changes.counted(made(data))).tolist() == [False]
