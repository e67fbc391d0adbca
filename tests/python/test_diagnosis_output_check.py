"""The recorded rate against what the calibration makes of the recorded baseband: silent on sound recordings, and a changed output is measured."""

import shutil

import h5py
import pytest

from wineglass import scenario
from wineglass.diagnosis import output_check
from wineglass.effects import Setting
from wineglass.recording import Recording
from wineglass.simulation import simulate

MODES = [("open", "none"), ("open", "static"), ("open", "g2"), ("rebalance", "static")]


def make(path, loop="open", compensation="g2", effects=(), **changes):
    run = scenario.prepare(scenario.parse({
        "device": "metal-fast", "duration_s": 60.0, "seed": 12, "mode": {"loop": loop, "compensation": compensation},
        "temperature": {"kind": "sine", "mean_degc": 30, "amplitude_degc": 25, "period_s": 60},
        "rate": {"kind": "steps", "times_s": [10, 20, 30, 40], "values_deg_s": [5, 0, -3, 0], "edge_s": 0.1},
        "recording": {"baseband_hz": 50.0, "output_hz": 50.0, "reference_hz": 0.0}, **changes}, "test"))
    simulate(run, path, effects=effects)
    return path


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("output")
    return {mode: make(folder / f"{'_'.join(mode)}.h5", *mode) for mode in MODES}


def checked(path):
    with Recording.open(path) as recording:
        return output_check.check(recording)


def errors(found):
    return {item.name: item for item in found.deviations}


@pytest.mark.parametrize("mode", MODES)
def test_sound_output_is_silent(sound, mode):
    found = checked(sound[mode])
    assert found.log_evidence < -3 and found.pieces > 20
    assert all(abs(item.error) < 3 * item.sigma for item in found.deviations)
    assert ("bias" in errors(found)) == (mode[1] != "none")


@pytest.mark.parametrize("mode", MODES[1:])
@pytest.mark.parametrize(("scale", "bias"), [(0.002, 0.0), (-0.01, 0.0), (0.0, 0.03)])
def test_another_block_in_the_device_is_measured(tmp_path, mode, scale, bias):
    found = errors(checked(make(tmp_path / "x.h5", *mode, effects=[Setting("firmware_mismatch", {"scale": scale, "bias": bias})])))
    assert abs(found["scale"].error - scale) < 3 * found["scale"].sigma
    assert abs(found["bias"].error - bias) < 4 * found["bias"].sigma
    assert max(item.log_evidence for item in found.values()) > 20


def test_noise_of_the_forces_is_no_scale_error(tmp_path):
    """At rest nothing but noise moves both sides, and not alike: the output is filtered. The scale then cannot be told."""
    found = checked(make(tmp_path / "x.h5", "rebalance", "static", rate={"kind": "constant", "value_deg_s": 0.0}))
    assert found.log_evidence < -2
    assert abs(errors(found)["scale"].error) < 3 * errors(found)["scale"].sigma


def test_another_loop_by_command_is_left_out(tmp_path):
    found = checked(make(tmp_path / "x.h5", "rebalance", "static", command=[
        {"kind": "loop", "at_s": 22.0, "mode": "open"}, {"kind": "loop", "at_s": 28.0, "mode": "rebalance"},
        {"kind": "loop", "at_s": 52.0, "mode": "open"}]))
    assert found.log_evidence < -3 and 10 < found.pieces < 45


def test_an_output_multiplied_afterwards_is_found_in_its_scale(sound, tmp_path):
    copy = tmp_path / "copy.h5"
    shutil.copy(sound["rebalance", "static"], copy)
    with h5py.File(copy, "r+") as file:
        for channel in ("rate", "rate_uncompensated"):
            file["output"][channel].attrs["scale"] *= 0.997
    found = checked(copy)
    assert errors(found)["scale"].error == pytest.approx(-0.003, abs=1e-4) and found.log_evidence > 50


@pytest.mark.parametrize(("remove", "says"), [("baseband", "no tap baseband"), ("calibration_block", "no calibration"),
                                             ("baseband/primary_quadrature", "primary_quadrature is missing"), ("output/rate", "rate")])
def test_what_is_missing_is_said(sound, tmp_path, remove, says):
    copy = tmp_path / "copy.h5"
    shutil.copy(sound["open", "g2"], copy)
    with h5py.File(copy, "r+") as file:
        del file[remove]
        if remove == "calibration_block" and "calibration_json" in file:
            del file["calibration_json"]
    found = checked(copy)
    assert any(says in note for note in found.not_checked) and found.log_evidence <= 0
