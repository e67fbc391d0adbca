"""Bench protocols: the same file on every device, for twin, person and live device."""

import json
import threading
import tomllib

import numpy as np
import pytest

from both_twins import Case, both, rms
from wineglass import bench_script, cli, effects, protocols, scenario
from wineglass import device as devices
from wineglass.calibration.observations import observe
from wineglass.effects import Setting
from wineglass.envelope import Envelope
from wineglass.errors import BadInput
from wineglass.link import serve as link_serve
from wineglass.recording import Recording
from wineglass.simulation import simulate
from wineglass.wire import Status

NAMES = ["full", "operating", "table", "thermal"]
DEVICES = ["metal", "metal-bringup", "metal-fast", "paper", "paper-fast", "silica", "silica-fast"]
LOOPS = ["open", "rebalance"]
IDEAL = {"electronics.adc.bits": 32, "electronics.adc.snr_db": 0.0, "electronics.dac.bits": 32, "electronics.thermometer.noise_degc": 0.0,
         "electronics.thermometer.lsb_degc": 2.0**-16}
SHORT = """
description = "everything once, quickly"
[[segment]]
name = "start"
lasts = 1
bursts = [0.8]
[[segment]]
name = "turn"
lasts = 1
rate_steps = [0.5, 0]
[[segment]]
name = "amplitudes"
lasts = 1
amplitude = [0.7, 1]
[[segment]]
name = "ring_down"
lasts = 1
drive_off = 1
[[segment]]
name = "forces"
lasts = 1
temperature = 0.05
test_signal = [{ in_phase = 0.05 }, { quadrature = 0.05, tone = 3 }]
bursts = [0.2]
"""


@pytest.fixture
def short(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(SHORT)
    return path


def test_these_ship():
    assert protocols.names() == NAMES


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", NAMES)
def test_every_protocol_is_a_scenario_of_every_device(name, device, loop):
    made = protocols.scenario(name, device, loop, seed=7)
    run = scenario.prepare(made)
    assert (made.seed, made.mode.loop, run.device.name, made.name) == (7, loop, device, name)
    assert scenario.parse(tomllib.loads(made.to_toml()), "itself") == made
    segments = protocols.segments(made)
    assert segments[0].begin_s == 0 and segments[-1].end_s == made.duration_s
    assert all(before.end_s == after.begin_s for before, after in zip(segments, segments[1:]))
    assert len({segment.name for segment in segments}) == len(segments)


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("device", [name for name in DEVICES if name.endswith("-fast")])
def test_a_fast_device_is_done_in_ten_minutes(device, loop):
    assert 500 < protocols.scenario("full", device, loop).duration_s <= 600


def test_times_follow_the_thermal_time_constant():
    slow, fast = (protocols.segments("full", name) for name in ("metal", "metal-fast"))
    assert [segment.name for segment in slow] == [segment.name for segment in fast]
    assert np.allclose([segment.end_s for segment in slow], [20 * segment.end_s for segment in fast])
    described = devices.load("metal-fast").override({"thermal.shell_time_constant_s": 4.0})
    assert protocols.scenario("thermal", described).duration_s == pytest.approx(4 / 3 * protocols.scenario("thermal", "metal-fast").duration_s)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", NAMES)
def test_nothing_disturbs_a_burst(name, device):
    """While raw codes are sent, the device takes no command; one second is longer than any of the bursts and of their way out."""
    made = protocols.scenario(name, device)
    run = scenario.prepare(made)
    for burst in made.recording.bursts:
        assert burst.samples / run.device.electronics.sample_rate_hz <= 0.1
        assert not [command for command in made.command if -0.2 <= command.at_s - burst.time_s <= 1.0], burst


@pytest.mark.parametrize("name", NAMES)
def test_thermal_turning_points_and_rate_steps_are_apart(name):
    made = protocols.scenario(name, "metal-fast")
    knots = np.array(made.temperature.times_s)
    speed = np.diff(made.temperature.values_degc) / np.diff(knots)
    turns = knots[1:-1][np.abs(np.diff(speed)) > 1e-9]
    steps = [time for part in getattr(made.rate, "parts", []) if part.kind == "steps" for time in part.times_s]
    assert all(abs(turn - step) >= protocols.unit_s(devices.load("metal-fast")) for turn in turns for step in steps)


def test_full_goes_twice_through_the_same_temperatures_at_two_speeds():
    ramps = [part for part in protocols.placed(protocols.load("full"), devices.load("metal")) if part.from_degc != part.to_degc]
    spans = [(part.from_degc, part.to_degc) for part in ramps]
    assert len(ramps) == 6 and spans[:3] == spans[3:]
    for fast, slow in zip(ramps[:3], ramps[3:]):
        assert 2 <= fast.speed_degc_per_min / slow.speed_degc_per_min <= 3
    low, high = devices.load("metal").calibration_range_degc()
    assert min(map(min, spans)) - low >= 5 and high - max(map(max, spans)) >= 5  # a thermometer may be off by some degrees


def test_in_rebalance_the_secondary_is_let_go_at_two_temperatures():
    """Only then its own frequency and its pickoff's gain and phase show."""
    free = {}
    for loop in LOOPS:
        made = protocols.scenario("full", "metal-fast", loop)
        free[loop] = [(command.at_s, command.mode) for command in made.command if command.kind == "loop"]
    assert free["open"] == [] and [mode for _, mode in free["rebalance"]] == ["open", "rebalance"] * 2
    begins = [at_s for at_s, mode in free["rebalance"] if mode == "open"]
    assert abs(np.ptp(made.temperature.at(np.array(begins)))) > 30


def test_full_rests_at_zero_rate_early_in_the_middle_and_late():
    made = protocols.scenario("full", "metal-fast")
    rest = [segment for segment in made.segment if segment.what == "rest" and abs(made.temperature.at(segment.begin_s) - 25) < 0.1]
    assert {"start", "middle", "end"} <= {segment.name for segment in rest}


@pytest.mark.parametrize("device", DEVICES)
def test_the_chirp_passes_the_half_bandwidth_and_ends_at_rest(device):
    described = devices.load(device)
    parts = [part for part in protocols.placed(protocols.load("table"), described) if part.segment.rate_chirp]
    assert len(parts) == 2
    half_hz = described.resonator.frequency_hz / (2 * described.resonator.q)
    for part in parts:
        sweep = protocols.chirp(part, described, 1.0)
        assert sweep.start_hz < sweep.end_hz and sweep.end_hz >= 4 * half_hz
        cycles = 0.5 * (sweep.start_hz + sweep.end_hz) * sweep.duration_s
        assert cycles == pytest.approx(round(cycles)) and cycles >= 3
        assert abs(sweep.at(np.array([part.end_s - 1e-6]))[0]) < 1e-4


def noiseless(name, device, loop, **changes):
    run = scenario.prepare(protocols.scenario(name, device, loop))
    made = run.scenario.changed({"override": IDEAL, **changes})
    return scenario.prepare(made)


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("device", ["metal-fast", "silica-fast"])
def test_nothing_comes_to_its_limit(device, loop):
    """Rates stay in the loop's range, and the open secondary far from the converter's end."""
    run = noiseless("full", device, loop)
    with Envelope(run) as envelope:
        frames = envelope.run()
    settled = frames.end_s > protocols.segments(run.scenario)[2].begin_s  # the silica shell grows for half a minute
    off = np.zeros(len(settled), bool)  # with the drive off the forces have nothing to hold; closing the loop takes what force there is
    for command in run.scenario.command:
        if command.kind in ("drive", "loop"):
            off |= (frames.end_s > command.at_s) & (frames.end_s < command.at_s + max(2.0, protocols.decay_s(run.device)))
    kept = settled & ~off
    assert np.hypot(frames["secondary_in_phase"], frames["secondary_quadrature"])[kept].max() < 0.5
    limits = run.device.firmware
    assert np.abs(frames["rebalance_in_phase"])[kept].max() < 0.7 * limits.rebalance_in_phase_limit_fs
    assert np.abs(frames["rebalance_quadrature"])[kept].max() < 0.7 * limits.rebalance_quadrature_limit_fs
    largest = np.abs(run.scenario.rate.at(frames.end_s)).max()
    assert largest == pytest.approx(protocols.rate_range_rad_s(run.device, loop), rel=1e-6)


@pytest.mark.parametrize("loop", LOOPS)
def test_both_twins_go_through_full_alike(loop):
    """Every segment; what is left is half a per cent of what the segment does, the ends of the ring-downs apart."""
    run = noiseless("full", "metal-fast", loop)
    fast, slow = both(Case(run))
    time_s = 0.02 * np.arange(len(fast["rate"]))
    kept = time_s > 3.5
    for command in run.scenario.command:
        if command.kind in ("amplitude", "drive", "loop"):
            kept &= (time_s < command.at_s - 0.1) | (time_s > command.at_s + 2.0)
    for segment in protocols.segments(run.scenario):
        within = kept & (time_s >= segment.begin_s) & (time_s < segment.end_s)
        for channel, unit in (("rate", 5e-6), ("drive_level", 2e-5), ("drive_frequency", 2e-5)):
            assert rms((fast[channel] - slow[channel])[within]) <= 5e-3 * np.ptp(slow[channel][within]) + 2 * unit, (segment.name, channel)


@pytest.mark.parametrize("loop", LOOPS)
def test_full_on_the_twin_makes_a_small_recording_without_complaints(loop, tmp_path):
    run = scenario.prepare(protocols.scenario("full", "metal-fast", loop, seed=2))
    path = tmp_path / "full.h5"
    done = simulate(run, path)
    assert done.warnings == [] and done.locked_at_end
    assert path.stat().st_size < 15e6
    recording = Recording.open(path)
    assert {"baseband", "output", "reference"} <= set(recording.taps)
    assert len(recording.bursts) == len(run.scenario.recording.bursts) and all(burst.state_snapshot for burst in recording.bursts)
    assert all(burst.length == 2500 for burst in recording.bursts)
    events = [(event.kind, event.value, event.sample) for event in recording.events]
    for segment in protocols.segments(run.scenario):
        assert ("segment", segment.name, round(segment.begin_s * 50e3)) in events
    usable = observe(recording)
    for segment in protocols.segments(run.scenario):
        within = (usable.time_s > segment.begin_s + 0.1) & (usable.time_s < segment.end_s)
        forced = {"test_middle": 0.45, "free_middle": 0.06, "free_cold": 0.06, "ring_down_hot": 0.8}.get(segment.name, 1.0)  # forces, drive off, their echo
        assert usable.valid[within].mean() <= forced, segment.name
    assert usable.valid.mean() > 0.8
    said = [value for kind, value, _ in events if kind == "command"]
    assert said.count("drive on=False") == said.count("drive on=True") == 2
    assert any(value.startswith("amplitude set_point_fs=0.6") for value in said)


def test_a_ring_down_shows_the_shell_s_own_decay(tmp_path, short):
    """Amplitude against the Q that was put into the plant, with the drive off and the status saying so."""
    run = scenario.prepare(protocols.scenario(short, "metal-fast", **{"plant.override": {"resonator.q": 8000.0}, "recording.baseband_hz": 200.0}))
    simulate(run, tmp_path / "run.h5")
    tap = Recording.open(tmp_path / "run.h5").tap("baseband")
    amplitude = np.hypot(tap["primary_in_phase"], tap["primary_quadrature"])
    off = (tap.codes("status") & Status.DRIVE_OFF) != 0
    times = np.arange(tap.length) / tap.sample_rate_hz
    inside = off & np.roll(off, 5) & np.roll(off, -5)
    slope = np.polyfit(times[inside], np.log(amplitude[inside]), 1)[0]
    assert -slope == pytest.approx(np.pi * run.truth.resonator.frequency_hz / 8000.0, rel=2e-3)


def test_cut_keeps_the_beginning():
    made = protocols.cut(protocols.scenario("full", "metal-fast"), 100.0)
    run = scenario.prepare(made)
    assert run.scenario.duration_s == 100.0 and made.segment[-1].end_s == 100.0
    assert {command.kind for command in made.command} == {"amplitude", "drive"}


def test_changes_by_dotted_name():
    made = protocols.scenario("thermal", "metal-fast", **{"plant.override": {"resonator.split_hz": 0.03}, "recording.output_hz": 10.0})
    assert made.plant.override == {"resonator.split_hz": 0.03} and made.recording.output_hz == 10.0


@pytest.mark.parametrize(("change", "part"), [
    ("lasts = -1", "lasts"), ("lasts = 1\ntemperature = 2", "temperature"), ("lasts = 1\nrate_steps = [3]", "parts of the range"),
    ("lasts = 1\nrate_steps = [1]\nrate_chirp = 0.5", "exclude"), ("lasts = 1\namplitude = [2]", "set-point"), ("lasts = 1\nbursts = [1.5]", "bursts"),
    ("lasts = 1\nspin = 3", "spin"), ("length = 3", "lasts"),
])
def test_bad_protocols_are_one_line_and_status_2(change, part, tmp_path, capsys):
    path = tmp_path / "bad.toml"
    path.write_text(f'[[segment]]\nname = "x"\n{change}\n')
    script = tmp_path / "script.toml"
    assert cli.main(["protocol", str(path), "--script", str(script)]) == 2
    error = capsys.readouterr().err
    assert part in error and error.count("\n") == 1 and not script.exists(), error


@pytest.mark.parametrize("words", [
    ["protocol", "none-such"], ["protocol", "full", "--device", "brass"], ["protocol", "full", "--start", "25:00"],
    ["simulate", "cold-start", "--protocol", "full", "-o", "x.h5"], ["simulate", "cold-start", "--loop", "open", "-o", "x.h5"],
    ["simulate", "--protocol", "none-such", "-o", "x.h5"], ["simulate", "--protocol", "full", "--effect", "magic", "-o", "x.h5"],
    ["simulate", "--protocol", "full", "--effect", "frequency_split:split_hz=wide", "-o", "x.h5"],
    ["simulate", "--protocol", "full", "--effect", "frequency_split:width=1", "-o", "x.h5"],
])
def test_bad_words_are_one_line_and_status_2(words, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(words) == 2
    assert capsys.readouterr().err.count("\n") == 1 and list(tmp_path.iterdir()) == []


def test_effects_from_words():
    typical = {p.name: p.typical for p in effects.find("frequency_split").parameters if p.strength}
    assert effects.parse("frequency_split") == Setting("frequency_split", typical)
    assert effects.parse("frequency_split:x3") == Setting("frequency_split", {name: 3 * value for name, value in typical.items()})
    assert effects.parse("frequency_split:split_hz=0.05") == Setting("frequency_split", {"split_hz": 0.05})
    for effect in effects.catalogue():
        setting = effects.typical(effect.id)
        again = effects.parse(str(setting))
        assert again.id == effect.id and again.values == pytest.approx(setting.values, rel=1e-5)


def test_the_printed_day_and_its_json(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "220")
    assert cli.main(["protocol", "full", "--device", "metal", "--start", "8:30", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["duration_s"] == pytest.approx(12000.0) and said["unit_s"] == 60.0
    assert [segment["name"] for segment in said["segments"]][:2] == ["start", "rate_middle"]
    assert cli.main(["protocol", "full", "--device", "metal", "--start", "8:30"]) == 0
    text = capsys.readouterr().out
    assert "11:50:00" in text and "drive off for 1.27 s" in text and "25.0 to 76.0" in text


@pytest.mark.parametrize("device", ["metal-fast", "metal"])
def test_the_profile_is_what_the_twin_does(device, tmp_path):
    """Lines between its rows, against the scenario's own course at other times."""
    path = tmp_path / "day.csv"
    assert cli.main(["-q", "protocol", "full", "--device", device, "--profile", str(path)]) == 0
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    made = protocols.scenario("full", device)
    assert rows[0, 0] == 0 and rows[-1, 0] == made.duration_s and np.all(np.diff(rows[:, 0]) > 0)
    times = np.random.default_rng(1).uniform(0, made.duration_s, 20000)
    assert np.abs(np.interp(times, rows[:, 0], rows[:, 1]) - made.temperature.at(times)).max() < 1e-3
    assert np.abs(np.interp(times, rows[:, 0], rows[:, 2]) - np.degrees(made.rate.at(times))).max() < 0.03
    assert path.read_text().startswith("time[s],chamber_temperature[degC],true_rate[deg/s]\n")


def test_a_description_of_one_s_own(tmp_path, monkeypatch):
    """Script and scenario name it so that they work from any folder."""
    (tmp_path / "here").mkdir()
    (tmp_path / "there").mkdir()
    (tmp_path / "here/unit7.toml").write_text('extends = "metal-fast"\nname = "unit7"\n[thermal]\nshell_time_constant_s = 1\n')
    monkeypatch.chdir(tmp_path / "here")
    assert cli.main(["-q", "protocol", "thermal", "--device", "unit7.toml", "--script", "../there/s.toml", "--scenario", "../there/t.toml"]) == 0
    monkeypatch.chdir(tmp_path)
    assert devices.load(bench_script.load(tmp_path / "there/s.toml").device).name == "unit7"
    run = scenario.prepare(scenario.load(tmp_path / "there/t.toml"))
    assert run.device.name == "unit7" and run.scenario.duration_s == pytest.approx(protocols.load("thermal").units)


def test_script_and_scenario_files_read_back(tmp_path):
    script, made = tmp_path / "script.toml", tmp_path / "scenario.toml"
    assert cli.main(["-q", "protocol", "full", "--device", "metal-fast", "--loop", "rebalance", "--script", str(script), "--scenario", str(made)]) == 0
    expected = protocols.scenario("full", "metal-fast", "rebalance")
    assert scenario.load(made) == expected
    found = bench_script.load(script)
    assert found == bench_script.of(scenario.prepare(expected))
    assert [command for command in found.command if command.at_s > 0] == expected.command
    assert {command.kind for command in found.command if command.at_s == 0} == {"loop", "compensation", "output_filter"}
    script.write_text(script.read_text().replace("duration_s = 600.0", "duration_s = 100.0"))
    with pytest.raises(BadInput, match="comes after the end"):
        bench_script.load(script)


def test_record_plays_the_script_on_a_live_device(tmp_path, short):
    """The served twin turns and warms by itself; what the device is asked for comes over the wire, each at its time."""
    run = scenario.prepare(protocols.scenario(short, "metal-fast"))
    script, path, socket = tmp_path / "script.toml", tmp_path / "live.h5", tmp_path / "gyro.sock"
    assert cli.main(["-q", "protocol", str(short), "--device", "metal-fast", "--script", str(script)]) == 0
    with link_serve.listen_unix(socket) as listener:
        served = scenario.prepare(run.scenario.changed({"duration_s": 20.0, "command": [], "recording.bursts": []}))
        thread = threading.Thread(target=link_serve.serve, args=(served, listener, 8.0), daemon=True)
        thread.start()
        assert cli.main(["-q", "record", "--port", str(socket), "--script", str(script), "-o", str(path)]) == 0
        thread.join(60.0)
    recording = Recording.open(path)
    begin = next(event.sample for event in recording.events if event.kind == "segment" and event.value == "start")
    for segment in protocols.segments(run.scenario):
        assert ("segment", segment.name, begin + round(segment.begin_s * 50e3)) in [(e.kind, e.value, e.sample) for e in recording.events]
    played = {event.value: (event.sample - begin) / 50e3 for event in recording.events if event.kind == "command"}
    for command in run.scenario.command:
        assert command.note() in played
        assert -0.05 <= played[command.note()] - command.at_s, command
    assert list(played) == [command.note() for command in bench_script.load(script).items() if hasattr(command, "note")]
    assert [burst.length for burst in recording.bursts] == [2500, 2500]
    assert recording.device_toml == devices.load("metal-fast").to_toml()
    tap = recording.tap("baseband")
    status = tap.codes("status")
    assert np.any(status & Status.DRIVE_OFF) and np.any(status & Status.TEST_ACTIVE)
    assert {0.63, 0.9} <= set(tap["amplitude_set_point"].round(3).tolist())


def test_a_script_for_another_sampling_rate_is_refused(tmp_path, short, capsys):
    script, socket = tmp_path / "script.toml", tmp_path / "gyro.sock"
    assert cli.main(["-q", "protocol", str(short), "--device", "metal-fast", "--script", str(script)]) == 0
    other = tmp_path / "other.toml"
    other.write_text('extends = "metal-fast"\nname = "other"\n[electronics]\nsample_rate_hz = 60000\n')
    with link_serve.listen_unix(socket) as listener:
        served = scenario.prepare(scenario.load("cold-start").changed({"duration_s": 2.0}))
        thread = threading.Thread(target=link_serve.serve, args=(served, listener, 1.0), daemon=True)
        thread.start()
        assert cli.main(["-q", "record", "--port", str(socket), "--script", str(script), "--device", str(other), "-o", str(tmp_path / "x.h5")]) == 2
        thread.join(30.0)
    assert "samples at" in capsys.readouterr().err and not (tmp_path / "x.h5").exists()


def played(tmp_path, items, duration_s=4.0):
    """A script of these lines, recorded from a served device at rest; the recording and its warnings."""
    script, path, socket = tmp_path / "script.toml", tmp_path / "live.h5", tmp_path / "gyro.sock"
    script.write_text(f'device = "metal-fast"\nduration_s = {duration_s}\n{items}\n')
    run = scenario.prepare(scenario.Scenario(device="metal-fast", duration_s=duration_s + 2.0))
    with link_serve.listen_unix(socket) as listener:
        thread = threading.Thread(target=link_serve.serve, args=(run, listener, 4.0), daemon=True)
        thread.start()
        assert cli.main(["-q", "record", "--port", str(socket), "--script", str(script), "-o", str(path)]) == 0
        thread.join(60.0)
    return Recording.open(path)


def test_the_drive_is_switched_by_hand(tmp_path, capsys):
    socket = tmp_path / "gyro.sock"
    run = scenario.prepare(scenario.Scenario(device="metal-fast", duration_s=10.0))
    with link_serve.listen_unix(socket) as listener:
        thread = threading.Thread(target=link_serve.serve, args=(run, listener, 4.0), daemon=True)
        thread.start()
        for state, expected in (("off", True), ("on", False)):
            assert cli.main(["-q", "device", "--port", str(socket), "--drive", state]) == 0
            assert cli.main(["device", "--port", str(socket), "--json"]) == 0
            assert ("drive off" in json.loads(capsys.readouterr().out)["status"]["bits"]) == expected
        thread.join(60.0)


def test_a_busy_device_is_asked_again(tmp_path):
    """A burst of 0.6 s, and a command in the middle of it: it is taken when the burst is over."""
    recording = played(tmp_path, 'burst = [{ time_s = 1.5, samples = 30000 }]\ncommand = [{ at_s = 1.7, kind = "amplitude", set_point_fs = 0.8 }]')
    burst, = recording.bursts
    assert burst.length == 30000
    taken, = [event.sample for event in recording.events if event.kind == "command"]
    assert taken >= burst.first_sample + burst.length
    assert not [event for event in recording.events if event.kind == "refused"]


def test_a_refusal_is_said_and_noted(tmp_path, capsys):
    items = 'command = [{ at_s = 1, kind = "rebalance", kp = 900.0, ki_per_s = 1e4 }, { at_s = 2, kind = "amplitude", set_point_fs = 0.8 }]'
    recording = played(tmp_path, items)
    assert "refused 'rebalance" in capsys.readouterr().err
    assert [event.kind for event in recording.events if event.kind in ("refused", "command")] == ["refused", "command"]


@pytest.mark.parametrize(("text", "part"), [
    ("duration_s = 5", "device"), ('device = "metal"\nduration_s = 5\ncommand = [{ at_s = 6, kind = "loop", mode = "open" }]', "after the end"),
    ('device = "metal"\nduration_s = 5\ncommand = [{ at_s = 1, kind = "dance" }]', "dance"), ("device = ", "not valid TOML"),
])
def test_bad_scripts_are_one_line_and_status_2(text, part, tmp_path, capsys):
    script = tmp_path / "script.toml"
    script.write_text(text)
    assert cli.main(["record", "--port", "nowhere", "--script", str(script), "-o", str(tmp_path / "x.h5")]) == 2
    error = capsys.readouterr().err
    assert part in error and error.count("\n") == 1, error


SIGMA = {"rate": 2e-5, "quadrature": 2e-5, "drive_frequency": 5e-4, "drive_level": 3e-5, "secondary_in_phase": 3e-6, "secondary_quadrature": 3e-6,
         "primary_in_phase": 3e-6, "rebalance_in_phase": 3e-5, "rebalance_quadrature": 3e-5, "temperature_measured": 4e-3}
"""Noise of a frame on `metal`, rounded: weighs the channels, nothing more."""


def response(name, loop, effect, parameter):
    """What a fifth of the typical size does to all channels in units of their noise, one vector of length one."""
    run = scenario.prepare(protocols.scenario(name, "metal-fast", loop))
    size = next(item.typical for item in effects.find(effect).parameters if item.name == parameter)
    with Envelope(run) as nominal, Envelope(run, effects=[Setting(effect, {parameter: 0.2 * size})]) as changed:
        before, after = nominal.run(), changed.run()
    kept = before.end_s > 4.0
    vector = np.concatenate([((after[channel] - before[channel]) / sigma)[kept] for channel, sigma in SIGMA.items()])
    return vector / np.linalg.norm(vector)


@pytest.mark.parametrize(("loop", "one", "other", "thermal", "full"), [
    ("open", ("drive_phase", "delay_s"), ("pickoff_phase", "delay_s"), 0.99, 0.92),
    ("open", ("amplitude_frequency", "frequency_ppm"), ("clock_error", "error_ppm"), 0.99999, 0.995),
    ("open", ("damping_temperature", "slope_per_degc"), ("actuator_gain", "slope_per_degc"), 0.85, 0.7),
    ("rebalance", ("frequency_split", "split_hz"), ("cross_stiffness", "c0_rad_s"), 0.9999, 0.996),
])
def test_full_tells_apart_what_thermal_does_not(loop, one, other, thermal, full):
    """Cosine between the responses of two effects: at least so large in `thermal`, at most so large in `full`."""
    likeness = {name: abs(float(response(name, loop, *one) @ response(name, loop, *other))) for name in ("thermal", "full")}
    print(likeness)
    assert likeness["thermal"] >= thermal and likeness["full"] <= full


@pytest.mark.parametrize("loop", LOOPS)
def test_true_twins_stay_twins(loop):
    """A gyro of another gain and a table of another gain: no protocol of a table can tell, and a diagnosis that does is wrong."""
    gain, table = response("full", loop, "coriolis_gain", "gain"), response("full", loop, "rate_reference", "scale")
    assert abs(float(gain @ table)) > 0.99999
