"""The recording format: what is written is read back, foreign files are read, wrong ones are refused in one line."""

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wineglass.errors import BadInput
from wineglass.recording import (
    CHANNELS,
    ChannelFormat,
    Recording,
    RecordingMeta,
    RecordingWriter,
    TapFormat,
    float_format,
    fraction_format,
)

RATE = ChannelFormat("i4", 2.0**-28, 0.0)


def meta(**changes):
    return RecordingMeta(**{"counter_rate_hz": 50_000.0, "device_toml": "name = 'x'", "calibration_json": "{}",
                            "calibration_block": b"\x00\x01\xff", "firmware_version": "0.1.0", "source": "test", **changes})


def write_output(path, codes, first_sample=0, **kwargs):
    with RecordingWriter(path, meta()) as writer:
        writer.add_tap("output", TapFormat(100.0, {"rate": RATE}))
        writer.append("output", {"rate": np.asarray(codes, np.int32)}, first_sample, **kwargs)


# ---- round trip -------------------------------------------------------------------------------------------------------------


def test_meta_events_and_values_come_back(tmp_path):
    path = tmp_path / "a.h5"
    codes = np.array([0, 1, -(2**31), 2**31 - 1], np.int32)
    with RecordingWriter(path, meta()) as writer:
        writer.add_tap("output", TapFormat(1000.0, {"rate": RATE, "temperature_measured": float_format()}))
        writer.append("output", {"rate": codes, "temperature_measured": np.array([20.0, 21.5, 22.0, -40.0])}, 150)
        writer.event("mode", "g2", sample=400)
        writer.event("start", "µ", sample=0)
    with Recording.open(path) as recording:
        assert recording.counter_rate_hz == 50_000.0
        assert recording.device_toml == "name = 'x'" and recording.calibration_json == "{}"
        assert recording.calibration_block == b"\x00\x01\xff" and recording.firmware_version == "0.1.0"
        assert [(e.sample, e.kind, e.value) for e in recording.events] == [(0, "start", "µ"), (400, "mode", "g2")]
        tap = recording.tap("output")
        np.testing.assert_array_equal(tap.codes("rate"), codes)
        assert tap.codes("rate").dtype == np.int32
        np.testing.assert_array_equal(tap["rate"], codes / 2.0**28)
        np.testing.assert_allclose(tap.time_s, 150 / 50_000 + np.arange(4) / 1000.0, rtol=1e-15)
        assert not tap.lost.any() and len(tap) == 4 and "rate" in tap and "true_rate" not in tap


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_any_sequence_of_blocks_with_gaps_comes_back(tmp_path_factory, data):
    """Blocks of any length at any rising counters: samples stand where their counters say, everything else is lost."""
    path = tmp_path_factory.mktemp("rec") / "a.h5"
    start = data.draw(st.integers(0, 10**12))
    position, expected, lost = 0, [], []
    with RecordingWriter(path, meta()) as writer:
        writer.add_tap("output", TapFormat(1000.0, {"rate": RATE}))
        for _ in range(data.draw(st.integers(1, 6))):
            block = data.draw(st.lists(st.integers(-(2**31), 2**31 - 1), min_size=0, max_size=30))
            mask = data.draw(st.lists(st.booleans(), min_size=len(block), max_size=len(block)))
            writer.append("output", {"rate": np.array(block, np.int32)}, start + 50 * position, lost=np.array(mask, bool))
            gap = data.draw(st.integers(0, 40))
            expected += [*block, *[0] * gap]
            lost += [*mask, *[True] * gap]
            position += len(block) + gap
    with Recording.open(path) as recording:
        tap = recording.tap("output")
        count = len(tap)
        assert tap.first_sample == start and count >= len(expected) - 40
        assert all(lost[count:])  # a gap at the very end has nothing behind it
        np.testing.assert_array_equal(tap.lost, lost[:count])
        there = ~tap.lost
        np.testing.assert_array_equal(tap.codes("rate")[there], np.array(expected[:count])[there])
        assert np.isnan(tap["rate"][tap.lost]).all() and np.isfinite(tap["rate"][there]).all()


def test_long_streams_are_written_in_pieces(tmp_path):
    path = tmp_path / "a.h5"
    codes = np.arange(200_000, dtype=np.int32)
    with RecordingWriter(path, meta()) as writer:
        writer.add_tap("output", TapFormat(50_000.0, {"rate": RATE}))
        for start in range(0, len(codes), 777):
            writer.append("output", {"rate": codes[start : start + 777]}, start)
    with Recording.open(path) as recording:
        np.testing.assert_array_equal(recording.tap("output").codes("rate"), codes)


def test_bursts_keep_their_counters_and_snapshots(tmp_path):
    path = tmp_path / "a.h5"
    form = TapFormat(50_000.0, {"primary_adc_raw": fraction_format(16, "i2"), "secondary_adc_raw": fraction_format(16, "i2")})
    block = {"primary_adc_raw": np.array([-32768, 16384], np.int16), "secondary_adc_raw": np.array([1, 2], np.int16)}
    with RecordingWriter(path, meta()) as writer:
        writer.add_tap("raw", form)
        writer.append("raw", block, 1000, state_snapshot=b"v1 state")
        writer.append("raw", block, 1002)  # goes on
        writer.append("raw", block, 5000, state_snapshot=b"v1 later")
        writer.append("raw", block, 9000)  # a gap begins a new burst
    with Recording.open(path) as recording:
        bursts = recording.bursts
        assert "raw" in recording and [b.first_sample for b in bursts] == [1000, 5000, 9000]
        assert [b.state_snapshot for b in bursts] == [b"v1 state", b"v1 later", b""]
        assert [len(b) for b in bursts] == [4, 2, 2]
        np.testing.assert_array_equal(bursts[0]["primary_adc_raw"], [-1.0, 0.5, -1.0, 0.5])


def test_bursts_may_be_hours_apart(tmp_path):
    form = TapFormat(50000.0, {"primary_adc_raw": ChannelFormat("i2", 2.0**-15)})
    with RecordingWriter(tmp_path / "run.h5", meta(taps={"raw": form})) as writer:
        for first_sample in (0, 10**9, 10**12):
            writer.append("raw", {"primary_adc_raw": np.arange(3)}, first_sample)
    assert [burst.first_sample for burst in Recording.open(tmp_path / "run.h5").bursts] == [0, 10**9, 10**12]


# ---- the file appears whole or not at all -------------------------------------------------------------------------------------


def half_written(path, error):
    with RecordingWriter(path, meta()) as writer:
        writer.add_tap("output", TapFormat(100.0, {"rate": RATE}))
        writer.append("output", {"rate": np.arange(10, dtype=np.int32)}, 0)
        assert not path.exists()
        raise error


def test_an_interrupt_leaves_a_valid_file(tmp_path):
    path = tmp_path / "a.h5"
    with pytest.raises(KeyboardInterrupt):
        half_written(path, KeyboardInterrupt())
    with Recording.open(path) as recording:
        assert len(recording.tap("output")) == 10
        assert recording.events[-1].kind == "interrupted"
    assert list(tmp_path.iterdir()) == [path]


def test_a_failure_leaves_nothing(tmp_path):
    with pytest.raises(BadInput):
        half_written(tmp_path / "a.h5", BadInput("x"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("place", "says"), [("none/a.h5", "the folder does not exist"), ("folder", "is a folder")])
def test_a_place_that_cannot_be_written_is_refused_at_once(tmp_path, place, says):
    """Not after an hour of recording, when the file is to get its name."""
    (tmp_path / "folder").mkdir()
    with pytest.raises(BadInput, match=says):
        RecordingWriter(tmp_path / place, meta())
    assert [path.name for path in tmp_path.iterdir()] == ["folder"] and not list((tmp_path / "folder").iterdir())


def test_an_older_file_survives_a_failure(tmp_path):
    path = tmp_path / "a.h5"
    write_output(path, [1, 2, 3])
    before = path.read_bytes()
    with pytest.raises(ValueError):
        half_written_over(path)
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


def half_written_over(path):
    with RecordingWriter(path, meta()) as writer:
        writer.add_tap("output", TapFormat(100.0, {"rate": RATE}))
        raise ValueError


@pytest.mark.parametrize("first", [10, 499])
def test_the_writer_refuses_a_counter_that_goes_back(tmp_path, first):
    with pytest.raises((BadInput, ValueError)):
        with RecordingWriter(tmp_path / "a.h5", meta()) as writer:
            writer.add_tap("output", TapFormat(100.0, {"rate": RATE}))
            writer.append("output", {"rate": np.zeros(5, np.int32)}, 0)
            writer.append("output", {"rate": np.zeros(5, np.int32)}, first)


@pytest.mark.parametrize("data", [
    {"rate": np.array([2**31])},
    {"rate": np.array([0.5])},
    {"rate": np.zeros(2, np.int32), "true_rate": np.zeros(2)},
    {},
])
def test_the_writer_refuses_what_does_not_fit(tmp_path, data):
    with pytest.raises(ValueError):
        with RecordingWriter(tmp_path / "a.h5", meta()) as writer:
            writer.add_tap("output", TapFormat(100.0, {"rate": RATE}))
            writer.append("output", data, 0)


# ---- foreign files ------------------------------------------------------------------------------------------------------------


def foreign(path, edit=lambda file: None):
    """A recording as somebody else's program might write it, without this package's writer."""
    with h5py.File(path, "w") as file:
        file.attrs["format"] = "wineglass-recording"
        file.attrs["format_version"] = 1
        file.attrs["counter_rate_hz"] = 1000.0
        for tap, names in {"output": ["temperature_measured", "rate"], "reference": ["true_rate"]}.items():
            group = file.create_group(tap)
            group.attrs["sample_rate_hz"] = 10.0
            group.attrs["first_sample"] = 0
            for name in names:
                data = group.create_dataset(name, data=np.linspace(1.0, 2.0, 20))
                data.attrs["unit"] = CHANNELS[name].unit
                data.attrs["scale"], data.attrs["offset"] = 1.0, 0.0
        edit(file)
    return path


def test_foreign_files_are_read_whatever_else_they_hold(tmp_path):
    def edit(file):
        file.attrs["author"] = "me"
        file["output"].attrs["sample_rate_hz"] = np.array([[10.0]])  # as MATLAB writes scalars
        file["output/rate"].attrs["unit"] = np.bytes_("deg/s")
        del file["output/rate"].attrs["scale"]
        file["output/my_own"] = np.zeros(7)
        file["notes"] = "hello"
        del file["output/temperature_measured"]
        column = file["output"].create_dataset("temperature_measured", data=np.full((20, 1), 293.15))
        column.attrs["unit"] = "K"

    with Recording.open(foreign(tmp_path / "a.h5", edit)) as recording:
        output = recording.tap("output")
        np.testing.assert_allclose(output["rate"], np.deg2rad(np.linspace(1.0, 2.0, 20)))
        np.testing.assert_allclose(output["temperature_measured"], 20.0)
        assert output.ignored == ["my_own"] and output.channels["rate"] == "rad/s"
        assert list(recording.taps) == ["output", "reference"]
        assert recording.calibration_block == b"" and recording.events == []


def test_a_single_tap_needs_no_counter_rate(tmp_path):
    def edit(file):
        del file.attrs["counter_rate_hz"]
        del file["reference"]

    with Recording.open(foreign(tmp_path / "a.h5", edit)) as recording:
        np.testing.assert_allclose(recording.tap("output").time_s, np.arange(20) / 10.0)


def test_nan_counts_as_missing_only_where_it_is_marked_lost(tmp_path):
    def edit(file):
        file["output/rate"][3] = np.nan
        file["output"]["lost"] = np.arange(20) == 3

    with Recording.open(foreign(tmp_path / "a.h5", edit)) as recording:
        tap = recording.tap("output")
        assert np.flatnonzero(np.isnan(tap["rate"])).tolist() == [3] == np.flatnonzero(np.isnan(tap["temperature_measured"])).tolist()


def _set(where, name, value):
    def edit(file):
        target = file[where] if where else file
        if value is None:
            del target.attrs[name]
        else:
            target.attrs[name] = value

    return edit


def _data(where, values, unit="rad/s"):
    def edit(file):
        if where in file:
            del file[where]
        file[where] = values
        file[where].attrs["unit"], file[where].attrs["scale"], file[where].attrs["offset"] = unit, 1.0, 0.0

    return edit


def _poke(where, index, value):
    def edit(file):
        file[where][index] = value

    return edit


def _burst(index, first_sample):
    def edit(file):
        group = file.create_group(f"raw/burst_{index:04d}")
        group.attrs["sample_rate_hz"], group.attrs["first_sample"] = 1000.0, first_sample
        _data(f"raw/burst_{index:04d}/primary_adc_raw", np.zeros(100), "FS")(file)

    return edit


def _all(*edits):
    def edit(file):
        for each in edits:
            each(file)

    return edit


def _events(rows):
    def edit(file):
        text = h5py.string_dtype()
        file["events"] = np.array(rows, dtype=[("sample", "i8"), ("kind", text), ("value", text)])

    return edit


REFUSED = {
    "another program's file": (_set("", "format", "other"), "not a wineglass recording"),
    "no format": (_set("", "format", None), "not a wineglass recording"),
    "future version": (_set("", "format_version", 99), "version 99"),
    "no counter rate but needed": (_all(_set("", "counter_rate_hz", None), _set("output", "first_sample", 7)), "counter_rate_hz is missing"),
    "counter rate nan": (_set("", "counter_rate_hz", np.nan), "counter_rate_hz"),
    "no sample rate": (_set("output", "sample_rate_hz", None), "sample_rate_hz is missing"),
    "sample rate zero": (_set("output", "sample_rate_hz", 0.0), "sample_rate_hz is 0"),
    "sample rate text": (_set("output", "sample_rate_hz", "fast"), "not a finite number"),
    "no first sample": (_set("output", "first_sample", None), "first_sample is missing"),
    "first sample negative": (_set("output", "first_sample", -1), "negative"),
    "first sample broken": (_set("output", "first_sample", 0.5), "whole number"),
    "no unit": (_set("output/rate", "unit", None), "no unit"),
    "unknown unit": (_set("output/rate", "unit", "furlong"), "'furlong' is unknown"),
    "wrong kind of unit": (_set("output/rate", "unit", "degC"), "no unit of rate"),
    "unit is a number": (_set("output/rate", "unit", 3.0), "not a text"),
    "scale zero": (_set("output/rate", "scale", 0.0), "scale 0"),
    "scale nan": (_set("output/rate", "scale", np.nan), "scale"),
    "offset infinite": (_set("output/rate", "offset", np.inf), "offset"),
    "codes without scale": (_all(_data("output/rate", np.zeros(20, np.int32)), _set("output/rate", "scale", None)), "scale is missing"),
    "lengths differ": (_data("output/rate", np.zeros(19)), "differ in length"),
    "two columns": (_data("output/rate", np.zeros((10, 2))), "shape"),
    "text as channel": (_data("output/rate", np.array([b"a"] * 20)), "not a numeric"),
    "complex channel": (_data("output/rate", np.zeros(20, complex)), "not a numeric"),
    "nan": (_poke("output/rate", 4, np.nan), "nan at sample 4"),
    "infinity": (_poke("output/rate", 4, np.inf), "inf at sample 4"),
    "below absolute zero": (_poke("output/temperature_measured", 2, -300.0), "-300 at sample 2"),
    "mask of another length": (_data("output/lost", np.zeros(5), ""), "mask"),
    "time goes back": (_data("output/time", np.r_[np.arange(10.0), 5.0, np.arange(10, 19)], "s"), "sample 10"),
    "time repeats": (_data("output/time", np.repeat(np.arange(10.0), 2), "s"), "does not rise at sample 1"),
    "time nan": (_data("output/time", np.r_[np.arange(19.0), np.nan], "s"), "time is nan"),
    "bursts overlap": (_all(_burst(0, 0), _burst(1, 50)), "before raw/burst_0000 ends"),
    "events go back": (_events([(5, "a", ""), (4, "b", "")]), "goes back"),
    "events of another shape": (_data("events", np.zeros(3)), "other columns"),
    "no taps": (lambda file: [file.pop("output"), file.pop("reference")], "no tap"),
    "empty tap": (lambda file: [file["output"].pop("rate"), file["output"].pop("temperature_measured")], "no known channel"),
    "device is a number": (_data("device_toml", np.zeros(1)), "not a text"),
}


@pytest.mark.parametrize("edit, message", REFUSED.values(), ids=REFUSED.keys())
def test_wrong_files_are_refused_in_one_line(tmp_path, edit, message):
    with pytest.raises(BadInput) as caught:
        Recording.open(foreign(tmp_path / "a.h5", edit))
    assert message in str(caught.value) and "a.h5" in str(caught.value) and "\n" not in str(caught.value)


def test_the_unedited_foreign_file_is_fine(tmp_path):
    Recording.open(foreign(tmp_path / "a.h5")).close()


@pytest.mark.parametrize("keep", [0.3, 0.9, 0.999])
def test_truncated_files_are_refused(tmp_path, keep):
    path = tmp_path / "a.h5"
    write_output(path, np.arange(50_000) % 977)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(keep * len(whole))])
    with pytest.raises(BadInput, match="truncated|not an HDF5"):
        Recording.open(path)


@settings(max_examples=40, deadline=None)
@given(at=st.floats(0, 1, exclude_max=True), bits=st.integers(1, 255))
def test_damaged_bytes_never_raise_anything_but_bad_input(tmp_path_factory, at, bits):
    path = tmp_path_factory.mktemp("rec") / "a.h5"
    write_output(path, np.arange(300))
    data = bytearray(path.read_bytes())
    data[int(at * len(data))] ^= bits
    path.write_bytes(data)
    try:
        with Recording.open(path) as recording:
            recording.tap("output")["rate"]
    except BadInput:
        pass


@pytest.mark.parametrize("make, message", [
    (lambda path: None, "no such file"),
    (lambda path: path.mkdir(), "folder"),
    (lambda path: path.write_bytes(b""), "not an HDF5"),
    (lambda path: path.write_text("t,rate\n"), "not an HDF5"),
])
def test_no_recording_at_all(tmp_path, make, message):
    path = tmp_path / "a.h5"
    make(path)
    with pytest.raises(BadInput, match=message):
        Recording.open(path)


def test_asking_for_what_is_not_there_says_what_is(tmp_path):
    write_output(tmp_path / "a.h5", [1, 2])
    with Recording.open(tmp_path / "a.h5") as recording:
        with pytest.raises(BadInput, match="it holds: output"):
            recording.tap("baseband")
        with pytest.raises(BadInput, match="it holds: rate"):
            recording.tap("output")["true_rate"]
