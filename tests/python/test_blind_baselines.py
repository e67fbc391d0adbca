"""The baselines on made-up features whose signatures are known."""

import blind_sets as sets
import numpy as np
import pytest

from wineglass.blind.baselines import engines, features, training
from wineglass.blind.marks import truth_of

SEED = 5
IDS = ("ageing", "clock_error", "pickoff_gain", "thermometer_lag")
VARIANTS = ("linear", "constant", "constant", "one_pole")
WIDTH = 40


@pytest.fixture(scope="module")
def world():
    """(signatures (4, WIDTH), mixing (WIDTH, WIDTH) that correlates the nulls, offset): features are offset + mixing (signature + white noise)."""
    random = np.random.default_rng(SEED)
    return random.standard_normal((4, WIDTH)) * 30.0, np.eye(WIDTH) + 0.3 * random.standard_normal((WIDTH, WIDTH)), random.uniform(-5, 5, WIDTH)


def case(world, random, *which):
    signatures, mixing, offset = world
    moved = sum((random.uniform(0.7, 1.5) * signatures[i] for i in which), np.zeros(WIDTH))
    return offset + mixing @ (moved + random.standard_normal(WIDTH))


@pytest.fixture(scope="module")
def learned(world):
    random = np.random.default_rng(SEED + 1)
    sheets, rows = [], []
    for i in range(120):
        which = () if i < 60 else (i % 4,)
        sheets.append(sets.sheet(f"case_{i:04d}", "null_unit" if not which else "single", *((IDS[k], VARIANTS[k]) for k in which)))
        rows.append(case(world, random, *which))
    return training.learn(np.array(rows), sheets)


@pytest.mark.parametrize("name", ["nearest_signature", "lasso", "thresholding", "stepwise", "random_forest"])
def test_a_clear_single_is_named_and_a_null_is_smaller(name, world, learned):
    baseline = engines.forest(learned) if name == "random_forest" else engines.UNTAUGHT[name]
    group, random = learned.group("metal-fast full open"), np.random.default_rng(SEED + 2)
    nulls = [baseline(group.white(case(world, random)), group).gap for _ in range(8)]
    hits = 0
    for i in range(8):
        found = baseline(group.white(case(world, random, i % 4)), group)
        assert sum(found.weights.values()) == pytest.approx(1.0) and found.gap > max(nulls)
        hits += max(found.weights, key=found.weights.__getitem__) == {IDS[i % 4]}
    assert hits >= 7


@pytest.mark.parametrize("name", ["lasso", "thresholding", "stepwise"])
def test_sparse_ones_find_pairs(name, world, learned):
    baseline, group, random = engines.UNTAUGHT[name], learned.group("metal-fast full open"), np.random.default_rng(SEED + 3)
    found = baseline(group.white(case(world, random, 0, 2)), group)
    assert max(found.weights, key=found.weights.__getitem__) == {IDS[0], IDS[2]}


def test_nulls_are_white(world, learned):
    group, random = learned.group("metal-fast full open"), np.random.default_rng(SEED + 4)
    white = np.array([group.white(case(world, random)) for _ in range(400)])
    assert np.median(white.std(axis=0)) == pytest.approx(1.0, abs=0.5)


def test_another_kind_of_recording_falls_back_to_all(learned):
    assert learned.group("silica thermal open") is learned.group("")
    assert len(learned.sheets) == 120 and truth_of(learned.sheets[0]) == {"none"}


def test_every_feature_has_a_name():
    assert len(features.NAMES) == len(set(features.NAMES)) == 140
