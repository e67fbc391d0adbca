"""[[effect]] tables of a device description: read, written, and switched on by both twins as if given to them."""

import numpy as np
import pytest

from wineglass import device as devices
from wineglass import scenario
from wineglass.calibration_block import from_binary
from wineglass.cli import main
from wineglass.effects import Setting
from wineglass.envelope import Envelope
from wineglass.errors import BadInput
from wineglass.recording import Recording
from wineglass.twin import Twin, block_for

TEXT = 'extends = "metal-fast"\nname = "unit-7"\n[[effect]]\nid = "frequency_split"\nparameters = { split_hz = 0.05 }\n'
SETTING = Setting("frequency_split", {"split_hz": 0.05})


def runs():
    short = scenario.load("rate-steps").changed({"duration_s": 3.0, "command": []})
    return scenario.prepare(short, devices.loads(TEXT)), scenario.prepare(short, devices.load("metal-fast"))


def test_a_description_with_effects_reads_back():
    device = devices.loads(TEXT)
    assert device.effects == [SETTING] and devices.loads(device.to_toml()) == device
    assert devices.load("metal-fast").effects == []


def test_the_envelope_twin_takes_them():
    amended, plain = runs()
    with Envelope(amended) as a, Envelope(plain, effects=[SETTING]) as b, Envelope(plain) as c:
        first, second, without = (twin.run()["secondary_quadrature"] for twin in (a, b, c))
    assert np.array_equal(first, second) and not np.array_equal(first, without)


def test_the_full_twin_takes_them():
    amended, plain = runs()
    with Twin(amended, codes=True) as a, Twin(plain, effects=[SETTING], codes=True) as b, Twin(plain, codes=True) as c:
        first, second, without = (twin.step(1000).codes for twin in (a, b, c))
    assert np.array_equal(first, second) and not np.array_equal(first, without)


def test_the_nominal_calibration_does_not_know_of_them():
    amended, plain = (from_binary(block_for(run)) for run in runs())
    assert amended == plain.with_changes(device_name="unit-7")


def test_simulate_goes_on_with_the_amended_description(tmp_path):
    path = tmp_path / "unit-7.toml"
    path.write_text(TEXT)
    assert main(["simulate", "rate-steps", "--device", str(path), "--duration", "1", "-o", str(tmp_path / "r.h5"), "-q", "--set", "command=[]"]) == 0
    with Recording.open(tmp_path / "r.h5") as recording:
        assert devices.loads(recording.device_toml).effects == [SETTING]


@pytest.mark.parametrize("table, says", [
    ('id = "nothing"', "no effect 'nothing'"),
    ('id = "frequency_split"\nparameters = { speed = 1.0 }', "no parameter 'speed'"),
    ('id = "frequency_split"\nparameters = { split_hz = 1e6 }', "not possible"),
    ('id = "frequency_split"\nsize = 1.0', "unknown key 'size'"),
])
def test_bad_tables_are_refused(table, says):
    with pytest.raises(BadInput, match=says):
        device = devices.loads(f'extends = "metal-fast"\n[[effect]]\n{table}\n')
        Envelope(scenario.prepare(scenario.load("rate-steps"), device))
