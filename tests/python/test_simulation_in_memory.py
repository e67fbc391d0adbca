"""A simulation that writes no file: it must show the slow channels that the file would have shown, bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wineglass import effects, protocols, scenario
from wineglass.diagnosis import channels
from wineglass.effects import Setting
from wineglass.recording import Recording
from wineglass.recording.memory import MemoryRecording
from wineglass.recording.model import ChannelFormat, TapFormat
from wineglass.scenario import Run
from wineglass.simulation import in_memory, simulate

DURATION_S = 100.0
CASES: dict[str, list[Setting]] = {"open": [], "rebalance": [effects.typical("cross_damping"), effects.typical("dropped_samples", 3.0)]}


def run_in(loop: str) -> Run:
    """The beginning of a protocol: lock, commands, raw bursts."""
    whole = protocols.scenario("full", device="metal-fast", loop=loop, seed=11)
    commands = [command for command in whole.command if command.at_s < DURATION_S]
    bursts = [burst for burst in whole.recording.bursts if burst.time_s < DURATION_S]
    recording = whole.recording.model_copy(update={"bursts": bursts})
    return scenario.prepare(whole.model_copy(update={"duration_s": DURATION_S, "command": commands, "recording": recording}))


@pytest.mark.parametrize("loop", CASES)
def test_same_as_the_file(loop: str, tmp_path: Path) -> None:
    run = run_in(loop)
    assert run.scenario.command and run.scenario.recording.bursts
    held = in_memory(run, effects=CASES[loop])
    simulate(run, tmp_path / "run.h5", effects=CASES[loop])
    with Recording.open(tmp_path / "run.h5") as recording:
        assert set(held) == {"baseband", "output"}
        for name in held:
            written, kept = recording.tap(name), held.tap(name)
            assert written.length == kept.length > 1000
            assert np.array_equal(written.time_s, kept.time_s) and np.array_equal(written.valid, kept.valid)
            for channel in written.channels:
                assert np.array_equal(written[channel], kept[channel], equal_nan=True), channel
                assert np.array_equal(written.codes(channel)[written.valid], kept.codes(channel)[kept.valid]), channel
        grid = channels.grid_of(recording)
        assert channels.grid_of(held) == grid
        from_file, from_memory = channels.read(recording, grid), channels.read(held, grid)
    assert from_file.names == from_memory.names
    assert np.array_equal(from_file.values, from_memory.values) and np.array_equal(from_file.use, from_memory.use)
    assert from_memory.use.any()


def test_what_is_missing_is_lost() -> None:
    held = MemoryRecording(50_000.0)
    held.add_tap("output", TapFormat(100.0, {"rate": ChannelFormat("i4", 0.5)}))
    held.append("output", {"rate": np.array([2, 4], np.int32)}, 1000)
    held.append("output", {"rate": np.array([6], np.int32)}, 1000 + 4 * 500)
    tap = held.tap("output")
    assert np.array_equal(tap["rate"], [1.0, 2.0, np.nan, np.nan, 3.0], equal_nan=True)
    assert tap.valid.tolist() == [True, True, False, False, True]
    assert tap.time_s.tolist() == pytest.approx([0.02, 0.03, 0.04, 0.05, 0.06])
    assert "baseband" not in held and "rate" in tap and "angle" not in tap
