"""Frames of recordings with lost samples, against frames of the same recordings whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from wineglass.diagnosis.channels import LONGEST_GAP, Grid, read

RATE_HZ, FRAME = 50.0, 12
SEED = 8


@dataclass
class Tap:
    """A baseband of one channel; what is lost is not a number."""

    values: np.ndarray
    sample_rate_hz: float = RATE_HZ

    @property
    def length(self) -> int:
        return len(self.values)

    @property
    def valid(self) -> np.ndarray:
        return np.isfinite(self.values)

    @property
    def time_s(self) -> np.ndarray:
        return (np.arange(self.length) + 0.5) / RATE_HZ

    def __contains__(self, channel: object) -> bool:
        return channel == "drive_level"

    def __getitem__(self, channel: str) -> np.ndarray:
        return self.values


class OneTap:
    def __init__(self, values: np.ndarray):
        self._tap = Tap(values)

    def __contains__(self, name: object) -> bool:
        return name == "baseband"

    def tap(self, name: str) -> Tap:
        return self._tap


def frames(values: np.ndarray):
    return read(OneTap(values), Grid(FRAME / RATE_HZ, 0, len(values) // FRAME))  # type: ignore[arg-type]


def curve(noise: float, count: int = 100 * FRAME) -> np.ndarray:
    time_s = np.arange(count) / RATE_HZ
    return 2.0 + 0.3 * time_s - 0.02 * time_s**2 + 0.001 * time_s**3 + noise * np.random.default_rng(SEED).standard_normal(count)


def test_a_cubic_with_lost_samples_has_the_means_of_the_whole_one() -> None:
    whole = curve(1e-3)
    smooth = curve(0.0)
    lost = whole.copy()
    places = np.random.default_rng(SEED + 1).choice(np.arange(20, len(whole) - 20, 7), 40, replace=False)
    lost[places] = np.nan
    found, true = frames(lost), frames(whole)
    assert found.use.all()
    error = (found.values - true.values)[0]
    touched = np.unique(places // FRAME)
    assert np.array_equal(np.flatnonzero(found.bridged), touched)
    assert not np.any(np.delete(error, touched))
    assert np.sqrt(np.mean(error[touched] ** 2)) < 2.0 * 1e-3 / FRAME  # a sample's noise, and that of its neighbours
    left = np.array([np.mean(np.delete(smooth[i * FRAME : (i + 1) * FRAME], places[places // FRAME == i] - i * FRAME)) for i in touched])
    assert np.max(np.abs(left - np.array([np.mean(smooth[i * FRAME : (i + 1) * FRAME]) for i in touched]))) > 2e-3, "this test could not fail"


@pytest.mark.parametrize(("gap", "used"), [(LONGEST_GAP, True), (LONGEST_GAP + 1, False)])
def test_a_long_gap_is_no_frame(gap: int, used: bool) -> None:
    values = curve(1e-3)
    values[50 * FRAME + 2 : 50 * FRAME + 2 + gap] = np.nan
    found = frames(values)
    assert found.use[0, 50] == used and found.use[0, :50].all() and found.use[0, 51:].all()


def test_a_gap_in_which_the_level_steps_is_no_frame() -> None:
    values = curve(1e-3)
    values[50 * FRAME + 6 :] += 1.0
    values[50 * FRAME + 5 : 50 * FRAME + 7] = np.nan
    assert np.flatnonzero(~frames(values).use[0]).tolist() == [50]


def test_nothing_lost_nothing_bridged() -> None:
    assert frames(curve(1e-3)).bridged is None
