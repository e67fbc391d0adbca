"""`simulate` from the command line to the recording, and back out of it."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from wineglass import cli, paths
from wineglass import device as devices
from wineglass.calibration_block import from_binary, from_json
from wineglass.recording import Recording

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")


def simulate(*arguments: object) -> int:
    return cli.main(["simulate", *map(str, arguments)])


def channels(path) -> dict[str, np.ndarray]:
    """Every stored code of a recording."""
    with Recording.open(path) as recording:
        taps = {**recording.taps, **{f"burst{i}": burst for i, burst in enumerate(recording.bursts)}}
        return {f"{name}.{channel}": tap.codes(channel) for name, tap in taps.items() for channel in tap.channels}


@pytest.fixture(scope="module")
def cold_start(tmp_path_factory):
    path = tmp_path_factory.mktemp("simulate") / "run.h5"
    assert simulate("cold-start", "-o", path, "--quiet") == 0
    return path


def test_recording_holds_every_tap_and_what_describes_it(cold_start):
    with Recording.open(cold_start) as recording:
        assert {*recording.taps} == {"baseband", "output", "reference"} and len(recording.bursts) == 1
        assert devices.loads(recording.device_toml) == devices.load("metal")
        assert from_json(recording.calibration_json) == from_binary(recording.calibration_block)
        assert recording.firmware_version.count(".") == 2 and "seed 1" in recording.source
        burst = recording.bursts[0]
        assert len(burst) == 500 and len(burst.state_snapshot) > 100
        assert burst.first_sample == pytest.approx(90_000, abs=100)
        scenario = next(event for event in recording.events if event.kind == "scenario")
        assert json.loads(scenario.value)["plant"]["override"] == {"resonator.frequency_hz": 5025}


def test_recorded_frequency_and_amplitude_are_the_shell_s(cold_start):
    with Recording.open(cold_start) as recording:
        baseband = recording.tap("baseband")
        end = slice(-100, None)
        resonance = 5025.0 + 0.5 * 0.02 * np.cos(np.radians(40))  # split
        assert baseband["drive_frequency"][end].mean() == pytest.approx(resonance, abs=0.003)
        assert baseband["primary_in_phase"][end] == pytest.approx(0.9, abs=1e-3)
        assert not baseband.lost.any()
        assert np.all(baseband.codes("status")[end] & 1)


def test_same_seed_same_recording_other_seed_another(cold_start, tmp_path):
    again, other = tmp_path / "again.h5", tmp_path / "other.h5"
    assert simulate("cold-start", "-o", again, "--quiet") == simulate("cold-start", "-o", other, "--seed", 2, "--quiet") == 0
    first, second, third = channels(cold_start), channels(again), channels(other)
    assert first.keys() == second.keys() and all(np.array_equal(first[name], second[name]) for name in first)
    assert not np.array_equal(first["baseband.primary_in_phase"], third["baseband.primary_in_phase"])


def test_json_result(tmp_path, capsys):
    assert simulate("cold-start", "-o", tmp_path / "run.h5", "--duration", 1.9, "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert result["simulated_s"] == pytest.approx(1.9) and result["locked_at_end"] is True and result["warnings"] == []


def test_settings_reach_scenario_and_device(tmp_path):
    path = tmp_path / "run.h5"
    settings = ["--set", "recording.bursts=[]", "--set", "recording.output_hz=20", "--set", "rate.value_deg_s=2.5",
                "--set", "resonator.q=9000", "--device", "paper", "--duration", "1"]
    assert simulate("cold-start", "-o", path, "--quiet", *settings) == 0
    with Recording.open(path) as recording:
        assert recording.bursts == [] and recording.tap("output").sample_rate_hz == 20
        assert devices.loads(recording.device_toml).resonator.q == 9000
        assert recording.tap("reference")["true_rate"] == pytest.approx(np.radians(2.5))


def test_output_and_reference_stand_on_one_time_base(tmp_path):
    """A shell ramp of 20 degC/s under an ideal thermometer: what the firmware says lies one slow tick at most behind the truth."""
    scenario = tmp_path / "ramp.toml"
    scenario.write_text(
        'device = "paper"\nduration_s = 2\n[temperature]\nkind = "ramps"\nacts_on = "shell"\nstart_degc = 5\n'
        "ramps = [{ to_degc = 45, duration_s = 2 }]\n[recording]\noutput_hz = 100\nreference_hz = 100\n")
    path = tmp_path / "run.h5"
    assert simulate(scenario, "-o", path, "--quiet") == 0
    with Recording.open(path) as recording:
        output, reference = recording.tap("output"), recording.tap("reference")
        truth = np.interp(output.time_s[5:], reference.time_s, reference["shell_temperature"])
        lag_s = (truth - output["temperature_measured"][5:]) / 20.0
    assert np.all(lag_s > -0.2e-3) and np.all(lag_s < 2.2e-3)
    assert np.ptp(lag_s) < 1e-4


@pytest.mark.parametrize(("arguments", "part"), [
    (["no-such-scenario"], "no-such-scenario"),
    (["cold-start", "--set", "rate.value_deg_s=fast"], "value_deg_s"),
    (["cold-start", "--set", "resonator.q=0"], "resonator.q"),
    (["cold-start", "--set", "calibration=missing.json"], "missing.json"),
    (["cold-start", "--device", "brass"], "brass"),
    (["cold-start", "--duration", "1"], "burst"),
    (["cold-start", "--set", "temperature.value_degc=190", "--set", "plant.override={'resonator.q_slope_per_degc'=-0.0099}"], "damping"),
])
def test_bad_input_is_one_line_and_leaves_nothing(arguments, part, tmp_path, capsys):
    assert simulate(*arguments, "-o", tmp_path / "run.h5") == 2
    error = capsys.readouterr().err
    assert part in error and error.count("\n") == 1, error
    assert list(tmp_path.iterdir()) == []


def test_output_file_is_asked_for(capsys):
    assert simulate("cold-start") == 2
    assert "-o REC.h5" in capsys.readouterr().err


def test_without_a_scenario_it_lists_them(capsys):
    assert simulate("--json") == 0
    assert "paper-fig5" in {item["name"] for item in json.loads(capsys.readouterr().out)}


def test_interrupted_run_leaves_a_valid_recording(tmp_path):
    path = tmp_path / "run.h5"
    command = [sys.executable, "-m", "wineglass", "simulate", "rate-steps", "--duration", "100000", "-o", str(path)]
    environment = {**os.environ, "PYTHONPATH": str(paths.repository_root() / "tools")}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    part = path.with_name("run.h5.part")
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not (part.exists() and part.stat().st_size > 20_000):
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130 and "interrupted" in error
    assert not part.exists()
    with Recording.open(path) as recording:
        assert len(recording.tap("output")) > 100
        assert [event.kind for event in recording.events][-1] == "interrupted"
        assert len(recording.tap("reference")) == pytest.approx(len(recording.tap("output")), abs=1)
