"""./wineglass compare: the description that is true is the closer one, in the channels in which they differ; equal ones are not told apart."""

import json

import numpy as np
import pytest

from wineglass import device as devices
from wineglass import scenario
from wineglass.cli import main
from wineglass.diagnosis.comparison import compare
from wineglass.effect_table import EffectTable
from wineglass.recording import Recording
from wineglass.simulation import simulate

SPLIT = EffectTable(id="frequency_split", parameters={"split_hz": 0.004})


def amended(*effects):
    return devices.load("metal-fast").model_copy(update={"effect": list(effects)})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A recording of a gyro with a little more split than described, and both descriptions."""
    folder = tmp_path_factory.mktemp("compare")
    (folder / "true.toml").write_text(amended(SPLIT).to_toml())
    day = scenario.load("thermal-sweep").changed({"duration_s": 50.0, "seed": 91})
    simulate(scenario.prepare(day, amended(SPLIT)), folder / "r.h5")
    return folder


def test_the_true_description_is_closer(folder, tmp_path, capsys):
    names = ["--device", "metal-fast", "--device", str(folder / "true.toml")]
    assert main(["compare", str(folder / "r.h5"), *names, "--json", str(tmp_path / "c.json")]) == 0
    assert "true.toml is closer" in capsys.readouterr().out.replace("\n", "")
    found = json.loads((tmp_path / "c.json").read_text())
    assert found["closer"] == "b" and found["removed"]["value"] > 0.9 and found["ratio"]["high"] < 0.5
    channels = {c["name"]: c for c in found["channels"]}
    assert channels["secondary_quadrature"]["a"] > 20 * channels["secondary_quadrature"]["floor"]
    assert channels["secondary_quadrature"]["b"] < 1.5 * channels["secondary_quadrature"]["floor"]
    assert len(found["sha256"]) == 64 and found["temperature_from"] == "shell_temperature"


def test_either_order(folder):
    with Recording.open(folder / "r.h5") as recording:
        found = compare(recording, amended(SPLIT), devices.load("metal-fast"))
    assert found.closer == "a" and found.removed.value > 0.9 and found.ratio.low > 2.0


def test_equal_descriptions_are_not_told_apart(folder):
    with Recording.open(folder / "r.h5") as recording:
        found = compare(recording, devices.load("metal-fast"), devices.load("metal-fast"))
    assert found.closer == "" and found.ratio.value == 1.0 and found.removed is None
    assert all(c.a == c.b for c in found.channels)


def test_the_floor_is_the_noise_of_one_channel(folder):
    """Against another estimate: neighbouring frames of the recording itself, where nothing moves."""
    with Recording.open(folder / "r.h5") as recording:
        found = compare(recording, amended(SPLIT), amended(SPLIT))
        tap = recording.tap("baseband")
        values = tap["primary_quadrature"][50:450].reshape(-1, 2).mean(axis=1)
    noise = np.std(np.diff(values, 2)) / np.sqrt(6)
    channel = next(c for c in found.channels if c.name == "primary_quadrature")
    assert channel.floor == pytest.approx(np.sqrt(2) * noise, rel=0.35)
    assert channel.a < 1.3 * channel.floor


@pytest.mark.parametrize("flags, says", [
    (["--device", "metal-fast"], "give it twice"),
    (["--device", "metal-fast", "--device", "nothing"], "no device 'nothing'"),
    (["--device", "metal-fast", "--device", "metal-fast", "--json", "c.txt"], "does not end in .json"),
])
def test_bad_input(folder, capsys, flags, says):
    assert main(["compare", str(folder / "r.h5"), *flags]) == 2
    err = capsys.readouterr().err.splitlines()
    assert len(err) == 1 and says in err[0]
