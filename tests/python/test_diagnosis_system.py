"""How large the noise of a recording is, and which of its frames are left out, against noise that was drawn with a known size. No twin runs.

The seed is fixed; `WINEGLASS_SEED` adds to it."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from wineglass.diagnosis import system
from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.floors import ORDER, Floor
from wineglass.diagnosis.system import System

N = 2000
GRID = Grid(0.25, 0, N)
NAMES = ("rate", "secondary_in_phase")
REMEMBERS = 0.9


def floor() -> Floor:
    """Of size one and white; and one that remembers nine tenths from frame to frame, with an innovation of one."""
    coefficients = np.zeros((2, ORDER))
    coefficients[1, 0] = REMEMBERS
    return Floor(np.array([1.0, 1.0 / np.sqrt(1.0 - REMEMBERS**2)]), np.ones(2), coefficients)


def noise(rng: np.random.Generator, size: float) -> np.ndarray:
    white = rng.normal(0.0, size, (2, N))
    return np.stack([white[0], lfilter([1.0], [1.0, -REMEMBERS], white[1])])


def frames(values: np.ndarray) -> Frames:
    return Frames(GRID, NAMES, values, np.ones((2, N), bool))


def built(recorded: Frames) -> System:
    return system.build(recorded, frames(np.zeros((2, N))), floor(), NAMES, [], np.zeros(N, bool), None)


@pytest.fixture
def rng() -> np.random.Generator:
    seed = 4711 + int(os.environ.get("WINEGLASS_SEED", "0"))
    print("seed", seed)
    return np.random.default_rng(seed)


@pytest.mark.parametrize("size", [0.9, 1.4, 2.0])
def test_the_floor_is_as_large_as_the_fastest_changes(rng: np.random.Generator, size: float) -> None:
    slow = 30.0 * np.sin(2.0 * np.pi * np.arange(N) / N)
    assert built(frames(noise(rng, size) + slow)).floor.innovation == pytest.approx([size, size], rel=0.15)


def test_more_than_noise_may_be_is_left_to_the_gap(rng: np.random.Generator) -> None:
    assert built(frames(noise(rng, 20.0))).floor.innovation == pytest.approx([system.MOST_NOISE] * 2)


@pytest.mark.parametrize("size", [1.0, 8.0])
def test_what_is_left_out_of_a_shaken_recording_is_no_noise(rng: np.random.Generator, size: float) -> None:
    """Ten frames are left out of every thirty, and all stand a thousand floors off: where they were put to zero, the jumps would be the noise."""
    recorded = replace(frames(noise(rng, size) + 1000.0), shaken=True)
    recorded.use[:, np.arange(N) % 30 < 10] = False
    assert built(recorded).floor.innovation == pytest.approx([size, size], rel=0.25)


def test_frames_that_jump_unseen_are_left_out_of_a_shaken_recording(rng: np.random.Generator) -> None:
    values = noise(rng, 1.0)
    kicked = np.arange(50, N, 100)
    values[0, kicked] += 30.0
    quiet, shaken = built(frames(values)), built(replace(frames(values), shaken=True))
    assert np.all(quiet.weight[0, kicked] > 0.0)
    assert not np.any(shaken.weight[0, kicked])
    assert np.mean(shaken.weight[0] > 0.0) > 0.95
    assert shaken.floor.innovation[0] == pytest.approx(1.0, rel=0.15)


def test_what_jumps_all_the_time_is_what_a_shaken_recording_is_like(rng: np.random.Generator) -> None:
    values = noise(rng, 1.0)
    values[0] += 30.0 * (rng.random(N) < 0.4)
    found = built(replace(frames(values), shaken=True))
    assert np.all(found.weight[0] > 0.0)
    assert found.floor.innovation[0] > 10.0


@pytest.mark.parametrize(("steady", "least", "most"), [(15, 8.0, 50.0), (N, 0.0, 2.2)])
def test_what_is_left_of_a_line_is_noise_only_where_a_loop_was_open_for_a_short_while(rng: np.random.Generator, steady: int, least: float, most: float) -> None:
    recorded = replace(frames(noise(rng, 20.0)), freed=frozenset(NAMES[1:]))
    recorded.use[1, steady:] = False
    found = built(recorded).floor.innovation
    assert found[0] == pytest.approx(system.MOST_NOISE)
    assert least <= found[1] <= most
