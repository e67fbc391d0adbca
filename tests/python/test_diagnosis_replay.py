"""Replay of raw bursts: a sound recording replays bit for bit; whatever is changed in it is found, with sample and module."""

import shutil

import h5py
import numpy as np
import pytest

from wineglass import scenario
from wineglass.diagnosis import replay, snapshot_fields
from wineglass.effects import Setting
from wineglass.native import library
from wineglass.recording import Recording
from wineglass.simulation import simulate

BURSTS = [{"time_s": 2.0, "samples": 4000}, {"time_s": 3.0, "samples": 2500}]


def make(path, loop="open", effects=(), **changes):
    run = scenario.prepare(scenario.parse({
        "device": "metal-fast", "duration_s": 3.5, "seed": 11, "mode": {"loop": loop}, "rate": {"kind": "constant", "value_deg_s": 2.0},
        "recording": {"baseband_hz": 100.0, "output_hz": 50.0, "reference_hz": 0.0, "bursts": BURSTS}, **changes}, "test"))
    simulate(run, path, effects=effects)
    return path


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return make(tmp_path_factory.mktemp("replay") / "sound.h5")


@pytest.fixture(scope="module")
def rebalanced(tmp_path_factory):
    return make(tmp_path_factory.mktemp("replay") / "rebalanced.h5", "rebalance")


def checked(path):
    with Recording.open(path) as recording:
        return replay.check(recording)


@pytest.fixture
def changed(tmp_path):
    """A copy of a recording, opened for writing by the test's own function."""
    def change(path, how):
        copy = tmp_path / "changed.h5"
        shutil.copy(path, copy)
        with h5py.File(copy, "r+") as file:
            how(file)
        return checked(copy)
    return change


# ---- sound ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("which", ["sound", "rebalanced"])
def test_sound_recording_replays_bit_for_bit(which, request):
    found = checked(request.getfixturevalue(which))
    assert found.ok is True and found.checked == [0, 1] and found.samples == 6500
    assert found.first_difference is None and not found.configuration and not found.not_checked
    # 4000 samples are 80 slow ticks, a millisecond each: 7 or 8 whole intervals of 10 ms and 3 or 4 of 20 ms, and so on
    assert 10 + 5 <= found.intervals <= 12 + 7
    assert "bit for bit" in found.sentence()


def test_commanded_settings_are_no_mismatch(tmp_path):
    path = make(tmp_path / "commanded.h5", command=[{"kind": "amplitude", "at_s": 1.0, "set_point_fs": 0.7},
                                                    {"kind": "output_filter", "at_s": 1.0, "corner": "0.1"}])
    found = checked(path)
    assert found.ok is True
    assert {item.name for item in found.commanded} == {"drive.amplitude_q30", "monitor.amplitude_limit_q30", "output_filter"}


# ---- something else than this firmware with this calibration -----------------------------------------------------------------


def test_other_calibration_in_the_device_is_named_with_its_size(tmp_path):
    path = make(tmp_path / "mismatch.h5", effects=[Setting("firmware_mismatch", {"scale": 0.003, "bias": -0.05})])
    found = checked(path)
    assert found.ok is False and found.first_difference is None
    ratios = {item.name: item.ratio for item in found.configuration}
    assert ratios["bias_rad_s_q31.coef"] == pytest.approx(0.95, abs=1e-6)
    assert ratios["scale_rad_s_q28.coef"] == pytest.approx(1.003, abs=1e-6)
    assert set(ratios) == {"bias_rad_s_q31.coef", "scale_rad_s_q28.coef", "rebalance_scale_rad_s_q28.coef"}


@pytest.mark.parametrize(("channel", "at", "module"), [("drive_dac_raw", 1234, "drive"), ("rebalance_dac_raw", 77, "rebalance")])
def test_one_wrong_force_code_is_found_where_it_is(rebalanced, changed, channel, at, module):
    def flip(file):
        file["raw/burst_0001"][channel][at] += 1

    with Recording.open(rebalanced) as recording:
        first = recording.bursts[1].first_sample
    found = changed(rebalanced, flip)
    assert found.ok is False and found.differing_bursts == [1]
    assert found.first_difference.burst == 1 and found.first_difference.sample == first + at
    assert module in found.first_difference.module and "1 of 2500" in found.first_difference.what


def set_field(file, burst, part, name, change):
    """Changes one field of a snapshot in place."""
    dataset = file[f"raw/burst_{burst:04d}/state_snapshot"]
    data = bytearray(dataset[()].tobytes() if hasattr(dataset[()], "tobytes") else dataset[()])
    field = next(f for f in snapshot_fields.fields() if (f.part, f.name) == (part, name))
    numbers = field.of(bytes(data)).copy()
    numbers[0] = change(int(numbers[0]))
    data[field.offset:field.offset + field.width * field.count] = numbers.tobytes()
    dataset[...] = np.frombuffer(bytes(data), dataset.dtype) if dataset.shape else bytes(data)


@pytest.mark.parametrize(("part", "name", "change", "module"), [
    ("cfg", "drive.pll_proportional_q32", lambda v: v * 2, "drive"),
    ("cfg", "rebalance.proportional_q16", lambda v: v // 2, "rebalance"),
    ("cfg", "drive.agc_proportional_q16", lambda v: v + v // 4, "drive loop"),
    ("cfg", "rebalance.integral_q24", lambda v: v + v // 4, "rebalance or"),
    ("state", "oscillator.phase_u64", lambda v: v + 2**55, "oscillator"),
    ("state", "drive_shaper.error1", lambda v: v + 2**15, "shaper"),
])
def test_other_firmware_is_found_in_the_forces(rebalanced, changed, part, name, change, module):
    found = changed(rebalanced, lambda file: set_field(file, 0, part, name, change))
    assert found.ok is False and found.first_difference.burst == 0
    assert module in found.first_difference.module


@pytest.mark.parametrize(("tap", "channel", "module"), [("output", "rate", "compensation"), ("output", "rate_uncompensated", "rate"),
                                                        ("baseband", "secondary_quadrature", "secondary"),
                                                        ("output", "temperature_measured", "thermometer")])
def test_one_wrong_telemetry_code_is_found(sound, changed, tap, channel, module):
    with Recording.open(sound) as recording:
        burst, frames = recording.bursts[0], recording.tap(tap)
        row = int(np.searchsorted(frames.time_s, (burst.first_sample + 2000) / 50e3))
        end = frames.first_sample + round((row + 0.5) * 50e3 / frames.sample_rate_hz)

    def flip(file):
        file[tap][channel][row] += 1

    found = changed(sound, flip)
    assert found.ok is False and module in found.first_difference.module
    assert found.first_difference.sample == end


# ---- what cannot be checked ---------------------------------------------------------------------------------------------------


def test_no_burst_says_so(tmp_path):
    path = make(tmp_path / "none.h5", recording={"baseband_hz": 50.0, "output_hz": 50.0, "reference_hz": 0.0})
    found = checked(path)
    assert found.ok is None and found.not_checked == ["the recording has no raw burst"]


def test_snapshot_of_another_version_is_not_replayed(sound, changed):
    def other_version(file):
        dataset = file["raw/burst_0000/state_snapshot"]
        data = bytearray(np.asarray(dataset[()]).tobytes())
        data[0] += 1
        dataset[...] = np.frombuffer(bytes(data), dataset.dtype) if dataset.shape else bytes(data)

    found = changed(sound, other_version)
    assert found.checked == [1] and found.ok is True
    assert any("burst 0 cannot" in note and "not one of this firmware" in note for note in found.not_checked)


@pytest.mark.parametrize("missing", ["secondary_adc_raw", "thermometer_raw", "state_snapshot"])
def test_a_burst_without_what_replay_needs_is_left_out(sound, changed, missing):
    def remove(file):
        for name in file["raw"]:
            del file["raw"][name][missing]

    found = changed(sound, remove)
    assert found.ok is None and any("bursts 0 to 1 cannot" in note for note in found.not_checked) and found.first_difference is None


def test_other_recorders_floats_are_compared_to_their_rounding(sound, changed):
    def to_floats(file):
        for tap, names in (("output", ("rate", "quadrature")), ("baseband", ("primary_in_phase", "drive_frequency"))):
            for name in names:
                old = file[tap][name]
                values = (old[()].astype(np.float64) * old.attrs["scale"] + old.attrs.get("offset", 0.0))
                unit = old.attrs["unit"]
                del file[tap][name]
                file[tap].create_dataset(name, data=values.astype(np.float32) if name != "drive_frequency" else values).attrs["unit"] = unit

    assert changed(sound, to_floats).ok is True


# ---- the table of fields --------------------------------------------------------------------------------------------------------


def test_fields_fill_the_snapshot():
    assert snapshot_fields.snapshot_bytes() == library().wg_device_snapshot_size()
    places = [(field.offset, field.width * field.count) for field in snapshot_fields.fields()]
    assert all(a + size == b for (a, size), (b, _) in zip(places, places[1:]))


def test_fields_hold_what_they_are_called(sound):
    with Recording.open(sound) as recording:
        snapshot = recording.bursts[0].state_snapshot
    value = {f.name: f.of(snapshot) for f in snapshot_fields.fields() if f.part == "cfg"}
    assert value["lockin.decimation"][0] == 10 and value["loops_per_slow"][0] == 5
    assert value["drive.amplitude_q30"][0] == round(0.9 * 2**30)
    assert value["bias_rad_s_q31.coef"][0] == round(1.0792e-3 * 2**31)
    assert value["output_filter"][0] == 3 and value["calibration_valid"][0] == 1
