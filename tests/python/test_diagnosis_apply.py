"""--apply: the description with the named effects in it is read by both twins; effects without a size that they understand are said and left out."""

import diagnosis_synthetic as synthetic
import numpy as np
import pytest

from wineglass import device as devices
from wineglass.cli import main
from wineglass.diagnosis.amended import amend, text
from wineglass.diagnosis.contract import Diagnosis
from wineglass.errors import BadInput


def diagnosis(verdict, found, alternatives=()):
    """found: {id: {parameter: value}}; every set of `alternatives` (else all together) is a hypothesis, the first one the most probable."""
    stages = {"frequency_split": "secondary", "thermal_hysteresis": "coupling", "ageing": "coupling"}
    sets = [list(ids) for ids in alternatives] or [list(found)]
    weight = 0.9 / sum(range(1, len(sets) + 1))
    hypotheses = [{"ids": ids, "probability": weight * (len(sets) - i)} for i, ids in enumerate(sets) if ids]
    rest = 1.0 - sum(h["probability"] for h in hypotheses)
    hypotheses += [{"ids": ["none"], "probability": 0.5 * rest}, {"ids": ["other"], "probability": 0.5 * rest}]
    effects = [{"id": name, "stage": stages[name], "share": 0.3, "confidence": sum(h["probability"] for h in hypotheses if name in h["ids"]),
                "parameters": [{"name": p, "value": v, "interval": (v, v), "unit": "1"} for p, v in values.items()]} for name, values in found.items()]
    return Diagnosis(verdict=verdict, sentence="There is a gap.", where=[], hypotheses=hypotheses, effects=effects, alternatives=sets if alternatives else [],
                     shrink={"channels": [], "all": {"before": None, "after": None, "floor": None, "fraction": None, "interval": None},
                             "held_out": "", "computed_by": ""}, next_experiment=None, notes=[],
                     provenance={"program": "wineglass", "engine": "test", "recording": "r.h5", "sha256": "0" * 64})


def applied(device, found):
    return {e.id: e.parameters for e in devices.loads(text(amend(device, found), found)).effect}


def test_the_effects_of_a_verdict_are_applied_and_the_fields_stay():
    device = devices.load("metal-fast")
    found = diagnosis("attributed", {"frequency_split": {"split_hz": 0.03, "axis_deg": 10.0}, "ageing": {"linear_rad_s_per_h": 1e-3}})
    assert applied(device, found) == {"frequency_split": {"split_hz": 0.03, "axis_deg": 10.0}, "ageing": {"linear_rad_s_per_h": 1e-3}}
    assert amend(device, found).device.resonator == device.resonator


def test_of_several_explanations_the_most_probable_one():
    found = diagnosis("ambiguous", {"frequency_split": {"split_hz": 0.03}, "ageing": {"linear_rad_s_per_h": 1e-3}}, [("ageing",), ("frequency_split",)])
    assert applied(devices.load("metal-fast"), found) == {"ageing": {"linear_rad_s_per_h": 1e-3}}
    assert "Several explanations" in text(amend(devices.load("metal-fast"), found), found)


def test_a_second_diagnosis_adds_to_the_first():
    once = amend(devices.load("metal-fast"), diagnosis("attributed", {"frequency_split": {"split_hz": 0.03}})).device
    assert applied(once, diagnosis("attributed", {"frequency_split": {"split_hz": -0.01}})) == {"frequency_split": {"split_hz": pytest.approx(0.02)}}
    with pytest.raises(BadInput, match="would become"):
        amend(once, diagnosis("attributed", {"frequency_split": {"split_hz": 20.0}}))


def test_a_second_curve_is_laid_on_the_first():
    first = {"split_hz": 0.03, "curve_20_degc": 0.5, "curve_30_degc": 0.25}
    once = amend(devices.load("metal-fast"), diagnosis("attributed", {"frequency_split": first})).device
    twice = applied(once, diagnosis("attributed", {"frequency_split": {"split_hz": 0.01, "curve_30_degc": 0.5, "curve_40_degc": 1.0}}))
    assert twice["frequency_split"] == pytest.approx({"split_hz": 0.04, "curve_20_degc": 0.5, "curve_30_degc": 0.75, "curve_40_degc": 1.0})


def test_what_the_twins_do_not_understand_is_left_out_and_said():
    found = diagnosis("attributed", {"thermal_hysteresis": {"peak_to_peak_rad_s": 1e-3}})
    amended = amend(devices.load("metal-fast"), found)
    assert amended.left_out == ("thermal_hysteresis",) and amended.device.effect == []
    assert "thermal_hysteresis is not applied" in text(amended, found)


def table(path, evidence):
    rows = np.column_stack([evidence.time_s, evidence.temperature_degc, evidence.rate_rad_s])[::4]
    np.savetxt(path, rows, delimiter=",", header="time[s],temperature[degC],rate[rad/s]", comments="", fmt="%.9g")
    return path


def test_the_command_writes_it_and_simulate_takes_it(tmp_path, capsys):
    source = table(tmp_path / "t.csv", synthetic.make([synthetic.gradient(4e-3)], 11, synthetic.two_cycles))
    assert main(["diagnose", str(source), "--apply", str(tmp_path / "better.toml")]) == 2
    assert "name the device" in capsys.readouterr().err and not (tmp_path / "better.toml").exists()
    assert main(["diagnose", str(source), "--device", "metal-fast", "--apply", str(tmp_path / "better.toml"), "-q"]) == 0
    better = devices.load(tmp_path / "better.toml")
    assert [e.id for e in better.effects] == ["thermal_gradient"]
    flags = ["--duration", "0.5", "--set", "command=[]", "-q"]
    assert main(["simulate", "rate-steps", "--device", str(tmp_path / "better.toml"), "-o", str(tmp_path / "r.h5"), *flags]) == 0
