"""Evidence of the twin-level engine against the same model written as one Gaussian density; supports on made-up channels."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from wineglass.diagnosis import explain, system
from wineglass.diagnosis.channels import Grid
from wineglass.diagnosis.floors import ORDER, Floor
from wineglass.diagnosis.system import FOLDS, System

SEED = 5
N = 60


def made(rng: np.random.Generator, data: np.ndarray) -> System:
    floor = Floor(np.ones(2), np.ones(2), np.zeros((2, ORDER)))
    basis = tuple(np.linalg.qr(rng.standard_normal((N, 3)))[0] for _ in range(2))
    return System(Grid(1.0, 0, N), ("a", "b"), floor, np.ones((2, N)), np.arange(N) * FOLDS // N, basis, data)


def test_log_evidence_is_that_of_one_gaussian_density() -> None:
    rng = np.random.default_rng(SEED)
    columns, data = rng.standard_normal((4, 2, N)), 2.0 * rng.standard_normal((2, N))
    table = system.products(made(rng, data), columns)
    flat = columns.reshape(4, -1)
    for places in ([], [0], [0, 2, 3]):
        found = explain.explained(table, np.ones(2), 1, places[1:], (), 0.0) if places else None
        used = flat[[0, *places[1:]]] if places else flat[:1]
        found = found or explain.explained(table, np.ones(2), 1, [], (), 0.0)
        density = multivariate_normal(np.zeros(2 * N), np.eye(2 * N) + used.T @ used).logpdf(data.ravel())
        assert found.log_evidence == pytest.approx(density + N * np.log(2.0 * np.pi), abs=1e-4)


def test_softening_divides_a_channels_information() -> None:
    rng = np.random.default_rng(SEED)
    columns, data = rng.standard_normal((2, 2, N)), rng.standard_normal((2, N))
    table = system.products(made(rng, data), columns)
    halved = explain.explained(table, np.array([1.0, 4.0]), 0, [0, 1], (), 0.0)
    scaled = np.array([1.0, 0.5])[None, :, None] * columns
    other = explain.explained(system.products(made(rng, data * np.array([[1.0], [0.5]])), scaled), np.ones(2), 0, [0, 1], (), 0.0)
    assert halved.coefficients == pytest.approx(other.coefficients, rel=1e-6)


def test_a_held_out_fold_is_never_fitted_on_itself() -> None:
    rng = np.random.default_rng(SEED)
    columns, data = rng.standard_normal((1, 2, N)), rng.standard_normal((2, N))
    built = made(rng, data)
    left = explain.held_out(system.products(built, columns), np.ones(2), [0])
    for fold in range(FOLDS):
        here = built.fold == fold
        x, y = columns[0][:, ~here].ravel(), data[:, ~here].ravel()
        coefficient = x @ y / (x @ x + 1.0)
        expected = np.sum((data[:, here] - coefficient * columns[0][:, here]) ** 2, axis=1)
        assert left[fold] == pytest.approx(expected, rel=1e-6)


def test_generic_discrepancy_is_worth_nothing_in_noise_and_much_in_a_signal() -> None:
    rng = np.random.default_rng(SEED)
    noise = rng.standard_normal((2, N))
    built = made(rng, noise)
    quiet = explain.explained(system.products(built, np.zeros((0, 2, N))), np.ones(2), 0, [], (), 0.0)
    loud = noise + 20.0 * np.stack([built.basis[0][:, 0], np.zeros(N)])
    found = explain.explained(system.products(System(built.grid, built.names, built.floor, built.weight, built.fold, built.basis, loud),
                                              np.zeros((0, 2, N))), np.ones(2), 0, [], (), 0.0)
    assert quiet.log_generic < 0.5
    assert found.log_generic > 100.0


def test_coefficients_count_from_where_the_data_were_taken() -> None:
    """A column that is uncertain by 1e8 floors stands at 0.8 of that; what a small one beside it holds must not be lost, nor either prior moved."""
    rng = np.random.default_rng(SEED)
    columns = rng.standard_normal((2, 2, N)) * np.array([1e8, 1.0])[:, None, None]
    about, truth = np.array([0.8, 0.0]), np.array([0.8 + 2e-8, 0.3])
    data = np.einsum("k,kcn->cn", truth - about, columns) + 0.1 * rng.standard_normal((2, N))
    found = explain.explained(system.products(made(rng, data), columns, about), np.ones(2), 2, [], (), 0.0)
    flat = columns.reshape(2, -1)
    exact = np.linalg.solve(flat @ flat.T / 1e16 + np.eye(2) / 1e16, (flat @ data.ravel() - about) / 1e16)
    assert found.coefficients - about == pytest.approx(exact, rel=1e-6)
    assert found.coefficients[1] == pytest.approx(0.3, abs=0.1)


def test_bounds_hold_and_the_others_make_up_for_them() -> None:
    rng = np.random.default_rng(SEED)
    columns = rng.standard_normal((2, 2, N))
    columns[1] += columns[0]
    data = 50.0 * columns[0] + rng.standard_normal((2, N))
    gram = system.products(made(rng, data), columns).pooled(np.ones(2))
    bounded = explain.within(gram, [0, 1], np.zeros(2), 3.0)
    assert bounded[0] == pytest.approx(3.0)
    rest = (data - 3.0 * columns[0]).ravel()
    alone = np.clip(columns[1].ravel() @ rest / (columns[1].ravel() @ columns[1].ravel() + 1.0), -3.0, 3.0)
    assert bounded[1] == pytest.approx(alone, rel=1e-6)
    assert np.all(np.abs(explain.within(gram, [0, 1], np.zeros(2), 100.0) - explain.posterior_mean(gram, [0, 1])[0]) < 1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_bounded_coefficients_are_the_best_within_their_bounds(seed: int) -> None:
    """By the conditions of optimality, from sums written out: no slope inside, and none that leads back in at a bound. Two columns are nearly the same, lengths differ a
    hundred thousand times, and some are beyond their bounds only once others have been held."""
    rng, limit = np.random.default_rng([SEED, seed]), 3.0
    count = int(rng.integers(5, 40))
    columns = rng.standard_normal((200, count)) * np.exp(rng.uniform(-2.0, 9.0, count))
    columns[:, 1] = columns[:, 0] + 1e-3 * columns[:, 1]
    data, middle = columns @ (4.0 * rng.standard_normal(count)) + rng.standard_normal(200), 0.5 * rng.standard_normal(count)
    rows = np.column_stack([columns, data])
    found = explain.within(rows.T @ rows, list(range(count)), middle, limit)
    slope = (columns.T @ (columns @ found - data) + found) / np.linalg.norm(columns, axis=0) / np.linalg.norm(data)
    below, above = found <= middle - limit + 1e-6, found >= middle + limit - 1e-6
    assert np.all(np.abs(found - middle) <= limit + 1e-6) and np.any(below | above)
    assert np.all(np.abs(slope[~below & ~above]) < 1e-8)
    assert np.all(slope[below] > -1e-8) and np.all(slope[above] < 1e-8)
