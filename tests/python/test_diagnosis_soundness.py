"""Bad recordings: one clear line, status 2, nothing written. Damaged ones: diagnosed on what is sound, and said."""

import json

import diagnosis_synthetic as synthetic
import h5py
import numpy as np
import pytest

from wineglass import calibration_block
from wineglass import device as devices
from wineglass.calibration.base import nominal_calibration
from wineglass.cli import main
from wineglass.diagnosis.contract import Diagnosis
from wineglass.recording import ChannelFormat, RecordingMeta, RecordingWriter, TapFormat, float_format

RATE_HZ = 50_000.0
N = 2400


def meta(**changes):
    device = devices.load("metal-fast")
    block = calibration_block.to_binary(nominal_calibration(device))
    known = dict(counter_rate_hz=RATE_HZ, device_toml=device.to_toml(), calibration_block=block, calibration_crc=int.from_bytes(block[-4:], "little"),
                 calibration_json=calibration_block.to_json(calibration_block.from_binary(block)), firmware_version="0.1.0", source="test")
    return RecordingMeta(**{**known, **changes})


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A recording of a silent metal-fast with a drifting bias: output, baseband and reference at 4 Hz."""
    path = tmp_path_factory.mktemp("good") / "good.h5"
    write(path, meta())
    return path


def write(path, described):
    time_s, degc = np.arange(N) / 4.0, 25.0 + 30.0 * np.sin(np.arange(N) / N * 4 * np.pi)
    rng = np.random.default_rng(5)
    bias = np.polynomial.polynomial.polyval(degc - 25.0, devices.load("metal-fast").resonator.cross_damping_rad_s)
    turning = 0.1 * (np.sin(time_s / 20.0) > 0)
    taps = {
        "output": {"temperature_measured": degc, "rate_uncompensated": bias + turning + 1e-3 * time_s / 600 + 1e-5 * rng.standard_normal(N)},
        "baseband": {"drive_frequency": 5000.0 * (1 + 5e-6 * (degc - 25)), "drive_level": np.full(N, 0.5)},
        "reference": {"true_rate": turning, "shell_temperature": degc},
    }
    with RecordingWriter(path, described) as writer:
        for tap, channels in taps.items():
            writer.add_tap(tap, TapFormat(4.0, {name: float_format() for name in channels}))
            writer.append(tap, channels, 0)
    return path


def refused(path, capsys, tmp_path, *flags):
    before = {p.name for p in tmp_path.iterdir()}
    status = main(["diagnose", str(path), "--json", str(tmp_path / "o.json"), "--report", str(tmp_path / "o.html"), *flags])
    err = capsys.readouterr().err.splitlines()
    assert status == 2 and len(err) == 1, err
    assert {p.name for p in tmp_path.iterdir()} == before
    return err[0]


def changed(good, tmp_path, change):
    path = tmp_path / "changed.h5"
    path.write_bytes(good.read_bytes())
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def put(tap, channel, factor=1.0, offset=0.0, unit=None):
    def change(file):
        data = file[f"{tap}/{channel}"]
        data[...] = data[...] * factor + offset
        if unit is not None:
            data.attrs["unit"] = unit
    return change


def test_the_good_one_is_diagnosed(good, tmp_path):
    assert main(["diagnose", str(good), "--device", "metal-fast", "--json", str(tmp_path / "o.json"), "-q"]) == 0
    found = Diagnosis(**json.loads((tmp_path / "o.json").read_text()))
    assert found.provenance.device == "metal-fast" and found.verdict in ("attributed", "ambiguous", "unknown")


def spoil(file, channel="output/rate_uncompensated"):
    file[channel][100] = np.nan


def drop(file):
    """Without baseband either: with it, the twin level needs no output."""
    del file["output"], file["baseband"]


def drop_rate(file):
    del file["output/rate_uncompensated"], file["baseband"]


def drop_temperature(file):
    del file["output/temperature_measured"], file["baseband"]


def clock_back(file):
    times = np.arange(N) / 4.0
    times[700:] -= 20.0
    data = file.create_dataset("output/time", data=times)
    data.attrs["unit"] = "s"


def event_back(file):
    rows = np.array([(500, "segment", "a"), (400, "segment", "b")], dtype=file["events"].dtype)
    del file["events"]
    file["events"] = rows


def uneven(file):
    data = file["output/rate_uncompensated"]
    data.resize((N - 7,))


@pytest.mark.parametrize("change, says", [
    (spoil, "rate_uncompensated is nan at sample 100"),
    (drop, "no tap output"),
    (drop_rate, "holds no rate"),
    (drop_temperature, "no temperature_measured"),
    (clock_back, "time does not rise at sample 700"),
    (event_back, "goes back"),
    (uneven, "differ in length"),
    (put("output", "rate_uncompensated", 180 / np.pi), "times the true rate"),
    (put("output", "rate_uncompensated", unit="degC"), "is no unit of rate"),
    (put("output", "rate_uncompensated", unit="furlong/s"), "is unknown"),
    (put("output", "temperature_measured", offset=273.15), "check its unit"),
    (put("reference", "shell_temperature", offset=273.15), "degC apart"),
    (put("baseband", "drive_frequency", 1e-3), "check the unit of drive_frequency"),
    (put("baseband", "drive_frequency", 1.05), "another device"),
    (put("baseband", "drive_level", 32768.0), "of full scale"),
])
def test_contradictions_are_refused(good, tmp_path, capsys, change, says):
    assert says in refused(changed(good, tmp_path, change), capsys, tmp_path)


def test_a_truncated_file_is_refused(good, tmp_path, capsys):
    for share in (0.2, 0.6, 0.95):
        cut = tmp_path / "cut.h5"
        cut.write_bytes(good.read_bytes()[: int(share * good.stat().st_size)])
        assert "truncated" in refused(cut, capsys, tmp_path)


def another_calibration():
    calibration = nominal_calibration(devices.load("metal-fast"))
    return calibration_block.to_binary(calibration.with_changes(bias_rad_s=[2e-3, *calibration.bias_rad_s[1:]]))


@pytest.mark.parametrize("changes, says", [
    (lambda: {"calibration_crc": 0x1234}, "ran with calibration 00001234"),
    (lambda: {"calibration_block": another_calibration(), "calibration_crc": None}, "differ in bias_rad_s"),
    (lambda: {"calibration_block": meta().calibration_block[:-1] + b"\x00"}, "CRC is wrong"),
    (lambda: {"calibration_block": meta().calibration_block[:100]}, "instead of"),
    (lambda: {"device_toml": devices.load("silica-fast").to_toml()}, "the calibration is of metal-fast, the recording of silica-fast"),
])
def test_a_calibration_that_was_not_in_force_is_refused(tmp_path, capsys, changes, says):
    assert says in refused(write(tmp_path / "r.h5", meta(**changes())), capsys, tmp_path)


@pytest.mark.parametrize("device, says", [("silica-fast", "a recording of metal-fast, not of silica-fast"), ("nothing", "no device 'nothing'")])
def test_a_recording_of_another_device_is_refused(good, tmp_path, capsys, device, says):
    assert says in refused(good, capsys, tmp_path, "--device", device)


def test_damaged_pieces_are_left_out_and_counted(good, tmp_path):
    """A bad sector inside a compressed chunk: the chunk's samples are lost, the others are diagnosed."""
    path = tmp_path / "damaged.h5"
    time_s = np.arange(3 * 4096) / 4.0
    rng = np.random.default_rng(6)
    degc = 25.0 + 30.0 * np.sin(np.arange(len(time_s)) / len(time_s) * 4 * np.pi)
    with RecordingWriter(path, RecordingMeta(counter_rate_hz=4.0, source="test")) as writer:
        writer.add_tap("output", TapFormat(4.0, {"temperature_measured": float_format(), "rate": ChannelFormat("i4", 1e-8)}))
        codes = np.round((2e-4 * (degc - 25) + 8e-3 * time_s / time_s[-1] + 1e-4 * rng.standard_normal(len(degc))) / 1e-8).astype(int)
        writer.append("output", {"temperature_measured": degc, "rate": codes}, 0)
    with h5py.File(path, "r") as file:
        place = file["output/rate"].id.get_chunk_info(1)
    data = bytearray(path.read_bytes())
    data[place.byte_offset + place.size // 2 : place.byte_offset + place.size // 2 + 64] = bytes(64)
    path.write_bytes(data)
    assert main(["diagnose", str(path), "--json", str(tmp_path / "o.json"), "-q"]) == 0
    found = json.loads((tmp_path / "o.json").read_text())
    assert any("4096 of 12288 samples of output cannot be read" in note for note in found["notes"])
    assert found["effects"][0]["id"] == "ageing"


def test_lost_samples_and_interruptions_are_said(tmp_path):
    evidence = synthetic.make([synthetic.drift(8e-3)], 15, synthetic.two_cycles)
    lost = np.zeros(len(evidence.time_s), bool)
    lost[1000:1300] = True
    with RecordingWriter(tmp_path / "r.h5", RecordingMeta(counter_rate_hz=1.0, source="test")) as writer:
        writer.add_tap("output", TapFormat(1.0, {name: float_format() for name in ("temperature_measured", "rate")}))
        writer.append("output", {"temperature_measured": evidence.temperature_degc, "rate": np.where(lost, 7.0, evidence.rate_rad_s)}, 0, lost=lost)
        writer.event("interrupted", "by the user", sample=len(lost))
    assert main(["diagnose", str(tmp_path / "r.h5"), "--json", str(tmp_path / "o.json"), "-q"]) == 0
    found = json.loads((tmp_path / "o.json").read_text())
    assert found["effects"][0]["id"] == "ageing"
    assert any("300 of 4800 samples of output are lost" in note for note in found["notes"])
    assert any("interrupted" in note for note in found["notes"])
