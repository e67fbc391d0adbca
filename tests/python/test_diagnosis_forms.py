"""Laws that bend, on a linear twin, where the best coefficients are a least-squares solution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from linear_bench import LinearBench, ridge, system_of
from scipy.stats import multivariate_normal

from wineglass import effects, paths
from wineglass.diagnosis import curves, forms, unknowns
from wineglass.diagnosis.channels import Grid
from wineglass.diagnosis.closure import Closed, Closer
from wineglass.diagnosis.explain import Explained
from wineglass.diagnosis.responses import REACH, Column, Responses, Variant
from wineglass.effects import Setting

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")

GRID = Grid(0.5, 0, 240)
NAMES = ("a", "b")
ID = "pickoff_gain"
SHELL_DEGC = 30.0 - 30.0 * np.cos(4.0 * np.pi * np.arange(GRID.count) / GRID.count)
"""twice from 0 to 60 degC and back"""


class Made:
    """One effect that shows in the first channel: in proportion, and in proportion to its curve. One nuisance, in the second."""

    def __init__(self, seed: int):
        self.rng = np.random.default_rng(seed)
        self.strength = next(p for p in effects.find(ID).parameters if p.strength)
        self.points = curves.seen(effects.find(ID), SHELL_DEGC)
        base = np.stack([1.0 + 0.3 * self.rng.standard_normal(GRID.count), np.zeros(GRID.count)])
        twin = {(ID, self.strength.name): base / self.strength.typical}
        twin |= {(ID, p.name): base * curves.weight(SHELL_DEGC, p.name) / p.typical for p in self.points}
        self.base, self.known = base, np.stack([np.zeros(GRID.count), self.rng.standard_normal(GRID.count)])
        self.noise = self.rng.standard_normal((2, GRID.count))
        self.bench = LinearBench(GRID, NAMES, twin, shell_degc=SHELL_DEGC)
        column = Column(ID, Setting(ID, {self.strength.name: self.strength.typical}), self.strength.name, REACH)
        self.responses = Responses(NAMES, np.zeros((2, GRID.count)), (Column("", None, "known", 1.0), column), np.array([self.known, base]), (0,), np.zeros(1),
                                   {ID: [Variant(ID, (1,))]})

    def closed(self, data: np.ndarray) -> tuple[Closer, Closed]:
        closer = Closer(self.bench, system_of(GRID, NAMES, data), self.responses, [0, 1])  # type: ignore[arg-type]
        start = Explained((ID,), (self.responses.variants[ID][0],), 0.0, 0.0, np.zeros(2), np.array([0.0, 1.0 / REACH]))
        return closer, closer.close(start)

    def bump(self) -> np.ndarray:
        """(2, n), of a law that no constant follows."""
        return 20.0 * self.base * np.exp(-0.5 * ((SHELL_DEGC - 40.0) / 9.0) ** 2)


def test_a_law_bends_to_what_least_squares_say() -> None:
    made = Made(1)
    data = 3.0 * made.base + made.bump() + made.noise
    closer, straight = made.closed(data)
    found = forms.bent(closer, straight)
    assert [u.name for u in found.unknowns[1:]] == [p.name for p in made.points] and {u.role for u in found.unknowns[1:]} == {"form"}
    columns = [made.known, REACH * made.base, *(REACH * made.base * curves.weight(SHELL_DEGC, p.name) for p in made.points)]
    expected = ridge(np.array(columns), data)
    response = np.tensordot(expected[1:], np.array(columns[1:]), 1)
    assert found.response == pytest.approx(response, abs=0.02 * float(np.max(np.abs(response))))
    assert closer.cost_of(found) < 0.1 * closer.cost_of(straight)


def test_noise_and_what_no_form_explains_bend_nothing() -> None:
    made = Made(2)
    for data in (3.0 * made.base + made.noise, 3.0 * made.base + 10.0 * made.rng.standard_normal((2, GRID.count))):
        closer, straight = made.closed(data)
        assert forms.bent(closer, straight) is straight


def test_evidence_of_a_bent_law_is_a_density_and_a_prior() -> None:
    """Against one Gaussian density of all data, the straight part held where it was; a law that bends is ten times less likely beforehand."""
    made = Made(3)
    data = 3.0 * made.base + made.bump() + made.noise
    closer, straight = made.closed(data)
    found = forms.bent(closer, straight)
    known = [made.known, REACH * made.base]
    curve = [REACH * made.base * curves.weight(SHELL_DEGC, p.name) for p in made.points]
    gained = [entry.weigh(np.ones(2), 1, {ID: 1}).entry.log_evidence for entry in (straight, found)]
    beside = density(data - straight.values[0] / made.strength.typical * made.base, [known[0], unknowns.HELD * known[1], *curve])
    expected = beside - density(data, known) + np.log(0.1)
    assert gained[1] - gained[0] == pytest.approx(expected, abs=0.2)


def density(data: np.ndarray, columns: list[np.ndarray]) -> float:
    flat = np.array(columns).reshape(len(columns), -1)
    return float(multivariate_normal(np.zeros(data.size), np.eye(data.size) + flat.T @ flat).logpdf(data.ravel()))


def test_forms_that_the_recording_cannot_show_are_left_out() -> None:
    found = [u.name for u in forms.forms_of(ID, Made(4).bench)]  # type: ignore[arg-type]
    assert found == [p.name for p in curves.seen(effects.find(ID), SHELL_DEGC)]
    assert [u.name for u in forms.forms_of("amplitude_damping", Made(4).bench)] == ["power_beyond_square"]  # type: ignore[arg-type]


def test_a_bend_that_is_no_longer_needed_is_dropped_and_one_that_is_stays() -> None:
    made = Made(6)
    closer, straight = made.closed(3.0 * made.base + made.bump() + made.noise)
    bent = forms.bent(closer, straight)
    assert forms.pruned(closer, bent) is bent
    assert [u.held for u in bent.unknowns] == [True, *[False] * (len(bent.unknowns) - 1)]  # what the curve could be, too, stays where it was
    other, alone = made.closed(3.0 * made.base + made.noise)
    again = other.resume(bent.support, bent.variants, bent.unknowns, bent.values, bent.jacobian)
    found = forms.pruned(other, again)
    assert found.unknowns == [unknowns.freed(bent.unknowns[0])] and not found.unknowns[0].held
    assert found.values == pytest.approx(alone.values, rel=1e-3)


def test_strengths_that_say_nothing_are_left_out_but_never_the_first() -> None:
    """Of the two strengths of a gain, the second one a slope over temperature."""
    made, rng = Made(7), np.random.default_rng(7)
    slope = next(p for p in effects.find(ID).parameters if p.strength and p.name != made.strength.name)
    sloped = made.base * (SHELL_DEGC - 30.0) / 30.0
    made.bench.columns[ID, slope.name] = sloped / slope.typical
    column = Column(ID, Setting(ID, {slope.name: slope.typical}), slope.name, REACH)
    both = Variant(ID, (1, 2))
    made.responses = replace(made.responses, columns=(*made.responses.columns, column), values=np.concatenate([made.responses.values, sloped[None]]), variants={ID: [both]})
    start = Explained((ID,), (both,), 0.0, 0.0, np.zeros(2), np.array([0.0, 1.0 / REACH, 0.0]))
    for size, left in ((0.0, [made.strength.name]), (2.0, [made.strength.name, slope.name])):
        for first in (3.0, 0.0):
            data = first * made.base + size * sloped + rng.standard_normal((2, GRID.count))
            closer = Closer(made.bench, system_of(GRID, NAMES, data), made.responses, [0, 1])  # type: ignore[arg-type]
            closed = closer.close(start)
            assert len(closed.unknowns) == 2
            thinned = forms.thinned(closer, closed)
            assert [u.name for u in thinned.unknowns] == left
            gained = [entry.weigh(np.ones(2), 1, {ID: 1}).entry.log_evidence for entry in (closed, thinned)]
            assert gained[1] >= gained[0] - 1e-9
