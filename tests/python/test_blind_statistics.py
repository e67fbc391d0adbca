"""Intervals, Brier and calibration against closed forms and counting by hand."""

import math

import numpy as np
import pytest
from scipy import optimize, stats

from wineglass.blind import gating, limits
from wineglass.blind.statistics import Share, brier, calibration_error, reliability, risk_over_coverage, wilson


@pytest.mark.parametrize("k, n", [(1, 10), (5, 10), (99, 100), (3, 400)])
def test_wilson_ends_are_where_the_z_test_just_passes(k, n):
    z = stats.norm.ppf(0.975)

    def distance(p):
        return abs(k / n - p) - z * math.sqrt(p * (1 - p) / n)

    low, high = optimize.brentq(distance, 1e-12, k / n), optimize.brentq(distance, k / n, 1 - 1e-12)
    assert wilson(k, n) == pytest.approx((low, high), abs=1e-9)


def test_wilson_of_all_and_nothing():
    z2 = stats.norm.ppf(0.975) ** 2
    assert wilson(0, 20) == pytest.approx((0.0, z2 / (20 + z2)))
    assert wilson(20, 20) == pytest.approx((20 / (20 + z2), 1.0))
    assert wilson(0, 0) == (0.0, 1.0) and Share(0, 0).value is None


def test_brier_of_two_hypotheses_is_the_usual_one():
    a, b = frozenset({"a"}), frozenset({"b"})
    assert brier({a: 0.8, b: 0.2}, a) == pytest.approx(0.2**2)
    assert brier({a: 0.8, b: 0.2}, b) == pytest.approx(0.8**2)
    assert brier({a: 1.0, b: 0.0}, a) == 0.0 and brier({a: 1.0}, b) == 1.0


def test_brier_of_an_even_guess_among_n():
    names = [frozenset({str(i)}) for i in range(5)]
    assert brier(dict.fromkeys(names, 0.2), names[0]) == pytest.approx(0.5 * (1 - 1 / 5))


def test_truth_that_is_not_listed_costs_all_of_it():
    assert brier({frozenset({"a"}): 0.5, frozenset({"b"}): 0.5}, frozenset({"c"})) == pytest.approx(0.75)


def test_calibration_error_counted_by_hand():
    confidence, right = [0.85, 0.85, 0.85, 0.85, 0.35, 0.35], [True, True, True, False, False, True]
    assert calibration_error(confidence, right) == pytest.approx((4 * abs(0.85 - 0.75) + 2 * abs(0.35 - 0.5)) / 6)
    assert [one.right.n for one in reliability(confidence, right)] == [2, 4]
    assert calibration_error([1.0, 1.0], [True, True]) == 0.0 and calibration_error([], []) is None


def test_honest_answers_have_a_small_calibration_error():
    random = np.random.default_rng(3)
    confidence = random.uniform(0, 1, 200_000)
    assert calibration_error(confidence, random.uniform(0, 1, 200_000) < confidence) < 0.005
    assert calibration_error(confidence, random.uniform(0, 1, 200_000) < confidence**2) == pytest.approx(1 / 6, abs=0.01)  # integral of p - p^2


def test_risk_is_counted_from_the_surest_down_and_ties_go_together():
    coverage, risk = risk_over_coverage([0.9, 0.5, 0.5, 0.1], [False, True, False, True])
    assert coverage.tolist() == [0.25, 0.75, 1.0]
    assert risk == pytest.approx([0.0, 1 / 3, 0.5])


def test_half_seen_lies_between_the_unseen_and_the_seen():
    assert 0.2 < limits.half_seen([0.1, 0.2, 0.5, 1.0], [False, False, True, True]) < 0.5
    assert limits.half_seen([0.1, 1.0], [True, True]) is None and limits.half_seen([], []) is None


def test_half_seen_of_a_logistic_curve():
    random = np.random.default_rng(7)
    x = random.uniform(-1.5, 1.0, 3000)
    seen = random.uniform(size=3000) < 1 / (1 + np.exp(-(x + 0.3) / 0.15))
    assert math.log10(limits.half_seen(10**x, seen)) == pytest.approx(-0.3, abs=0.03)


@pytest.mark.parametrize("share, above", [(0.0, 0), (0.1, 1), (0.25, 2), (1.0, 10)])
def test_threshold_leaves_the_wanted_number_of_nulls_above(share, above):
    nulls = list(range(10))
    assert sum(value > gating.threshold(nulls, share) for value in nulls) == above
