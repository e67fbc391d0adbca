"""Calibration in SI, JSON and binary: round trips, the golden vector, refusals in one line, agreement with the firmware's parser."""

import json
import math
import struct
import sys
import zlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wineglass import calibration_block as cb
from wineglass.errors import BadInput

ROOT = Path(__file__).resolve().parents[2]
GOLDEN_JSON = ROOT / "tests/golden/calibration_block.json"
GOLDEN_HEX = ROOT / "tests/golden/calibration_block.hex"


@pytest.fixture
def golden():
    return cb.read_json(GOLDEN_JSON)


def firmware_reason(block, sample_rate_hz=50000.0):
    """What the firmware's parser says about a block."""
    from wineglass.native import ffi, library

    cfg = ffi.new("struct wg_device_cfg *", {"sample_rate_millihz": round(sample_rate_hz * 1000), "adc_bits": 16, "dac_bits": 16})
    return library().wg_calibration_check(cfg, block, len(block))


def test_golden_vector(golden):
    assert cb.to_binary(golden) == bytes.fromhex(GOLDEN_HEX.read_text())


def test_golden_vector_is_accepted_by_the_firmware():
    assert firmware_reason(bytes.fromhex(GOLDEN_HEX.read_text())) == 0


def test_size_is_the_firmware_s():
    from wineglass.native import library

    assert cb.SIZE == library().wg_calibration_size()


def test_compiled_in_block_is_the_generated_one():
    sys.path.insert(0, str(ROOT / "tools/tables"))
    import default_calibration

    source = (ROOT / "firmware/application/calibration_default.c").read_text()
    numbers = [int(word.strip(" ,"), 16) for line in source.splitlines() if line.startswith("    0x") for word in line.split()]
    assert bytes(numbers) == cb.to_binary(default_calibration.default())


def test_json_comes_back_exactly(golden):
    assert cb.from_json(cb.to_json(golden)) == golden


def test_every_json_field_has_a_value_and_a_unit(golden):
    document = json.loads(cb.to_json(golden))
    for name in cb.Calibration.model_fields:
        assert document[name].keys() == {"value", "unit"}
    assert document["nominal_frequency_hz"] == {"value": 5003.25, "unit": "Hz"}


def test_binary_comes_back_within_half_a_unit(golden):
    """Independent of the conversion back: the integers are the SI values times their scale, to half a unit."""
    n = cb.unpack(cb.to_binary(golden))
    period, tick = 1 / 50000.0, 10 / 50000.0
    expected = {
        "bias_rad_s_1": -4.631e-5 * 128 * 2**31, "decay_rate_per_s_0": 1.6 * 2**22, "scale_rad_s_per_ratio_2": 6e-6 * 128**2 * 2**28,
        "angular_gain_q24": 1.6 * 2**24, "coupling_gain_q44": 1.6 * 1.25 * period * 2**44, "sample_period_q46": period * 2**46,
        "pll_proportional_q32": 250.0 * period * 2**32, "pll_integral_q32": 32000.0 * period * tick * 2**32,
        "agc_proportional_q16": 11.0 * 2**16, "agc_integral_q24": 90.0 * tick * 2**24, "amplitude_q30": 0.9 * 2**30,
        "rebalance_integral_q24": 900.0 * tick * 2**24, "phase_limit_i32": 0.5 / 360 * 2**32, "normalise_q31": 0.04 * 2**31,
        "center_2cos_q40": 2 * math.cos(2 * math.pi * 5003.25 * period) * 2**40,
    }
    for name, value in expected.items():
        assert abs(n[name] - value) <= 0.5 + 1e-4, name
    assert abs(n["center_freq_u64"] / 2**64 - 5003.25 * period) < 1e-16


def test_binary_to_si_to_binary_is_the_same_block(golden):
    block = cb.to_binary(golden)
    assert cb.to_binary(cb.from_binary(block)) == block


FINITE = {"allow_nan": False, "allow_infinity": False}


@settings(max_examples=150, deadline=None)
@given(
    frequency=st.floats(4950.0, 5050.0, **FINITE), rate=st.floats(49990.0, 50010.0, **FINITE), gain=st.floats(0.1, 4.0, **FINITE),
    ratio=st.floats(0.5, 1.5, **FINITE), reference=st.floats(-50.0, 80.0, **FINITE), lsb=st.floats(1e-6, 0.03, **FINITE),
    bias=st.lists(st.floats(-1e-3, 1e-3, **FINITE).map(lambda v: v / 100), min_size=1, max_size=6),
    kp=st.floats(1.0, 500.0, **FINITE), ki=st.floats(0.0, 1e5, **FINITE), amplitude=st.floats(0.05, 0.95, **FINITE),
    limit=st.floats(1e-4, 0.4, **FINITE), delay=st.floats(0.0, 63.9, **FINITE), decimation=st.integers(8, 32),
    code=st.integers(-(2**31), 2**31 - 1),
)
def test_round_trip_of_any_calibration(frequency, rate, gain, ratio, reference, lsb, bias, kp, ki, amplitude, limit, delay,
                                       decimation, code):
    golden = cb.read_json(GOLDEN_JSON)
    tick = decimation / rate
    calibration = golden.with_changes(
        nominal_frequency_hz=frequency, sample_rate_hz=rate, angular_gain=gain, pickoff_gain_ratio=ratio,
        reference_temperature_degc=reference, temperature_min_degc=reference - 40.0, temperature_max_degc=reference + 60.0,
        thermometer_degc_per_lsb=lsb, bias_rad_s=[c / 128**i * 100 for i, c in enumerate(bias)], pll_kp_per_s=kp, pll_ki_per_s2=ki,
        amplitude_set_point_fs=amplitude, lock_amplitude_limit=limit, loop_delay_samples=delay, decimation=decimation,
        thermometer_code_at_reference=code, chirp_s=512 * tick, listen_s=512 * tick, settle_s=20 * tick, lock_hold_s=500 * tick,
        rebalance_kp=0.5 * golden.rebalance_kp, rebalance_ki_per_s=10.0)  # sound for every gain and delay above
    block = cb.to_binary(calibration)
    assert firmware_reason(block, cb.unpack(block)["sample_rate_millihz"] / 1000) == 0
    assert cb.to_binary(cb.from_binary(block)) == block


def refused(call, *words):
    with pytest.raises(BadInput) as caught:
        call()
    line = str(caught.value)
    assert "\n" not in line
    for word in words:
        assert word in line, line


@pytest.mark.parametrize(("changes", "words"), [
    ({"bias_rad_s": [1.0]}, ["bias_rad_s", "coefficient 0"]),
    ({"bias_rad_s": [0.0, 0.0, 1e-4]}, ["bias_rad_s", "coefficient 2"]),
    ({"scale_rad_s_per_ratio": [9.0]}, ["scale_rad_s_per_ratio"]),
    ({"decay_rate_per_s": [1.0, 5.0]}, ["decay_rate_per_s", "coefficient 1"]),
    ({"chirp_s": 0.15}, ["chirp_s", "2^n", "0.2048"]),
    ({"settle_s": 1e-9}, ["settle_ticks"]),
    ({"pll_kp_per_s": 1e5}, ["pll_proportional_q32"]),
    ({"pll_kp_per_s": 1e-9}, ["pll_proportional_q32"]),
    ({"agc_ki_per_s": 1e6}, ["agc_integral_q24"]),
    ({"temperature_min_degc": -110.0}, ["shift_min_q20"]),
    ({"pickoff_gain_ratio": 1000.0, "rebalance_kp": 0.0}, ["coupling_gain_q44"]),
    ({"lock_hold_s": 1e4}, ["hold_ticks"]),
])
def test_what_does_not_fit_is_refused_by_name(golden, changes, words):
    refused(lambda: cb.to_binary(golden.with_changes(**changes)), *words)


@pytest.mark.parametrize(("changes", "words"), [
    ({"device_name": "a name that is too long"}, ["device_name", "16"]),
    ({"device_name": "Kreisel ü"}, ["device_name"]),
    ({"bias_rad_s": []}, ["bias_rad_s", "1 to 6"]),
    ({"bias_rad_s": [0.0] * 7}, ["bias_rad_s", "1 to 6"]),
    ({"bias_rad_s": [math.nan]}, ["bias_rad_s"]),
    ({"decimation": 7}, ["decimation"]),
    ({"decimation": 33}, ["decimation"]),
    ({"angular_gain": 0.0}, ["angular_gain"]),
    ({"thermometer_degc_per_lsb": 0.05}, ["thermometer_degc_per_lsb"]),
    ({"temperature_max_degc": -50.0}, ["temperature_min_degc"]),
    ({"search_min_hz": 5100.0}, ["search_min_hz"]),
    ({"search_max_hz": 20000.0}, ["third of the sample rate"]),
    ({"compensation": "magic"}, ["compensation"]),
    ({"output_filter": "0.2"}, ["output_filter"]),
    ({"amplitude_set_point_fs": 0.99}, ["amplitude_set_point_fs"]),
    ({"rebalance_in_phase_limit_fs": 0.8, "rebalance_quadrature_limit_fs": 0.8}, ["squares"]),
    ({"loop": "rebalance", "rebalance_kp": 0.0}, ["rebalance_kp"]),
    ({"colour": "blue"}, ["unknown key", "colour"]),
])
def test_impossible_values_are_refused_by_name(golden, changes, words):
    refused(lambda: golden.with_changes(**changes), *words)


def test_json_refusals(golden, tmp_path):
    document = json.loads(cb.to_json(golden))

    def text(**changes):
        return json.dumps(document | changes)

    refused(lambda: cb.from_json("{"), "no JSON", "line 1")
    refused(lambda: cb.from_json("[]"), "no calibration")
    refused(lambda: cb.from_json(text(format="other")), "no calibration")
    refused(lambda: cb.from_json(text(version=2)), "version 2")
    refused(lambda: cb.from_json(text(angular_gain=1.6)), "angular_gain", "value with a unit")
    refused(lambda: cb.from_json(text(nominal_frequency_hz={"value": 5.0, "unit": "kHz"})), "nominal_frequency_hz", "kHz", "Hz")
    refused(lambda: cb.from_json(text(colour={"value": 1, "unit": ""})), "colour")
    del document["angular_gain"]
    refused(lambda: cb.from_json(text()), "angular_gain", "missing")
    refused(lambda: cb.read_json(tmp_path / "none.json"), "none.json", "cannot read")
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    refused(lambda: cb.read_json(tmp_path / "binary.json"), "no text")


def resealed(block, offset, data):
    body = block[:offset] + data + block[offset + len(data):-4]
    return body + struct.pack("<I", zlib.crc32(body))


def test_binary_refusals_are_those_of_the_firmware(golden):
    block = cb.to_binary(golden)
    cases = [
        (block[:-1], "bytes instead of", 16), (resealed(block, 0, b"XXXX"), "no calibration block", 17),
        (resealed(block, 4, b"\x09\x00"), "version 9", 18), (block[:50] + bytes([block[50] ^ 1]) + block[51:], "CRC", 19),
        (resealed(block, 380, struct.pack("<I", 9)), "compensation", 20), (resealed(block, 76, struct.pack("<I", 6)), "order", 20),
    ]
    for damaged, words, reason in cases:
        refused(lambda damaged=damaged: cb.from_binary(damaged), words)
        assert firmware_reason(damaged) == reason
    assert firmware_reason(block, 48000.0) == 22


def test_output_filter_by_corner_frequency():
    assert cb.output_filter_at(50.0, 1000.0) == "0.05"
    assert cb.output_filter_at(0.0, 1000.0) == "none"
    refused(lambda: cb.output_filter_at(60.0, 1000.0), "60 Hz", "10, 25, 50, 100 Hz")
