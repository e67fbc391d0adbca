"""CSV import and export: values and units survive, and every doubtful table is refused with its line."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wineglass.cli import main
from wineglass.errors import BadInput
from wineglass.importers.csv import ImportOptions, import_csv, read_csv
from wineglass.recording import Recording

GOOD = "time[s],temperature[degC],rate[deg/s]\n0,20,1\n0.5,21,2\n1,22,3\n"


def table(tmp_path, text, name="a.csv"):
    path = tmp_path / name
    path.write_bytes(text.encode("utf-8") if isinstance(text, str) else text)
    return path


def options(columns=None, unit_of=None, drop_rows=()):
    return ImportOptions(columns or {}, unit_of or {}, frozenset(drop_rows))


def test_a_plain_table(tmp_path):
    import_csv(table(tmp_path, GOOD), tmp_path / "a.h5", options())
    with Recording.open(tmp_path / "a.h5") as recording:
        tap = recording.tap("output")
        assert tap.sample_rate_hz == 2.0 and "time" not in tap
        np.testing.assert_allclose(tap["rate"], np.deg2rad([1, 2, 3]))
        np.testing.assert_allclose(tap["temperature_measured"], [20, 21, 22])
        np.testing.assert_allclose(tap.time_s, [0, 0.5, 1])


# factors written out by hand, not taken from the table under test
@pytest.mark.parametrize("unit, factor", [
    ("rad/s", 1.0), ("deg/s", np.pi / 180), ("deg/h", np.pi / 648000), ("mdeg/s", np.pi / 180e3), ("mrad/s", 1e-3), ("°/s", np.pi / 180),
])
def test_rate_units(tmp_path, unit, factor):
    data = read_csv(table(tmp_path, f"t[s],temp[degC],gyro[{unit}]\n0,1,7\n1,1,-2\n"), options())
    np.testing.assert_allclose(data.channels["rate"], [7 * factor, -2 * factor], rtol=1e-14)


@pytest.mark.parametrize("unit, factor", [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("min", 60.0)])
def test_time_units_and_kelvin(tmp_path, unit, factor):
    data = read_csv(table(tmp_path, f"t[{unit}],temp[K]\n1,273.15\n2,300\n"), options())
    np.testing.assert_allclose(data.time_s, [factor, 2 * factor])
    np.testing.assert_allclose(data.channels["temperature_measured"], [0.0, 26.85], atol=1e-12)


def test_names_and_units_told_on_the_command_line(tmp_path):
    text = "a,b,c,other\n0,1,2,9\n1,1,3,9\n"
    told = options({"time": "a", "temperature": "b", "true_rate": "c"}, {"a": "s", "b": "degC", "c": "deg/s"})
    data = read_csv(table(tmp_path, text), told)
    assert data.ignored == ["other"] and data.source == {"time": "a", "temperature_measured": "b", "true_rate": "c"}


def test_dropped_rows_are_not_looked_at(tmp_path):
    text = "time[s],rate[rad/s]\n5,nan\n,oops\n0,1\n1,2\n"
    data = read_csv(table(tmp_path, text), options(drop_rows=[0, 1]))
    np.testing.assert_array_equal(data.channels["rate"], [1, 2])


def test_uneven_time_is_kept(tmp_path):
    times = np.array([0.3, 1.0, 1.9, 3.2])
    text = "time[s],rate[rad/s]\n" + "".join(f"{t},1\n" for t in times)
    result = import_csv(table(tmp_path, text), tmp_path / "a.h5", options())
    assert not result.uniform and result.sample_rate_hz == pytest.approx(3 / 2.9)
    with Recording.open(tmp_path / "a.h5") as recording:
        np.testing.assert_array_equal(recording.tap("output").time_s, times)


def test_channels_go_to_their_taps(tmp_path):
    text = "time[s],primary_in_phase[FS],rate[rad/s],true_rate[rad/s]\n0,0.5,1,2\n1,0.5,1,2\n"
    import_csv(table(tmp_path, text), tmp_path / "a.h5", options())
    with Recording.open(tmp_path / "a.h5") as recording:
        assert {name: list(tap.channels) for name, tap in recording.taps.items()} == {
            "baseband": ["primary_in_phase"], "output": ["rate"], "reference": ["true_rate"]}


finite = st.floats(-1e6, 1e6, allow_nan=False)


@settings(max_examples=40, deadline=None)
@given(
    steps=st.lists(st.floats(1e-3, 1e3), min_size=1, max_size=40),
    start=st.floats(-1e4, 1e4),
    values=st.data(),
)
def test_export_and_import_give_the_same_numbers_back(tmp_path_factory, steps, start, values):
    folder = tmp_path_factory.mktemp("csv")
    times = start + np.cumsum([0.0, *steps])
    if not (np.diff(times) > 0).all():
        return
    rate = values.draw(st.lists(finite, min_size=len(times), max_size=len(times)))
    text = "time[s],rate[rad/s]\n" + "".join(f"{t!r},{r!r}\n" for t, r in zip(times.tolist(), rate))
    import_csv(table(folder, text), folder / "a.h5", options())
    assert main(["export", str(folder / "a.h5"), "-o", str(folder / "b.csv"), "--quiet"]) == 0
    import_csv(folder / "b.csv", folder / "b.h5", options())
    with Recording.open(folder / "a.h5") as first, Recording.open(folder / "b.h5") as second:
        np.testing.assert_array_equal(first.tap("output")["rate"], rate)
        np.testing.assert_array_equal(second.tap("output")["rate"], rate)
        np.testing.assert_allclose(first.tap("output").time_s, times, atol=1e-3 * max(steps), rtol=0)


@settings(max_examples=80, deadline=None)
@given(text=st.text(alphabet="time[s],rate/deg0.5-\n\"e;\t ", max_size=80))
def test_no_text_raises_anything_but_bad_input(tmp_path_factory, text):
    path = table(tmp_path_factory.mktemp("csv"), text)
    try:
        read_csv(path, options())
    except BadInput as error:
        assert "\n" not in str(error) and "a.csv" in str(error)


HEADER = "time[s],temperature[degC],rate[rad/s]\n"
REFUSED = {
    "empty": ("", {}, "empty"),
    "blank": ("\n \n", {}, "empty"),
    "header only": (HEADER, {}, "no data rows"),
    "one row": (HEADER + "0,1,2\n", {}, "only one row"),
    "no header": ("0,1,2\n1,2,3\n", {}, "header is missing"),
    "nan": (HEADER + "0,1,2\n1,nan,3\n", {}, "line 3: column temperature is 'nan'"),
    "infinity": (HEADER + "0,1,2\n1,1,-inf\n", {}, "line 3: column rate"),
    "empty cell": (HEADER + "0,1,2\n1,,3\n", {}, "line 3: column temperature is empty"),
    "text": (HEADER + "0,1,2\n1,1,x\n", {}, "line 3: column rate is 'x'"),
    "underscores are no digits": (HEADER + "0,1,1_0\n1,1,1\n", {}, "line 2"),
    "short row": (HEADER + "0,1,2\n1,1\n", {}, "line 3: 2 cells where the header has 3"),
    "long row": (HEADER + "0,1,2,9\n1,1,1\n", {}, "line 2: 4 cells"),
    "blank line inside": (HEADER + "0,1,2\n\n1,1,1\n", {}, "line 3"),
    "unsorted": (HEADER + "0,1,2\n2,1,2\n1,1,2\n", {}, "line 4: this row goes back in time"),
    "duplicate time": (HEADER + "0,1,2\n1,1,2\n1,1,2\n", {}, "line 4: this row repeats the time"),
    "unit missing": ("time[s],rate\n0,1\n1,2\n", {}, "add --unit rate=rad/s"),
    "unit missing, name says it": ("time[s],temperature[degC],gyro_dps\n0,1,1\n1,2,1\n", {"columns": {"rate": "gyro_dps"}},
                                   "add --unit gyro_dps=deg/s"),
    "units in names only": ("t_s,temperature_degC,gyro_a\n0,1,1\n1,2,1\n", {}, "column t_s has no unit; add --unit t_s=s"),
    "empty brackets": ("time[s],rate[]\n0,1\n1,2\n", {}, "has no unit"),
    "unknown unit": ("time[s],rate[rpm]\n0,1\n1,2\n", {}, "unknown unit 'rpm'"),
    "unknown unit given": ("time[s],rate\n0,1\n1,2\n", {"unit_of": {"rate": "rpm"}}, "unknown unit 'rpm'"),
    "unit of another kind": ("time[s],rate[degC]\n0,1\n1,2\n", {}, "degC is a unit of temperature, not of rate"),
    "units disagree": ("time[s],rate[deg/s]\n0,1\n1,2\n", {"unit_of": {"rate": "rad/s"}}, "the header says deg/s"),
    "no time": ("rate[rad/s],x[s]\n0,1\n1,2\n", {}, "add --map time=COLUMN"),
    "no channel": ("time[s],x[s]\n0,1\n1,2\n", {}, "--map temperature=COLUMN"),
    "twice the same name": ("time[s],time[s]\n0,1\n1,2\n", {}, "two columns are named time"),
    "nameless column": ("time[s],[rad/s]\n0,1\n1,2\n", {}, "column 2 has no name"),
    "brackets": ("time[s],rate[rad/s\n0,1\n1,2\n", {}, "is not name[unit]"),
    "semicolons": ("time[s];rate[rad/s]\n0;1\n1;2\n", {}, "not separated by commas"),
    "semicolons after the header": ("time[s],rate[rad/s]\n0;1\n1;2\n", {}, "line 2: 1 cells where the header has 2"),
    "mapped column missing": (GOOD, {"columns": {"rate": "nope"}}, "no such column"),
    "mapped to an unknown channel": (GOOD, {"columns": {"warp": "rate"}}, "unknown channel"),
    "mapped to raw codes": (GOOD, {"columns": {"primary_adc_raw": "rate"}}, "raw codes"),
    "unit for a missing column": (GOOD, {"unit_of": {"nope": "s"}}, "no such column"),
    "too many rows dropped": (GOOD, {"drop_rows": [3]}, "there are 3 rows"),
    "all rows dropped": (GOOD, {"drop_rows": [0, 1, 2]}, "no data rows"),
    "below absolute zero": ("time[s],temp[K]\n0,1\n1,-2\n", {}, "line 3: temperature is"),
    "not text": (b"\xff\xfe\x00\x01" * 10, {}, "UTF-8"),
    "NUL": (b"time[s],rate[rad/s]\n0,\x00\n", {}, "a.csv"),
}


@pytest.mark.parametrize("text, told, message", REFUSED.values(), ids=REFUSED.keys())
def test_doubtful_tables_are_refused(tmp_path, text, told, message):
    with pytest.raises(BadInput) as caught:
        import_csv(table(tmp_path, text), tmp_path / "a.h5", options(**told))
    assert any(part in str(caught.value) for part in message.split("|")), str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]


def test_missing_file(tmp_path):
    with pytest.raises(BadInput, match="no such file"):
        read_csv(tmp_path / "none.csv", options())


# ---- the commands -------------------------------------------------------------------------------------------------------------


def test_import_info_and_export_commands(tmp_path, capsys):
    source = table(tmp_path, "t_s,temperature_degC,gyro_a\n0,20,1e-3\n1,21,2e-3\n2,23,4e-3\n")
    target = tmp_path / "r.h5"
    flags = ["--map", "time=t_s", "--map", "temperature=temperature_degC", "--map", "rate=gyro_a",
             "--unit", "t_s=s", "--unit", "temperature_degC=degC", "--unit", "gyro_a=rad/s", "--drop-rows", "0"]
    assert main(["import", str(source), "-o", str(target), "--json", *flags]) == 0
    assert json.loads(capsys.readouterr().out)["rows"] == 2
    assert main(["info", str(target), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["taps"]["output"]["samples"] == 2 and {row["channel"] for row in facts["channels"]} == {"rate", "temperature_measured"}
    assert main(["info", str(target)]) == 0
    assert "temperature_measured" in capsys.readouterr().out
    assert main(["export", str(target), "-o", str(tmp_path / "b.csv")]) == 0
    assert (tmp_path / "b.csv").read_text() == "time[s],temperature_measured[degC],rate[rad/s]\n1.0,21.0,0.002\n2.0,23.0,0.004\n"


@pytest.mark.parametrize("flags", [
    ["--map", "time"], ["--map", "=x"], ["--map", "time=a", "--map", "time=b"], ["--unit", "x="], ["--drop-rows", "a"], ["--drop-rows", "3-1"],
    ["-o", "{source}"],
])
def test_bad_flags_exit_with_2_and_write_nothing(tmp_path, capsys, flags):
    source = table(tmp_path, GOOD)
    before = source.read_bytes()
    assert main(["import", str(source), *[flag.format(source=source) for flag in flags]]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and error.startswith("wineglass: error:")
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"] and source.read_bytes() == before
