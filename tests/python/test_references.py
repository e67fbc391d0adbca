"""The bench's own rate and temperature, put beside what a device sent."""

import numpy as np
import pytest

from wineglass import cli, protocols, scenario
from wineglass.recording import Recording, RecordingMeta, RecordingWriter, TapFormat, float_format
from wineglass.simulation import simulate

SHORT = """
[[segment]]
name = "turns"
lasts = 2
temperature = 0.1
rate_steps = [0, 0.5, -0.5, 0]
[[segment]]
name = "end"
lasts = 1
rate_chirp = 0.3
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A simulated recording with its reference, the same without, and the plan."""
    folder = tmp_path_factory.mktemp("references")
    (folder / "short.toml").write_text(SHORT)
    run = scenario.prepare(protocols.scenario(folder / "short.toml", "metal-fast"))
    (folder / "plan.toml").write_text(run.scenario.to_toml())
    simulate(run, folder / "with.h5")
    bare = scenario.prepare(run.scenario.changed({"recording.reference_hz": 0.0}))
    simulate(bare, folder / "bare.h5")
    return folder


def taps(path):
    with Recording.open(path) as recording:
        tap = recording.tap("reference")
        return {name: np.array(tap[name]) for name in tap.channels}, np.array(tap.time_s), np.array(tap.lost), list(recording.events)


def test_the_plan_is_what_the_simulation_did(made, tmp_path):
    """The simulation's own reference is a mean over blocks of the same interval: another computation."""
    assert cli.main(["-q", "reference", str(made / "bare.h5"), "--plan", str(made / "plan.toml"), "-o", str(tmp_path / "x.h5")]) == 0
    found, times, lost, events = taps(tmp_path / "x.h5")
    true, true_times, _, _ = taps(made / "with.h5")
    shifted = {name: np.interp(times, true_times, true[name]) for name in found}
    kept = ~lost.astype(bool) & (times > 0.1) & (times < true_times[-1])
    steep = np.abs(np.gradient(shifted["true_rate"])) > 0.02  # edges of steps, between which both only interpolate
    assert np.abs(found["true_rate"] - shifted["true_rate"])[kept & ~steep].max() < 5e-3
    assert np.abs(found["chamber_temperature"] - shifted["chamber_temperature"])[kept].max() < 1e-2
    assert ("reference", "as planned: short") in [(event.kind, event.value) for event in events]


def test_a_log_is_taken_by_its_times_and_units(made, tmp_path):
    log = tmp_path / "table.csv"
    times = np.arange(-100, 1200) * 0.01
    log.write_text("clock[ms],table[deg/s]\n" + "".join(f"{1e3 * t + 2500:.3f},{np.degrees(0.1 * np.sin(2 * t)):.9f}\n" for t in times))
    words = ["--log", str(log), "--column", "time=clock", "--column", "true_rate=table", "--offset", "-2.5", "-o", str(tmp_path / "x.h5")]
    assert cli.main(["-q", "reference", str(made / "bare.h5"), *words]) == 0
    found, middles, lost, _ = taps(tmp_path / "x.h5")
    with Recording.open(made / "bare.h5") as recording:
        tap = recording.tap("output")
        start_s = tap.time_s[0] - 0.5 / tap.sample_rate_hz
        assert np.array_equal(tap.time_s, middles) and not lost.any()
    assert np.abs(found["true_rate"] - 0.1 * np.sin(2 * (middles - start_s))).max() < 1e-4
    assert set(found) == {"true_rate"}


def test_frames_outside_the_log_are_lost(made, tmp_path):
    log = tmp_path / "chamber.csv"
    log.write_text("time[s],chamber_temperature[degC]\n1,20\n3,30\n")
    assert cli.main(["-q", "reference", str(made / "bare.h5"), "--log", str(log), "-o", str(tmp_path / "x.h5")]) == 0
    found, times, lost, _ = taps(tmp_path / "x.h5")
    assert 0 < (~lost.astype(bool)).sum() <= 100
    assert np.isnan(found["chamber_temperature"][lost.astype(bool)]).all()
    inside = found["chamber_temperature"][~lost.astype(bool)]
    assert np.allclose(np.diff(inside), 0.1, atol=1e-6) and 20 < inside[0] < inside[-1] < 30


def test_everything_else_stays(made, tmp_path):
    assert cli.main(["-q", "reference", str(made / "bare.h5"), "--plan", str(made / "plan.toml"), "-o", str(tmp_path / "x.h5")]) == 0
    with Recording.open(made / "bare.h5") as before, Recording.open(tmp_path / "x.h5") as after:
        assert [name for name in after.taps if name != "reference"] == list(before.taps)
        for name, tap in before.taps.items():
            assert all(np.array_equal(tap[channel], after.tap(name)[channel]) for channel in tap.channels)
        assert [event for event in after.events if event.kind != "reference"] == before.events


def without_frames(path):
    with RecordingWriter(path, RecordingMeta(counter_rate_hz=50e3)) as writer:
        writer.add_tap("raw", TapFormat(50e3, {"primary_adc_raw": float_format()}))
        writer.append("raw", {"primary_adc_raw": np.zeros(10)}, 0)


@pytest.mark.parametrize(("recording", "log", "words", "part"), [
    ("with.h5", None, [], "already"),
    ("raw.h5", None, [], "neither baseband nor output"),
    ("bare.h5", None, ["--offset", "1e5"], "no time in common"),
    ("bare.h5", None, ["--unit", "a=s"], "plan knows"),
    ("bare.h5", "time[s],speed[rad/s]\n0,1\n1,1\n", [], "column"),
    ("bare.h5", "time[s],true_rate\n0,1\n1,1\n", [], "unit"),
    ("bare.h5", "time[s],rate[rad/s]\n0,1\n1,1\n", [], "no column is a reference"),
    ("missing.h5", None, [], "no such file"),
])
def test_bad_input_is_one_line_and_leaves_nothing(made, tmp_path, capsys, recording, log, words, part):
    if recording == "raw.h5":
        without_frames(made / "raw.h5")
    source = ["--plan", str(made / "plan.toml")]
    if log is not None:
        (tmp_path / "log.csv").write_text(log)
        source = ["--log", str(tmp_path / "log.csv")]
    assert cli.main(["reference", str(made / recording), *source, *words, "-o", str(tmp_path / "x.h5")]) == 2
    error = capsys.readouterr().err
    assert part in error and error.count("\n") == 1, error
    assert [path.name for path in tmp_path.iterdir() if path.name != "log.csv"] == []
