"""One more effect beside an explanation, on a linear twin: which ones are tried is held against evidences written as one Gaussian density each."""

from __future__ import annotations

import numpy as np
import pytest
from linear_bench import LinearBench, ridge, system_of
from scipy.stats import multivariate_normal

from wineglass.diagnosis.beside import LEAST_GAIN, TRIED, beside
from wineglass.diagnosis.channels import Grid
from wineglass.diagnosis.closure import Closed, Closer
from wineglass.diagnosis.explain import INCLUSION, Explained
from wineglass.diagnosis.responses import REACH, Column, Responses, Variant
from wineglass.effects import Setting

GRID = Grid(0.5, 0, 60)
NAMES = ("a", "b")
EFFECTS = ("ageing", "pickoff_gain", "cross_damping", "drive_feedthrough", "coriolis_gain", "thermal_gradient")
COUNTS = dict.fromkeys(EFFECTS, 1)


class Made:
    """One nuisance and six effects; columns (2, n) in floors per typical size."""

    def __init__(self, seed: int):
        from wineglass import effects

        rng = np.random.default_rng(seed)
        self.parameter = {name: next(p for p in effects.find(name).parameters if p.strength) for name in EFFECTS}
        self.column = {name: rng.standard_normal((2, GRID.count)) for name in EFFECTS}
        self.known = rng.standard_normal((2, GRID.count))
        self.noise = rng.standard_normal((2, GRID.count))
        twin = {(name, p.name): self.column[name] / p.typical for name, p in self.parameter.items()}
        columns = [Column("", None, "known", 1.0)] + [Column(n, Setting(n, {p.name: p.typical}), p.name, REACH) for n, p in self.parameter.items()]
        values = np.array([self.known, *self.column.values()])
        self.responses = Responses(NAMES, np.zeros((2, GRID.count)), tuple(columns), values, (0,), np.zeros(1),
                                   {name: [Variant(name, (i + 1,))] for i, name in enumerate(EFFECTS)})
        self.bench = LinearBench(GRID, NAMES, twin)

    def closed(self, data: np.ndarray) -> tuple[Closer, Closed]:
        """The explanation `ageing` by itself."""
        closer = Closer(self.bench, system_of(GRID, NAMES, data), self.responses, [0, 1])
        start = Explained(("ageing",), (self.responses.variants["ageing"][0],), 0.0, 0.0, np.zeros(2), np.array([0.0, 1.0 / REACH]))
        best = closer.close(start)
        return closer, best.weigh(np.ones(2), 1, COUNTS)

    def gain(self, data: np.ndarray, name: str) -> float:
        """Nats that `name` beside `ageing` is worth, its prior included; channels in which more is left than noise count less, as they do there."""
        base = [self.known, REACH * self.column["ageing"]]
        left = data - np.tensordot(ridge(np.array(base), data), np.array(base), 1)
        soft = np.sqrt(np.maximum(1.0, np.mean(left**2, axis=1)))[:, None]

        def density(columns: list[np.ndarray]) -> float:
            flat = np.array([column / soft for column in columns]).reshape(len(columns), -1)
            return float(multivariate_normal(np.zeros(data.size), np.eye(data.size) + flat.T @ flat).logpdf((data / soft).ravel()))

        return density([*base, REACH * self.column[name]]) - density(base) + float(np.log(INCLUSION / (1.0 - INCLUSION)))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_is_tried_are_the_three_that_gain_most_and_enough(seed: int) -> None:
    made = Made(seed)
    sizes = {"pickoff_gain": 1.5, "cross_damping": -1.2, "coriolis_gain": 0.9, "drive_feedthrough": 1.3}
    data = 2.0 * made.column["ageing"] + sum(size * made.column[name] for name, size in sizes.items()) + 0.5 * made.known + made.noise
    closer, best = made.closed(data)
    gains = {name: made.gain(data, name) for name in EFFECTS if name != "ageing"}
    expected = [name for name in sorted(gains, key=lambda name: -gains[name]) if gains[name] > LEAST_GAIN][:TRIED]
    assert expected, "the case has something to find"
    found = beside(closer, best, COUNTS)
    assert [set(entry.support) - {"ageing"} for entry in found] == [{name} for name in expected]


def test_each_is_closed_with_the_explanation_moved_along() -> None:
    made = Made(4)
    data = 2.0 * made.column["ageing"] - 1.5 * made.column["cross_damping"] + made.noise
    closer, best = made.closed(data)
    first = beside(closer, best, COUNTS)[0]
    assert first.support == ("ageing", "cross_damping")
    expected = ridge(np.array([made.known, REACH * made.column["ageing"], REACH * made.column["cross_damping"]]), data)[1:] * REACH
    typical = np.array([made.parameter[name].typical for name in first.support])
    assert [u.effect for u in first.unknowns] == ["ageing", "cross_damping"]
    assert first.values / typical == pytest.approx(expected, rel=3e-3)


def test_beside_the_whole_truth_there_is_nothing() -> None:
    made = Made(5)
    closer, best = made.closed(2.0 * made.column["ageing"] + made.noise)
    assert beside(closer, best, COUNTS) == []
