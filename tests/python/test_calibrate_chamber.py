"""The chamber sweep, where its file is at hand: figures known from float64, and the firmware's fixed-point polynomial against them."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from wineglass import firmware_polynomial
from wineglass.cli import main
from wineglass.errors import BadInput
from wineglass.paths import repository_root

FILE = Path(os.environ.get("WINEGLASS_CHAMBER_CSV", repository_root() / "../shared/data/imu_chamber/static_sweep.csv"))
needs_file = pytest.mark.skipif(not FILE.is_file(), reason="set WINEGLASS_CHAMBER_CSV to the chamber sweep's file")

KNOWN = {  # rad/s, numpy.polyfit in float64
    ("gyro_a", "in sample"): 4.14e-3,
    ("gyro_a", "interleaved"): 4.14e-3,
    ("gyro_a", "after the maximum held out"): 9.48e-3,
    ("gyro_b", "after the maximum held out"): 2.84e-3,
}


@needs_file
def test_residuals_are_the_known_ones(tmp_path, capsys):
    picture = tmp_path / "chamber.png"
    assert main(["chamber", str(FILE), "--json", "--plot", str(picture)]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["rows"] == 8398 and picture.read_bytes().startswith(b"\x89PNG")
    found = {(axis["axis"], split["name"]): split for axis in result["axes"] for split in axis["residuals"]}
    for key, known in KNOWN.items():
        assert found[key]["float64_rad_s"] == pytest.approx(known, abs=0.005e-3)
    for split in found.values():
        assert split["firmware_rad_s"] == pytest.approx(split["float64_rad_s"], rel=1e-3)


@needs_file
def test_import_then_calibrate(tmp_path, capsys):
    flags = ["--map", "time=t_s", "--map", "temperature=temperature_degC", "--map", "rate=gyro_a",
             "--unit", "t_s=s", "--unit", "temperature_degC=degC", "--unit", "gyro_a=rad/s", "--drop-rows", "0,1"]
    assert main(["import", str(FILE), "-o", str(tmp_path / "a.h5"), "-q", *flags]) == 0
    assert main(["calibrate", str(tmp_path / "a.h5"), "--order", "3", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["residual_rms"] == pytest.approx(4.14e-3, abs=0.005e-3)
    assert result["after_temperature_maximum"]["held_out_rms"] == pytest.approx(9.48e-3, abs=0.005e-3)
    assert [b["kind"] for b in result["order_choice"]["held_out_branches"]] == ["cooling", "heating", "cooling"]


@needs_file
@pytest.mark.parametrize("column", ["t_s", "temperature_degC", "gyro_b"])
def test_columns_without_unit_are_refused_with_the_flag_to_add(column, capsys, tmp_path):
    unit = {"t_s": "s", "temperature_degC": "degC", "gyro_b": "rad/s"}
    flags = [word for name in unit if name != column for word in ("--unit", f"{name}={unit[name]}")]
    maps = ["--map", "time=t_s", "--map", "temperature=temperature_degC", "--map", "rate=gyro_b"]
    assert main(["import", str(FILE), "-o", str(tmp_path / "a.h5"), *maps, *flags]) == 2
    assert f"column {column} has no unit; add --unit {column}={unit[column]}" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_fixed_point_polynomial_agrees_with_float64():
    """Orders 0 to 5 over the whole span: at most 2 units of Q31 per order (rounding of coefficients and of each Horner step)."""
    rng = np.random.default_rng(8)
    shift = np.concatenate([rng.uniform(-127.9, 127.9, 2000), [-127.9, 0.0, 127.9]])
    for order in range(6):
        coefficients = rng.uniform(-1, 1, order + 1) * 0.15 / 128.0 ** np.arange(order + 1)
        exact = np.polynomial.polynomial.polyval(np.round(shift * 2**20) / 2**20, coefficients)
        found = firmware_polynomial.bias_rad_s(coefficients, shift)
        assert np.max(np.abs(found - exact)) <= 2 * (order + 1) / 2**31


@pytest.mark.parametrize("coefficients, shift", [
    (np.zeros(7), np.zeros(1)), (np.array([2.0]), np.zeros(1)), (np.array([0.0, 1.0]), np.zeros(1)), (np.zeros(1), np.array([128.0])),
    (np.array([0.9, 0.9 / 128]), np.array([100.0])),
])
def test_what_the_firmware_cannot_hold_is_refused(coefficients, shift):
    with pytest.raises(BadInput):
        firmware_polynomial.bias_rad_s(coefficients, shift)
