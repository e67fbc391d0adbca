"""How many plain laws do what an explanation does, against least squares over all sets of them."""

from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from wineglass.diagnosis import plain

COUNT, LENGTH = 12, 400


def needed(laws: np.ndarray, wanted: np.ndarray, most: int) -> int:
    """The fewest laws of any set that leave no more than they may, by least squares; laws (k, n), wanted (n,)."""
    for size in range(1, most + 1):
        for chosen in combinations(range(len(laws)), size):
            columns = laws[list(chosen)].T
            left = wanted - columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0]
            if left @ left <= max(plain.NOISE, plain.ENOUGH**2 * (wanted @ wanted)):
                return size
    return most + 1


@pytest.mark.parametrize(("sizes", "beside"), [((50.0,), 0.0), ((50.0, -40.0), 0.0), ((50.0, -40.0, 30.0), 0.0), ((50.0, 20.0), 3.0), ((0.0,), 60.0), ((1.0,), 0.0)])
def test_it_is_the_smallest_number_of_laws(sizes: tuple[float, ...], beside: float) -> None:
    rng = np.random.default_rng(11)
    laws = rng.standard_normal((COUNT, LENGTH))
    foreign = rng.standard_normal(LENGTH)
    wanted = sum((size * law for size, law in zip(sizes, laws[3:])), beside * foreign)
    found = plain._picked(laws @ laws.T, laws @ wanted, float(wanted @ wanted), 3)
    assert found == needed(laws, wanted, 3)


def test_laws_that_the_recording_does_not_show_do_nothing() -> None:
    laws = np.vstack([np.zeros(LENGTH), np.ones(LENGTH)])
    wanted = 5.0 * np.sin(np.arange(LENGTH))
    assert plain._picked(laws @ laws.T, laws @ wanted, float(wanted @ wanted), 2) == 3


def test_a_law_of_the_bias_is_its_effect_by_definition(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plain, "laws_needed", lambda found, closed, most: 1)
    unknowns = [SimpleNamespace(role="strength", effect="x", name="size")]
    assert not plain.imitable(None, SimpleNamespace(support=("thermal_gradient",), unknowns=unknowns))  # type: ignore[arg-type]
    assert plain.imitable(None, SimpleNamespace(support=("drive_phase", "thermal_gradient"), unknowns=unknowns))  # type: ignore[arg-type]
