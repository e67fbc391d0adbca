"""What named noise does to the slow channels: the floor against Allan's integral, and which frames are left."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad

from wineglass import device, scenario
from wineglass.diagnosis import noisy, tones
from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.noise_added import Added
from wineglass.diagnosis.noise_events import Event, Events
from wineglass.diagnosis.noise_level import NoiseEvidence
from wineglass.recording.memory import MemoryRecording

METAL = device.load("metal-fast")
NAMES = ("primary_in_phase", "drive_level", "secondary_in_phase", "secondary_quadrature", "rebalance_in_phase", "rate", "rate_uncompensated", "quadrature",
         "temperature_measured")


def driven() -> Driven:
    run = scenario.prepare(scenario.load("rate-steps").changed({"device": "metal-fast", "duration_s": 1.0}))
    return Driven(run, b"", "temperature_measured", True)


@dataclass(frozen=True)
class Wander(Added):
    """A bias with the density h / f."""

    h: float = 0.0

    def wander_psd(self, freq_hz: np.ndarray) -> np.ndarray:
        return self.h / np.asarray(freq_hz, float)


def allan_deviation(h: float) -> float:
    """Of a density h / f, from the integral over all frequencies: 2 S(f) sin(x)^4 / x^2 with x = pi f tau; tau does not matter."""
    near = quad(lambda x: np.sin(x) ** 4 / x**3, 1e-9, 200.0, limit=2000)[0]
    beyond = 0.375 / (2.0 * 200.0**2)  # the mean of sin^4 is 3/8
    return float(np.sqrt(2.0 * h * (near + beyond)))


def instability(driven: Driven) -> float:
    return driven.run.device.noise_floor.rate_bias_instability_rad_s


def test_the_floor_is_raised_by_the_wanders_allan_deviation() -> None:
    before = driven()
    floor = instability(before)
    h = (7.0 * floor) ** 2
    after = noisy.device_with(before, Wander({}, h))
    assert instability(after) == pytest.approx(np.hypot(allan_deviation(h), floor), rel=1e-3)
    assert instability(before) == floor, "the description itself is not changed"
    assert after.run.scenario == before.run.scenario and after.calibration_block == before.calibration_block


def test_a_wander_below_the_floor_changes_nothing() -> None:
    before = driven()
    assert noisy.device_with(before, Wander({}, 0.0)) is before
    assert noisy.device_with(before, Wander({}, 0.5 * instability(before) ** 2)) is before
    assert noisy.device_with(before, Added({})) is before


def test_an_absurd_wander_stays_a_description() -> None:
    assert instability(noisy.device_with(driven(), Wander({}, 1e6))) == 1.0


# ---- frames ---------------------------------------------------------------------------------------------------------------------


def frames(first: int = 40, count: int = 200, frame_s: float = 0.25) -> Frames:
    rng = np.random.default_rng(3)
    return Frames(Grid(frame_s, first, count), NAMES, rng.standard_normal((len(NAMES), count)), rng.random((len(NAMES), count)) > 0.1)


def evidence(*spans: tuple[float, float]) -> SimpleNamespace:
    asked: list[float] = []

    def disturbed_s(decay_per_s: float) -> list[tuple[float, float]]:
        asked.append(decay_per_s)
        return list(spans)

    return SimpleNamespace(disturbed_s=disturbed_s, asked=asked)


def test_frames_that_an_event_touches_are_not_used() -> None:
    """Compared with overlap of intervals: a frame is out if any of it lies in a span."""
    recorded, spans = frames(), ((12.3, 13.1), (30.0, 30.0), (59.9, 1000.0), (-5.0, 10.1))
    left = noisy.undisturbed(recorded, driven(), evidence(*spans))
    edges = (recorded.grid.first + np.arange(recorded.grid.count)) * recorded.grid.frame_s
    for j, begin in enumerate(edges):
        end = begin + recorded.grid.frame_s
        if any(begin < stop and end > start for start, stop in spans):
            assert not left.use[:, j].any(), f"frame {j} is shaken"
        elif all(begin > stop + recorded.grid.frame_s or end < start - recorded.grid.frame_s for start, stop in spans):
            assert np.array_equal(left.use[:, j], recorded.use[:, j]), f"frame {j} is sound"
    assert np.array_equal(left.values, recorded.values)
    assert recorded.use.any(axis=0).all(), "the recording's own frames are not changed"


def test_the_shell_is_given_its_own_time_to_decay() -> None:
    noise = evidence()
    noisy.undisturbed(frames(), driven(), noise)
    assert noise.asked == [pytest.approx(np.pi * METAL.resonator.frequency_hz / METAL.resonator.q)]


def test_where_nearly_all_is_shaken_nothing_is_left() -> None:
    recorded = frames(first=0, count=200)
    some = noisy.undisturbed(recorded, driven(), evidence((0.0, 0.9 * 50.0)))
    assert np.any(some.use)
    assert not np.any(noisy.undisturbed(recorded, driven(), evidence((0.0, 0.95 * 50.0))).use)


def named(*lines: object) -> SimpleNamespace:
    return SimpleNamespace(named=["interference"], lines=SimpleNamespace(clear=list(lines)))


FED = ("secondary_in_phase", "secondary_quadrature", "rebalance_in_phase", "rate", "rate_uncompensated", "quadrature")


@pytest.mark.parametrize("noise", [SimpleNamespace(named=["interference"], lines=None), named(), named(SimpleNamespace(kind="clock_jitter"))])
def test_without_a_line_of_its_own_a_tone_keeps_what_the_secondary_pickoff_feeds_from_use(noise: SimpleNamespace) -> None:
    recorded = frames()
    left = noisy.without_beats(recorded, MemoryRecording(1000.0), noise)
    for i, name in enumerate(NAMES):
        assert np.array_equal(left.use[i], np.zeros_like(left.use[i]) if name in FED else recorded.use[i]), name
    assert recorded.use[NAMES.index("rate")].any()


def test_channels_that_a_line_leaves_take_their_means_from_it(monkeypatch: pytest.MonkeyPatch) -> None:
    recorded, line = frames(), SimpleNamespace(kind="interference")
    sound = np.arange(recorded.grid.count) % 3 > 0
    asked: list[object] = []

    def without(frames: Frames, recording: object, lines: list[object], names: list[str]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        asked.extend([lines, names])
        return {"rate": (np.full(frames.grid.count, 2.0), sound)}

    monkeypatch.setattr(tones, "without", without)
    left = noisy.without_beats(recorded, MemoryRecording(1000.0), named(line, SimpleNamespace(kind="other")))
    assert asked == [[line], list(FED)], "only lines of what was named, only channels that it reaches"
    rate, before = left.names.index("rate"), recorded.use[NAMES.index("rate")]
    assert np.array_equal(left["rate"], np.full(recorded.grid.count, 2.0)) and np.array_equal(left.use[rate], before & sound)
    for i, name in enumerate(NAMES):
        if name != "rate":
            assert np.array_equal(left.values[i], recorded.values[i])
            assert not left.use[i].any() if name in FED else np.array_equal(left.use[i], recorded.use[i]), name


@pytest.mark.parametrize(("events", "masked"), [([Event(20.0, 0.3, 3, False)], True), ([Event(20.0, 0.0, 0, True)], True), ([], False)])
def test_where_samples_are_lost_a_spike_that_turned_nothing_may_be_a_whole_turn(events: list[Event], masked: bool) -> None:
    seen = Events(events, 600.0, 5e4, spikes_s=[100.0])
    evidence = NoiseEvidence({frozenset(): 0.0}, [], [], None, None, None, None, seen, None, None)
    spans = evidence.disturbed_s(1.0)
    assert any(begin <= 99.6 and end >= 100.4 for begin, end in spans) == masked
