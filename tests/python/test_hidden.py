"""A hidden fault: drawn, sealed, recorded without its name, and judged."""

import argparse
import hashlib
import json
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from wineglass import cli, effects, hidden
from wineglass.commands import demo
from wineglass.console import Console
from wineglass.effects import Setting

SHORT = """
[[segment]]
name = "all"
lasts = 1
temperature = 0.05
"""


def found(verdict, ids=(), alternatives=(), stage="coupling"):
    """What `judge` reads of a diagnosis."""
    where = [SimpleNamespace(stage=stage, share=0.7), SimpleNamespace(stage="clock", share=0.3)] if verdict != "no_gap" else []
    return SimpleNamespace(verdict=verdict, effects=[SimpleNamespace(id=name) for name in ids], alternatives=[list(a) for a in alternatives], where=where)


def case(setting):
    return hidden.Case(1, 2, setting, "full", "metal-fast", "open", "salt")


def test_the_same_seed_draws_the_same_and_others_differ():
    assert hidden.draw(5) == hidden.draw(5)
    assert len({hidden.draw(seed).digest for seed in range(20)}) == 20


def test_draws_reach_the_catalogue_and_healthy_devices():
    """Sizes within their bounds and one to three times typical; a tenth are healthy. Drawn without asking whether the twin takes them."""
    rng = np.random.default_rng(3)
    drawn = [hidden._setting(rng) for _ in range(2000)]
    assert {setting.id for setting in drawn} == {effect.id for effect in effects.catalogue()}
    for setting in drawn:
        (name, value), = setting.values.items()
        parameter = next(item for item in effects.find(setting.id).parameters if item.name == name)
        assert parameter.strength and parameter.low <= value <= parameter.high
        assert 0.99 <= abs(value) / parameter.typical <= 3.01 or value in (parameter.low, parameter.high)
    signed = [np.sign(next(iter(setting.values.values()))) for setting in drawn if setting.id == "thermal_gradient"]
    assert {-1.0, 1.0} == set(signed)
    healthy = sum(np.random.default_rng([seed, 0x48494444]).random() < hidden.HEALTHY_SHARE for seed in range(2000)) / 2000
    assert 0.05 < healthy < 0.15


def test_the_digest_is_that_of_the_label():
    drawn = hidden.draw(11)
    assert drawn.digest == hashlib.sha256(drawn.label.encode()).hexdigest()
    assert json.loads(drawn.label)["seed"] == 11


@pytest.mark.parametrize("setting", [Setting("ageing", {"linear_rad_s_per_h": 3e-4}), None])
def test_the_recording_does_not_name_it(setting, tmp_path):
    protocol = tmp_path / "short.toml"
    protocol.write_text(SHORT)
    drawn = hidden.Case(77, 4021, setting, str(protocol), "metal-fast", "open", "salt")
    hidden.record(drawn, tmp_path / "x.h5")
    data = (tmp_path / "x.h5").read_bytes()
    assert b"ageing" not in data and b"linear_rad_s_per_h" not in data
    with h5py.File(tmp_path / "x.h5") as file:
        events = " ".join(str(row) for row in file["events"][:])
    assert '"seed":4021' in events.replace("\\", "") and '"seed":77' not in events  # what noise it has, not what was drawn


@pytest.mark.parametrize(("setting", "diagnosis", "expected"), [
    ("ageing", found("attributed", ["ageing"]), (True, True, True)),
    ("ageing", found("ambiguous", ["ageing"], [["ageing"], ["thermal_hysteresis"]]), (True, False, True)),
    ("ageing", found("attributed", ["pickoff_gain"], stage="pickoff"), (False, False, False)),
    ("ageing", found("unknown"), (False, False, True)),
    ("ageing", found("no_gap"), (False, False, None)),
    (None, found("no_gap"), (True, True, None)),
    (None, found("attributed", ["ageing"]), (False, False, None)),
])
def test_judgements(setting, diagnosis, expected):
    judgement = hidden.judge(case(Setting(setting, {}) if setting else None), diagnosis)
    assert (judgement.found, judgement.alone, judgement.stage) == expected
    assert judgement.in_words


def test_what_is_named_beside_the_truth_is_said():
    judgement = hidden.judge(case(Setting("clock_jitter", {})), found("attributed", ["adc_nonlinearity", "clock_jitter"], stage="clock"))
    assert judgement.found and judgement.beside == ("adc_nonlinearity",)
    assert judgement.in_words.endswith("what is not there: adc_nonlinearity")
    right = hidden.judge(case(Setting("clock_jitter", {})), found("attributed", ["clock_jitter"], stage="clock"))
    assert right.beside == () and right.in_words == "the truth is what was named"


def test_an_interrupted_recording_is_not_diagnosed(tmp_path, monkeypatch):
    commands = []
    monkeypatch.setattr(demo, "_command", lambda words, console: commands.append(words))
    monkeypatch.setattr(hidden, "record", lambda case, path, progress: SimpleNamespace(interrupted=True))
    with pytest.raises(KeyboardInterrupt):
        demo._hidden(argparse.Namespace(output=tmp_path), 42, Console())
    assert commands == [] and not (tmp_path / "hidden-label.json").exists()


@pytest.mark.parametrize(("words", "says"), [(["--seed", "-3"], "-3 is no seed"), (["-o", "file"], "is no folder")])
def test_what_the_demo_cannot_use_is_said_before_anything_is_made(tmp_path, monkeypatch, capsys, words, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("mine")
    assert cli.main(["demo", *words]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and says in err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_demo_opens_the_label_last(tmp_path, monkeypatch, capsys):
    """The public command sees the recording only, while no label is written; the seed gives the same case again."""
    protocol = tmp_path / "short.toml"
    protocol.write_text(SHORT)
    seen = []
    real = demo._command

    def command(words, console):
        seen.append((words, sorted(path.name for path in tmp_path.iterdir())))
        real(words, console)

    monkeypatch.setattr(demo, "_command", command)
    original = hidden.draw
    monkeypatch.setattr(hidden, "draw", lambda seed: original(seed, protocol=str(protocol)))
    result = demo._hidden(argparse.Namespace(output=tmp_path), 42, Console())
    (words, present), = seen
    assert words[:2] == ["diagnose", str(tmp_path / "hidden.h5")] and "hidden-label.json" not in present
    label = (tmp_path / "hidden-label.json").read_text().strip()
    printed = capsys.readouterr().out
    assert hashlib.sha256(label.encode()).hexdigest() in printed and "--seed 42" in printed.replace("\n", " ")
    assert json.loads(label)["seed"] == 42 and result["judgement"].label == label
    assert printed.index("label sealed") < printed.index("verdict") < printed.index("the label:")
    assert Path(result["report"]).read_text().lstrip().lower().startswith("<!doctype html")
