"""./wineglass diagnose: files written whole or not at all, bad input in one line, the report a page of its own, the chamber's known answers."""

import json
import os
import re
from pathlib import Path

import diagnosis_synthetic as synthetic
import numpy as np
import pytest

from wineglass.cli import main
from wineglass.diagnosis.contract import Diagnosis
from wineglass.paths import repository_root
from wineglass.recording import RecordingMeta, RecordingWriter, TapFormat, float_format

CHAMBER = Path(os.environ.get("WINEGLASS_CHAMBER_CSV", repository_root() / "../shared/data/imu_chamber/static_sweep.csv"))


def table(path, evidence):
    rows = np.column_stack([evidence.time_s, evidence.temperature_degc, evidence.rate_rad_s])[::2]
    np.savetxt(path, rows, delimiter=",", header="time[s],temperature[degC],rate[rad/s]", comments="", fmt="%.9g")
    return path


@pytest.fixture(scope="module")
def drifting(tmp_path_factory):
    """A run of the command on a table with drift over two cycles, with all its outputs."""
    folder = tmp_path_factory.mktemp("drift")
    source = table(folder / "drift.csv", synthetic.make([synthetic.drift(8e-3)], 11, synthetic.two_cycles))
    assert main(["diagnose", str(source), "--json", str(folder / "d.json"), "--report", str(folder / "d.html")]) == 0
    return folder


def test_json_and_report_are_written(drifting):
    diagnosis = Diagnosis(**json.loads((drifting / "d.json").read_text()))
    assert diagnosis.verdict == "attributed" and [e.id for e in diagnosis.effects] == ["ageing"]
    assert diagnosis.where[0].stage == "coupling" and diagnosis.shrink.all.fraction > 0.6
    assert len(diagnosis.provenance.sha256) == 64
    assert "no calibration is known" in " ".join(diagnosis.notes)


def test_the_report_needs_nothing_else(drifting):
    page = (drifting / "d.html").read_text()
    assert page.count("<svg") >= 3 and "The gap over time" in page and len(page) < 1_000_000
    assert not re.findall(r"(?:src|href)\s*=\s*[\"'](?!#|data:)[^\"']+", page), "something is fetched"
    assert not re.search(r"@import|url\((?!#)|<script", page)
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))


def test_the_terminal_says_it_in_a_dozen_lines(drifting, capsys):
    assert main(["diagnose", str(drifting / "drift.csv")]) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[0] == "verdict: attributed" and 4 <= len(out) <= 14


def test_global_json_goes_to_the_terminal(drifting, capsys):
    assert main(["--json", "diagnose", str(drifting / "drift.csv")]) == 0
    assert Diagnosis(**json.loads(capsys.readouterr().out)).verdict == "attributed"


def turning(row):
    return (0.3, -0.3, 0.0)[row // 200 % 3]


def test_other_units_and_names_say_the_same(drifting, tmp_path):
    """Minutes, kelvin and degrees per hour, a logger's own names, a coarse thermometer, missing rows."""
    values = np.loadtxt(drifting / "drift.csv", delimiter=",", skiprows=1)
    values = values[np.random.default_rng(4).random(len(values)) > 0.03]
    table_of = np.column_stack([values[:, 0] / 60.0, np.round(values[:, 1] * 4.0) / 4.0 + 273.15, np.degrees(values[:, 2]) * 3600.0])
    np.savetxt(tmp_path / "log.csv", table_of, delimiter=",", header="stamp,box[K],z", comments="", fmt="%.9g")
    flags = ["--column", "time=stamp", "--column", "temperature=box", "--column", "rate=z", "--unit", "stamp=min", "--unit", "z=deg/h"]
    assert main(["diagnose", str(tmp_path / "log.csv"), *flags, "--json", str(tmp_path / "d.json"), "-q"]) == 0
    found = Diagnosis(**json.loads((tmp_path / "d.json").read_text()))
    assert ["ageing"] in (found.alternatives or [[e.id for e in found.effects]])
    notes = " ".join(found.notes)
    assert "steps of 0.25 degC" in notes and "samples are missing" in notes


def lines(path):
    return path.read_text().splitlines()


@pytest.mark.parametrize("damage, says", [
    (lambda rows: rows[:40] + ["40,20"], "cells where the header has 3"),
    (lambda rows: rows[:40] + ["nan,20,1e-3"] + rows[41:], "give a finite number"),
    (lambda rows: rows[:40] + rows[30:], "goes back in time"),
    (lambda rows: ["time[s],temperature[degC],rate[m/s]"] + rows[1:], "unknown unit"),
    (lambda rows: ["time[s],temperature[degC],rate"] + rows[1:], "has no unit"),
    (lambda rows: ["time[s],temperature[degC],speed[rad/s]"] + rows[1:], "no rate column"),
    (lambda rows: ["time[s],temperature[degC],rate[degC]"] + rows[1:], "not of rate"),
    (lambda rows: [rows[0]] + [row.rsplit(",", 1)[0] + ",0.5" for row in rows[1:]], "never changes"),
    (lambda rows: [rows[0]] + [f"{row.rsplit(',', 1)[0]},{i}" for i, row in enumerate(rows[1:])], "check the unit of the rate"),
    (lambda rows: [rows[0]] + [f"{t},{float(c) + 273.15},{r}" for t, c, r in (row.split(",") for row in rows[1:])], "check the unit of the temperature"),
    (lambda rows: [rows[0] + ",true_rate[rad/s]"] + [f"{row.rsplit(',', 1)[0]},{57.3 * turning(i)},{turning(i)}" for i, row in enumerate(rows[1:])],
     "check the units of both"),
    (lambda rows: rows[:-1] + [rows[-1][: len(rows[-1]) // 2]], "cells where the header has 3"),
])
def test_bad_tables_are_one_line_and_nothing_is_written(drifting, tmp_path, capsys, damage, says):
    bad = tmp_path / "bad.csv"
    bad.write_text("\n".join(damage(lines(drifting / "drift.csv"))) + "\n")
    status = main(["diagnose", str(bad), "--json", str(tmp_path / "o.json"), "--report", str(tmp_path / "o.html")])
    err = capsys.readouterr().err.splitlines()
    assert status == 2 and len(err) == 1 and says in err[0], err
    assert [p.name for p in tmp_path.iterdir()] == ["bad.csv"]


@pytest.mark.parametrize("flags, says", [
    (["--column", "rate=none"], "--column rate=none: no such column"),
    (["--column", "warp=rate"], "--column warp: unknown channel"),
    (["--unit", "none=s"], "--unit none: no such column"),
])
def test_a_wrong_flag_is_named_as_it_was_typed(drifting, capsys, flags, says):
    assert main(["diagnose", str(drifting / "drift.csv"), *flags]) == 2
    err = capsys.readouterr().err
    assert says in err and "--map" not in err


def recording(path, evidence, channels=("temperature_measured", "rate")):
    values = {"temperature_measured": evidence.temperature_degc, "rate": evidence.rate_rad_s}
    with RecordingWriter(path, RecordingMeta(counter_rate_hz=1.0, source="test")) as writer:
        writer.add_tap("output", TapFormat(1.0, {name: float_format() for name in channels}))
        writer.append("output", {name: values[name] for name in channels}, 0)
    return path


def test_a_recording_is_diagnosed_and_names_unused_taps(tmp_path):
    evidence = synthetic.make([synthetic.drift(8e-3)], 12, synthetic.two_cycles)
    path = tmp_path / "r.h5"
    with RecordingWriter(path, RecordingMeta(counter_rate_hz=1.0, source="test")) as writer:
        writer.add_tap("output", TapFormat(1.0, {name: float_format() for name in ("temperature_measured", "rate")}))
        writer.add_tap("baseband", TapFormat(1.0, {"drive_level": float_format()}))
        writer.append("output", {"temperature_measured": evidence.temperature_degc, "rate": evidence.rate_rad_s}, 0)
        writer.append("baseband", {"drive_level": np.full(len(evidence.time_s), 0.1)}, 0)
    assert main(["diagnose", str(path), "--json", str(tmp_path / "r.json"), "-q"]) == 0
    found = json.loads((tmp_path / "r.json").read_text())
    assert found["effects"][0]["id"] == "ageing" and any("baseband" in note for note in found["notes"])


def test_bad_recordings(tmp_path, capsys):
    evidence = synthetic.make([], 13)
    whole = recording(tmp_path / "whole.h5", evidence)
    cut = tmp_path / "cut.h5"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    cold = recording(tmp_path / "no_temperature.h5", evidence, ("rate",))
    for path in (cut, cold, tmp_path / "missing.h5"):
        assert main(["diagnose", str(path), "--json", str(tmp_path / "o.json")]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "o.json").exists()


def test_a_short_recording_is_insufficient_and_no_error(tmp_path):
    source = tmp_path / "short.csv"
    rows = "\n".join(f"{i},{20 + 0.1 * i},{1e-3 * (i % 3)}" for i in range(50))
    source.write_text("time[s],temperature[degC],rate[rad/s]\n" + rows + "\n")
    assert main(["diagnose", str(source), "--json", str(tmp_path / "s.json"), "--report", str(tmp_path / "s.html"), "-q"]) == 0
    assert json.loads((tmp_path / "s.json").read_text())["verdict"] == "insufficient"
    assert "insufficient" in (tmp_path / "s.html").read_text()


@pytest.mark.skipif(not CHAMBER.is_file(), reason="set WINEGLASS_CHAMBER_CSV to the chamber sweep's file")
@pytest.mark.parametrize("axis, before, alternatives", [
    ("gyro_a", 9.48e-3, [{"thermometer_lag", "ageing"}, {"thermal_hysteresis"}]),
    ("gyro_b", 2.84e-3, [{"ageing"}, {"thermal_hysteresis"}]),
])
def test_the_chamber_sweep(axis, before, alternatives, tmp_path):
    """Known from float64: static cubic, everything after the maximum held out. One cycle: drift and hysteresis are not told apart."""
    flags = ["--column", f"rate={axis}", "--drop-rows", "0,1"]
    flags += [word for unit in ("t_s=s", "temperature_degC=degC", f"{axis}=rad/s") for word in ("--unit", unit)]
    assert main(["diagnose", str(CHAMBER), *flags, "--json", str(tmp_path / "d.json"), "-q"]) == 0
    found = Diagnosis(**json.loads((tmp_path / "d.json").read_text()))
    assert found.verdict == "ambiguous"
    assert all(wanted in [set(ids) for ids in found.alternatives] for wanted in alternatives)
    channel = found.shrink.channels[0]
    assert channel.before == pytest.approx(before, rel=0.02)  # block means, and the maximum's block: 1 % from the samples' figure
    assert found.shrink.all.fraction > 0.5
    assert "second thermal cycle" in found.next_experiment.run and found.next_experiment.predicted_separation > 3
    if axis == "gyro_b":
        assert "thermometer_lag" not in [e.id for e in found.effects]
