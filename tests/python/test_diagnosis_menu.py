"""The next experiment: what one explanation cannot imitate of another, against least squares with the priors written as rows, and where it is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from linear_bench import LinearBench, ridge, uncertainties

from wineglass import protocols, scenario
from wineglass.diagnosis import menu, responses
from wineglass.diagnosis.channels import Grid
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.unknowns import Unknown
from wineglass.effects import Setting

NAMES = ("a", "b")
FLOOR = np.array([1e-6, 3e-5])
A, B = ("ageing", "linear_rad_s_per_h"), ("cross_damping", "c0_rad_s")
STRENGTH_A, STRENGTH_B, SPREAD_B = 2e-4, 1e-4, 1e-3
FULL = scenario.prepare(protocols.scenario("full", device="metal-fast")).scenario
KINDS = {"rate steps": "rate_", "a rate chirp": "chirp_", "amplitude steps": "amplitude_", "a ring-down with the drive off": "ring_down_",
         "forces on the sense axis": "test_", "forces on the sense axis with the loop open": "free_"}


class Room:
    """Both explanations and the recording they come from; the experiment's bench is linear, with columns in floors per typical strength."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch):
        run = scenario.prepare(scenario.load("rate-steps").changed({"device": "metal-fast", "duration_s": 1.0}))
        self.columns: dict[tuple[str, str], np.ndarray] = {}
        self.known: list[tuple[str, np.ndarray]] = []
        self.grid: Grid | None = None
        self.found = SimpleNamespace(driven=Driven(run, b"", "temperature_measured", True), grid=Grid(0.25, 3, 17), names=NAMES,
                                     system=SimpleNamespace(floor=SimpleNamespace(rms=FLOOR)))
        monkeypatch.setattr(menu, "Bench", self.bench)
        monkeypatch.setattr(responses, "uncertainties", uncertainties)
        self.first = SimpleNamespace(settings=[Setting(A[0], {A[1]: STRENGTH_A})])
        self.second = SimpleNamespace(settings=[Setting(B[0], {B[1]: STRENGTH_B})], values=np.array([STRENGTH_B]),
                                      unknowns=[Unknown(*B, "strength", STRENGTH_B, 0.0, SPREAD_B, -0.05, 0.05)])

    def bench(self, driven: Driven, grid: Grid, names: tuple[str, ...]) -> LinearBench:
        assert driven.run.scenario.name == FULL.name, "the experiment is the whole protocol"
        return LinearBench(grid, names, self.columns, self.known)

    def set(self, a: np.ndarray, b: np.ndarray, *known: np.ndarray) -> None:
        """(channels, n) in floors, of the strengths above and of one standard deviation."""
        self.columns.update({A: a * FLOOR[:, None] / STRENGTH_A, B: b * FLOOR[:, None] / STRENGTH_B})
        self.known[:] = [(f"known {i}", column * FLOOR[:, None]) for i, column in enumerate(known)]

    def propose(self) -> menu.Proposal:
        return menu.propose(self.found, self.first, self.second)


@pytest.fixture
def room(monkeypatch: pytest.MonkeyPatch) -> Room:
    return Room(monkeypatch)


def time_s() -> np.ndarray:
    """Frames of the experiment as the recording's are, from the eighth to the eighth last."""
    return (8.5 + np.arange(int(FULL.duration_s / 0.25) - 9)) * 0.25


def within(prefix: str) -> np.ndarray:
    t = time_s()
    return np.any([(t >= s.begin_s) & (t < s.end_s) for s in FULL.segment if s.name.startswith(prefix)], axis=0)


def test_the_separation_is_what_least_squares_leaves(room: Room) -> None:
    rng = np.random.default_rng(11)
    shape = (2, len(time_s()))
    a, b, known = 0.3 * rng.standard_normal(shape), 0.2 * rng.standard_normal(shape), 0.1 * rng.standard_normal((3, *shape))
    a += 0.7 * known[0] + b
    room.set(a, b, *known)
    columns = np.concatenate([known, (b * SPREAD_B / STRENGTH_B)[None]])
    wanted = a - b
    left = wanted - np.tensordot(ridge(columns, wanted), columns, 1)
    assert room.propose().separation == pytest.approx(0.5 * float(np.sum(left**2)), rel=1e-6)


@pytest.mark.parametrize(("phrase", "prefix"), KINDS.items())
def test_the_experiment_is_where_they_differ(room: Room, phrase: str, prefix: str) -> None:
    t = time_s()
    same = np.vstack([np.sin(t / 50.0), np.cos(t / 70.0)])
    room.set(same + np.vstack([within(prefix) * np.cos(t), np.zeros_like(t)]), same)
    proposal = room.propose()
    assert proposal.run.startswith(phrase + " (") and proposal.why.startswith("100%"), proposal


@pytest.mark.parametrize("name", ["fast_heating", "slow_cooling", "hot_again"])
def test_what_only_temperature_shows_asks_for_thermal_cycles(room: Room, name: str) -> None:
    t = time_s()
    room.set(np.vstack([within(name) * np.cos(t), 0 * t]), np.vstack([0 * t, 0 * t]))
    assert room.propose().run.startswith(menu.THERMAL)


def test_the_larger_part_wins_and_is_told(room: Room) -> None:
    """Twice the amplitude over 24 s against once over 30 s: energies, not lengths."""
    t = time_s()
    chirp, test = within("chirp_"), within("test_")
    room.set(np.vstack([1.0 * chirp + 2.0 * test, 0 * t]), np.vstack([0 * t, 0 * t]))
    energy, other = 4.0 * np.sum(test), 1.0 * np.sum(chirp)
    proposal = room.propose()
    assert proposal.run.startswith("forces on the sense axis (")
    assert proposal.why.startswith(f"{energy / (energy + other):.0%}")
    assert proposal.separation == pytest.approx(0.5 * (energy + other), rel=1e-6)


def test_the_same_by_another_name_has_no_experiment(room: Room) -> None:
    """The second is 30 times the first's size, and its prior reaches ten times that: it imitates all of it."""
    t = time_s()
    shape = np.vstack([np.sin(t / 9.0), np.cos(t / 17.0)])
    room.set(shape, 30.0 * shape)
    proposal = room.propose()
    assert proposal.separation < menu.ENOUGH and proposal.run.startswith("no experiment")


def test_what_a_tolerance_may_do_separates_nothing(room: Room) -> None:
    t = time_s()
    shape = np.vstack([np.sin(t / 9.0), 0 * t])
    room.set(shape, 0 * shape, 5.0 * shape)
    assert room.propose().separation < menu.ENOUGH
    room.set(shape, 0 * shape, 5.0 * shape[::-1])
    assert room.propose().separation == pytest.approx(0.5 * float(np.sum(shape**2)), rel=1e-6)
