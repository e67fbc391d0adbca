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


class Channels:
    """One channel, noise one, whose laws are the rows of an identity: an effect needs as many as its response has places."""

    names, pick = ("rate",), [0]
    nominal = np.zeros((1, COUNT))
    responses = SimpleNamespace(nuisances=(0,), values=np.zeros((1, 1, COUNT)))

    def __init__(self, parts: dict[str, int]):
        self.parts, self.bench = parts, self
        self.system = SimpleNamespace(whiten=lambda series: series)

    def run(self, settings: list[SimpleNamespace]) -> np.ndarray:
        begin = 6 * list(self.parts).index(settings[0].id)
        return 50.0 * (np.arange(COUNT) - begin < self.parts[settings[0].id])[None] * (np.arange(COUNT) >= begin)

    def tried(self, settings: list[SimpleNamespace]) -> np.ndarray:
        return self.run(settings) - self.nominal

    def explanation(self) -> SimpleNamespace:
        settings = [SimpleNamespace(id=effect) for effect in self.parts]
        unknowns = [SimpleNamespace(role="strength", effect=effect, name=name) for effect in self.parts for name in ("a", "b")]
        return SimpleNamespace(support=tuple(self.parts), settings=settings, unknowns=unknowns, response=sum(self.run([s]) for s in settings))


@pytest.mark.parametrize(("parts", "imitated"), [
    ({"drive_phase": 2}, {"drive_phase"}), ({"drive_phase": 3}, set()), ({"thermal_gradient": 1}, set()),
    ({"drive_phase": 2, "pickoff_gain": 1}, {"drive_phase", "pickoff_gain"}), ({"drive_phase": 1, "pickoff_gain": 5}, {"drive_phase"}),
    ({"thermal_gradient": 1, "pickoff_gain": 5}, set()), ({"drive_phase": 3, "pickoff_gain": 3}, set())])
def test_what_as_few_laws_do_as_an_effect_has_numbers(parts: dict[str, int], imitated: set[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Two numbers an effect; together four, alone each its own two. A law of the bias is its effect by definition."""
    monkeypatch.setattr(plain, "_laws", lambda found: np.eye(COUNT))
    found = Channels(parts)
    assert plain.imitated(found, found.explanation()) == imitated  # type: ignore[arg-type]


@pytest.mark.parametrize(("effect", "imitated"), [("thermal_gradient", {"thermal_gradient"}), ("ageing", set()), ("thermal_hysteresis", set())])
def test_a_gradient_whose_law_is_bent_may_be_any_difference_of_temperatures(effect: str, imitated: set[str]) -> None:
    bent = SimpleNamespace(role="form", effect=effect, name="c")
    found = Channels({effect: 1})
    straight = found.explanation()
    assert plain.imitated(found, SimpleNamespace(**{**vars(straight), "unknowns": [*straight.unknowns, bent]})) == imitated  # type: ignore[arg-type]
    assert plain.imitated(found, straight) == set()  # type: ignore[arg-type]
