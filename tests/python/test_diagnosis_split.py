"""Held-out parts are whole: power-ups at pauses, branches at turns of the temperature, rate segments at steps of the rate; fit and held never overlap."""

from dataclasses import replace

import diagnosis_synthetic as synthetic
import numpy as np
import pytest

from wineglass.diagnosis import split
from wineglass.diagnosis.blocks import make_blocks

EDGE = 3  # blocks: a turn is found that closely


def blocks_of(evidence):
    blocks = make_blocks(evidence)
    assert blocks is not None
    return blocks


def parts_are_sound(blocks, parts):
    for part in parts:
        assert not np.any(part.fit & part.held) and part.held.any() and part.fit.any()
        seen = blocks.temperature_degc[part.fit]
        assert blocks.temperature_degc[part.held].max() < seen.max() + 0.05 * np.ptp(seen)


def test_two_cycles_hold_out_every_branch_once():
    blocks = blocks_of(synthetic.make([], 1, synthetic.two_cycles))
    parts = split.groups(blocks)
    parts_are_sound(blocks, parts)
    turns = [0.2, 0.55, 0.75, 0.83, 0.93, 1.0]  # as the profile is written
    n = len(blocks)
    starts = sorted(int(np.argmin(part.fit)) for part in parts)
    assert all(min(abs(s / n - t) for t in [0.0, *turns]) * n <= EDGE + 0.02 * n for s in starts)
    assert np.max(np.sum([part.held for part in parts], axis=0)) == 1
    assert split.joined(split.told(blocks)).held.mean() > 0.7


def test_one_cycle_holds_out_what_follows_the_maximum():
    blocks = blocks_of(synthetic.make([], 1))
    part, = split.told(blocks)
    assert part.name == "everything after the temperature maximum"
    assert abs(int(np.argmin(part.fit)) - int(np.argmax(blocks.temperature_degc))) == 0 and split.groups(blocks)[0].name == part.name


def test_a_pause_begins_a_power_up_and_power_ups_are_whole():
    whole = synthetic.make([], 1, synthetic.two_cycles)
    later = np.where(whole.time_s > 1600, 7200.0, 0.0) + np.where(whole.time_s > 3200, 7200.0, 0.0)
    blocks = blocks_of(replace(whole, time_s=whole.time_s + later))
    assert blocks.segment.max() == 2
    power_ups = [part for part in split.groups(blocks) if part.name == "a power-up"]
    assert len(power_ups) == 3
    for number, part in enumerate(power_ups):
        assert np.array_equal(~part.fit, blocks.segment == number)
    assert split.primary(blocks).name == "the last power-ups"
    assert len(np.unique(blocks.segment[~split.primary(blocks).fit])) * 3 <= 6


@pytest.mark.parametrize("period_s", [150, 400])
def test_at_one_temperature_whole_rate_segments(period_s):
    still = synthetic.make([], 1)
    turning = np.array([0.1, -0.1, 0.0])[(still.time_s // period_s).astype(int) % 3]
    flat = replace(still, temperature_degc=25.0 + 0.01 * np.random.default_rng(2).standard_normal(len(turning)), true_rate_rad_s=turning,
                   rate_rad_s=turning + 1e-4 * np.random.default_rng(3).standard_normal(len(turning)))
    blocks = blocks_of(flat)
    parts = [part for part in split.groups(blocks)]
    rate = np.array([turning[np.argmin(np.abs(still.time_s - t))] for t in blocks.time_s])
    for part in parts:
        edges = np.flatnonzero(np.diff((~part.fit).astype(int))) + 1
        assert all(np.ptp(rate[max(0, e - 2):e + 2]) > 0.05 for e in edges), "a part begins where the rate steps"


def test_what_the_fit_never_saw_is_not_scored():
    rising = synthetic.make([], 1)
    half = slice(1300, 2600)
    cut = replace(rising, time_s=rising.time_s[half], temperature_degc=rising.temperature_degc[half], rate_rad_s=rising.rate_rad_s[half])
    part = split.primary(blocks_of(cut))
    assert part.name.startswith("the last third")
