"""Every effect of the catalogue in both twins: the change that it makes in the envelope twin is the change that it makes in the sampled one, within
1 % of its own size, with the loop open and closed; and an effect of strength zero is none, to the last bit."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from both_twins import Series, both, case, envelope, full, rms
from scipy.interpolate import BSpline

from wineglass import effects, paths
from wineglass.effects import Setting, typical
from wineglass.errors import BadInput

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")

# Ramps both ways, turns to both sides, an amplitude step down and up, a test force of both phases.
FIELDS = {
    "device": "metal-fast",
    "duration_s": 34.0,
    "temperature": {"kind": "ramps", "start_degc": 25, "ramps": [
        {"duration_s": 4}, {"to_degc": 45, "speed_degc_per_min": 150}, {"to_degc": 20, "speed_degc_per_min": 150}]},
    "rate": {"kind": "table", "times_s": [0, 6, 6.5, 9, 9.5, 14, 14.5, 17, 17.5], "values_deg_s": [0, 0, 10, 10, 0, 0, -20, -20, 0]},
    "command": [
        {"at_s": 22.0, "kind": "amplitude", "set_point_fs": 0.7}, {"at_s": 26.0, "kind": "amplitude", "set_point_fs": 0.9},
        {"at_s": 29.0, "kind": "test_signal", "in_phase_fs": 0.02, "quadrature_fs": 0.01}, {"at_s": 31.0, "kind": "test_signal"}],
}
START_S = 4.0
JUMPS_S = (22.0, 26.0)  # the drive force goes to its limits: what follows within ...
SETTLED_S = 0.4  # ... is held to a weaker bound

SPECIAL = {
    "adc_nonlinearity": Setting("adc_nonlinearity", {"cubic": 1e-3, "quintic": 3e-4, "quadratic": 1e-3, "half_step_fs": 2e-4}),  # zero: a test of its own
    "ageing": Setting("ageing", {"linear_rad_s_per_h": 0.01, "logarithmic_rad_s": 1e-4, "time_constant_s": 5.0}),
    "damping_step": Setting("damping_step", {"damping": 0.02, "time_s": 12.0, "creep_s": 2.0}),
    "thermal_hysteresis": Setting("thermal_hysteresis", {"bias_rad_s": 2e-4, "half_width_degc": 3.0}),
    "thermometer_quantisation": Setting("thermometer_quantisation", {"step_degc": 0.5, "dead_band": 0.25}),
    "thermometer_lag": Setting("thermometer_lag", {"lag_s": 2.0}),
    "flicker_noise": Setting("flicker_noise", {"bias_rad_s": 1e-4}),
    "vibration": Setting("vibration", {"rate_rad_s": 0.02, "rectified_rad_s": 1e-4, "frequency_hz": 3.0}),
}
SHAPES = {
    "a loss for a while": Setting("damping_step", {"damping": 0.02, "time_s": 8.0, "creep_s": 0.5, "lasts_s": 7.0}),
    "shaken twice": Setting("vibration", {"rectified_rad_s": 1e-4, "begin_1_s": 7.03, "lasts_1_s": 4.0, "begin_2_s": 12.51, "lasts_2_s": 6.0}),
    "stretches that overlap are one": Setting("vibration", {"rectified_rad_s": 1e-4, "begin_1_s": 7.0, "lasts_1_s": 4.0, "begin_4_s": 9.0, "lasts_4_s": 6.0}),
    "a gradient that settles": Setting("thermal_gradient", {"bias_rad_s_per_degc_s": 1e-3, "settles_s": 3.0}),
    "stairs from elsewhere": Setting("thermometer_quantisation", {"step_degc": 0.5, "origin_degc": 0.17}),
}
NOISE = ("clock_jitter", "excess_noise")  # of which the envelope twin sees nothing, and no mean may
RUNNING_PHASE = ("interference",)  # a tone's phase against the oscillator after a cold start is anyone's guess: sizes are compared
JOLTS = ("dropped_samples",)  # a jump of 36 degrees, over within a frame: only the frequency's jolt is compared, and that less closely
# At f = fs/10 the ninth and eleventh harmonic of a bent sine fall back on the carrier and beat with it. Beside, they do so at some hundred
# hertz, of which means over half a second show nothing.
OFF_GRID = {"adc_nonlinearity": 4987.0, "adc_saturation": 4987.0}
BEAT_FRAMES = 25
BEATING = {("adc_saturation", "drive_frequency"), ("adc_saturation", "primary_quadrature")}  # of a clipped sine the beat is all that there is
# Readings come once per slow tick: a stair's place within a frame is known to a twentieth. Of a clipped sine a part of the beat remains.
TOLERANCE = {"thermometer_quantisation": 0.015, "adc_saturation": 0.02}
HELD = ("rate", "rate_uncompensated", "quadrature", "drive_frequency", "drive_level", "temperature_measured", "primary_quadrature")
OWN = {"open": ("secondary_in_phase", "secondary_quadrature"), "rebalance": ("rebalance_in_phase", "rebalance_quadrature")}  # that say something in this loop

IDS = [effect.id for effect in effects.catalogue()] if (paths.build_folder() / "lib").is_dir() else []


def setting(effect_id: str) -> Setting:
    return SPECIAL.get(effect_id) or typical(effect_id)


def fields(loop: str, frequency_hz: float = 5000.0) -> dict:
    compensation = "g2" if loop == "open" else "static"
    return {**FIELDS, "mode": {"loop": loop, "compensation": compensation, "output_filter_hz": 50.0},
            "override": {"resonator.frequency_hz": frequency_hz}}


@cache
def nominal(loop: str, frequency_hz: float) -> tuple[Series, Series]:
    return both(case(fields(loop, frequency_hz)), START_S)


def calm(frames: int) -> np.ndarray:
    """Frames away from the drive force's limits."""
    time_s = START_S + 0.02 * np.arange(frames)
    return np.all([(time_s < jump - 0.04) | (time_s > jump + SETTLED_S) for jump in JUMPS_S], axis=0)


def smooth(x: np.ndarray) -> np.ndarray:
    return np.convolve(x, np.full(BEAT_FRAMES, 1.0 / BEAT_FRAMES), mode="same")


@pytest.mark.parametrize("loop", ["open", "rebalance"])
@pytest.mark.parametrize("effect_id", [effect_id for effect_id in IDS if effect_id not in NOISE + RUNNING_PHASE + JOLTS])
def test_both_twins_show_the_same_effect(effect_id, loop):
    frequency_hz = OFF_GRID.get(effect_id, 5000.0)
    fast0, slow0 = nominal(loop, frequency_hz)
    fast, slow = both(case(fields(loop, frequency_hz), [setting(effect_id)]), START_S)
    n = min(len(fast["rate"]), len(fast0["rate"]))  # lost samples are missing at the end
    kept = calm(n)
    tolerance = TOLERANCE.get(effect_id, 0.01)
    for name in HELD + OWN[loop]:
        if (effect_id, name) in BEATING:
            continue
        true, found, plain = slow[name][:n] - slow0[name][:n], fast[name][:n] - fast0[name][:n], (fast0[name] - slow0[name])[:n]
        if effect_id in OFF_GRID:
            found = true + smooth(found - true)
        floor = 2.0 * rms(plain[kept])  # of the envelope twin without any effect
        assert rms((found - true)[kept]) <= tolerance * rms(true[kept]) + floor, name
        assert rms(found - true) <= 0.02 * rms(true) + 2.0 * rms(plain), f"{name}, jumps included"


@pytest.mark.parametrize("loop", ["open", "rebalance"])
@pytest.mark.parametrize(("name", "size_fs"), [("sign_step_fs", 2e-4), ("teeth_fs", 1e-5)])
def test_a_jump_at_zero_is_seen_through_the_converters_noise(name, size_fs, loop):
    """A secondary held at zero lies within the jump: its gain is the step's density under the noise, which the envelope joins to a large sine's."""
    noisy = {**fields(loop, OFF_GRID["adc_nonlinearity"])}
    noisy["override"] = {**noisy["override"], "electronics.adc.snr_db": 80.0}
    fast, slow = both(case(noisy, [Setting("adc_nonlinearity", {name: size_fs})]), START_S)
    fast0, slow0 = both(case(noisy), START_S)
    kept = calm(len(fast["rate"]))
    for channel in ("drive_level", "rate", "quadrature", *OWN[loop]):
        true, found = smooth(slow[channel] - slow0[channel])[kept], smooth(fast[channel] - fast0[channel])[kept]
        plain = smooth(fast0[channel] - slow0[channel])[kept]
        assert rms(found - true) <= 0.05 * rms(true) + 0.5 * rms(plain), channel


@pytest.mark.parametrize("size_fs", [3e-4, -3e-4])
def test_a_jump_that_noise_does_not_blur_leaves_the_loop_standing(size_fs):
    """The secondary's gain is many times the usual within the jump, or the opposite: the sampled loop chatters, and neither twin runs away."""
    plain = {**fields("rebalance", OFF_GRID["adc_nonlinearity"])}
    plain["override"] = {**plain["override"], "electronics.adc.snr_db": 95.0}
    fast, slow = both(case(plain, [Setting("adc_nonlinearity", {"sign_step_fs": size_fs})]), START_S)
    fast0, slow0 = both(case(plain), START_S)
    kept = calm(len(fast["rate"]))
    true, found = (smooth(one["drive_level"] - other["drive_level"])[kept] for one, other in ((slow, slow0), (fast, fast0)))
    assert rms(found - true) <= 0.05 * rms(true)
    assert rms((fast["secondary_in_phase"] - fast0["secondary_in_phase"])[kept]) < 1e-4 * rms(slow["primary_in_phase"][kept])


@pytest.mark.parametrize("loop", ["open", "rebalance"])
@pytest.mark.parametrize("name", SHAPES)
def test_both_twins_show_the_same_in_other_shapes(name, loop):
    fast0, slow0 = nominal(loop, 5000.0)
    fast, slow = both(case(fields(loop), [SHAPES[name]]), START_S)
    kept = calm(len(fast["rate"]))
    for channel in HELD + OWN[loop]:
        true, found, plain = (slow[channel] - slow0[channel])[kept], (fast[channel] - fast0[channel])[kept], (fast0[channel] - slow0[channel])[kept]
        assert rms(found - true) <= TOLERANCE.get(SHAPES[name].id, 0.01) * rms(true) + 2.0 * rms(plain), channel


def test_a_bias_while_the_base_shakes_is_there_for_so_long():
    quiet, shaken = (both(case(fields("rebalance"), settings), START_S)[1] for settings in ([], [SHAPES["shaken twice"]]))
    change = shaken["rate"] - quiet["rate"]
    assert np.sum(change) * 0.02 == pytest.approx(1e-4 * (4.0 + 6.0), rel=0.02)
    time_s = START_S + 0.02 * np.arange(len(change))
    assert np.max(np.abs(change[(time_s < 7.0) | (time_s > 19.0)])) < 2e-6


def bent(effect_id: str) -> Setting:
    """The effect with every form of its law: a curve that swings from one control point to the next, everything else at its typical size."""
    forms = {p.name: p.typical for p in effects.find(effect_id).parameters if p.form}
    swing = {name: value * (1.0, 3.0, -2.0)[i % 3] for i, (name, value) in enumerate((n, v) for n, v in forms.items() if n.startswith("curve_"))}
    return Setting(effect_id, {**setting(effect_id).values, **forms, **swing})


@pytest.mark.parametrize("loop", ["open", "rebalance"])
@pytest.mark.parametrize("effect_id", [effect_id for effect_id in IDS if any(p.form for p in effects.find(effect_id).parameters)])
def test_both_twins_show_the_same_bent_law(effect_id, loop):
    """Held is what the forms change, beside the law as it is stated."""
    fast0, slow0 = both(case(fields(loop), [setting(effect_id)]), START_S)
    fast, slow = both(case(fields(loop), [bent(effect_id)]), START_S)
    kept = calm(len(fast["rate"]))
    for name in HELD + OWN[loop]:
        true, found, plain = (slow[name] - slow0[name])[kept], (fast[name] - fast0[name])[kept], (fast0[name] - slow0[name])[kept]
        assert rms(found - true) <= 0.01 * rms(true) + 2.0 * rms(plain), name


def test_a_curve_is_the_cubic_spline_of_its_control_points():
    knots = {p.name: p for p in effects.find("thermometer_error").parameters if p.form}
    points = np.random.default_rng(5).standard_normal(len(knots))
    at_degc = -50.0 + 10.0 * np.arange(len(knots))
    spline = BSpline(np.arange(-70.0, 141.0, 10.0), points, 3)  # four knots further than points, half of them on either side
    run = {**fields("open"), "temperature": {"kind": "ramps", "start_degc": -20, "ramps": [{"duration_s": 4}, {"to_degc": 70, "speed_degc_per_min": 200}]}}
    curved = Setting("thermometer_error", dict(zip(knots, points, strict=True)))
    degc, read = (envelope(case(run, chosen))["temperature_measured"] for chosen in ([], [curved]))
    assert at_degc[0] < degc.min() < -15.0 and 60.0 < degc.max() < at_degc[-1]
    assert read - degc == pytest.approx(spline(degc), abs=2e-3)


@pytest.mark.parametrize("loop", ["open", "rebalance"])
@pytest.mark.parametrize("doubled", [0.0, 1.0])
def test_lost_and_doubled_samples_jolt_the_frequency_alike(doubled, loop):
    fast0, slow0 = nominal(loop, 5000.0)
    fast, slow = both(case(fields(loop), [Setting("dropped_samples", {"distance_samples": 100_000, "doubled": doubled})]), START_S)
    n = min(len(fast["rate"]), len(fast0["rate"]))
    true, found = (series["drive_frequency"][:n] - plain["drive_frequency"][:n] for series, plain in ((slow, slow0), (fast, fast0)))
    assert np.sign(true[np.argmax(np.abs(true))]) == (1.0 if doubled == 0.0 else -1.0)
    assert rms(found - true) <= 0.06 * rms(true)


@pytest.mark.parametrize("distance", [0.3, 1.0])
def test_losses_closer_than_every_other_sample_are_every_other_sample(distance):
    runs = [both(case(fields("open"), [Setting("dropped_samples", {"distance_samples": d})]), START_S) for d in (distance, 2.0)]
    for close, every_other in zip(*runs, strict=True):
        assert np.array_equal(close["drive_frequency"], every_other["drive_frequency"], equal_nan=True)


@pytest.mark.parametrize("loop", ["open", "rebalance"])
@pytest.mark.parametrize("effect_id", RUNNING_PHASE)
def test_lines_have_the_same_size_in_both_twins(effect_id, loop):
    fast0, slow0 = nominal(loop, 5000.0)
    fast, slow = both(case(fields(loop), [setting(effect_id)]), START_S)
    kept = calm(len(fast["rate"]))
    for name in ("rate", "quadrature"):
        assert rms((fast[name] - fast0[name])[kept]) == pytest.approx(rms((slow[name] - slow0[name])[kept]), rel=0.02), name


@pytest.mark.parametrize("loop", ["open", "rebalance"])
@pytest.mark.parametrize("effect_id", NOISE)
def test_noise_moves_no_mean(effect_id, loop):
    _, slow0 = nominal(loop, 5000.0)
    case_ = case(fields(loop), [setting(effect_id)])
    fast, slow = both(case_, START_S)
    assert rms(fast["rate"] - nominal(loop, 5000.0)[0]["rate"]) == 0.0
    for name in ("rate", "drive_frequency", "drive_level"):
        noise = (slow[name] - slow0[name])[calm(len(slow[name]))]
        assert rms(noise) > 0.0
        assert abs(noise.mean()) <= 5.0 * rms(noise) / np.sqrt(len(noise)), name


def test_every_effect_is_seen_in_some_channel():
    fast0, _ = nominal("open", 5000.0)
    for effect_id in IDS:
        if effect_id not in NOISE:
            fast = envelope(case(fields("open"), [setting(effect_id)]))
            first = len(fast["rate"]) - len(fast0["rate"])
            assert any(rms(fast[name][first:] - fast0[name]) > 0.0 for name in fast0), effect_id


def strengthless(effect_id: str) -> Setting:
    """All strengths and forms zero, all shapes at the upper end of their range."""
    record = effects.find(effect_id)
    return Setting(effect_id, {p.name: 0.0 if p.strength or p.form else p.high for p in record.parameters})


def test_strength_zero_is_absent_to_the_last_bit():
    from wineglass.twin import Twin

    run = case({**fields("rebalance"), "duration_s": 1.0, "command": []}).run
    chosen = [strengthless(effect_id) for effect_id in IDS]

    def trace(settings: list[Setting]) -> tuple[bytes, bytes]:
        with Twin(run, effects=settings, codes=True) as twin:
            return twin.step(1000).codes.tobytes(), twin.telemetry()

    assert trace(chosen) == trace([])
    without, with_ = envelope(case(fields("rebalance"))), envelope(case(fields("rebalance"), chosen))
    assert all(np.array_equal(without[name], with_[name]) for name in without)


def test_effects_act_together():
    pair = [typical("frequency_split"), typical("drive_misalignment")]
    fast0, slow0 = nominal("open", 5000.0)
    fast, slow = both(case(fields("open"), pair), START_S)
    kept = calm(len(fast["rate"]))
    for name in ("rate", "quadrature", "drive_frequency"):
        true, found = (slow[name] - slow0[name])[kept], (fast[name] - fast0[name])[kept]
        assert rms(found - true) <= 0.01 * rms(true) + 2.0 * rms((fast0[name] - slow0[name])[kept]), name


def test_same_seed_same_wander_other_seed_another():
    def rate(seed: int) -> np.ndarray:
        return envelope(case({**fields("rebalance"), "seed": seed}, [setting("flicker_noise")]))["rate"]

    assert np.array_equal(rate(3), rate(3)) and not np.array_equal(rate(3), rate(4))


# ---- the records ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("effect_id", IDS)
def test_records_are_complete(effect_id):
    record = effects.find(effect_id)
    assert record.equation and record.appearance and any(p.strength for p in record.parameters)
    for parameter in record.parameters:
        assert parameter.name and parameter.unit and len(parameter.source) > 5
        assert parameter.low < parameter.high and parameter.low <= parameter.usual <= parameter.high
        assert parameter.strength is False or (parameter.usual == 0.0 and parameter.typical > 0.0)
        assert max(abs(parameter.low), abs(parameter.high)) >= parameter.typical


@pytest.mark.parametrize("wrong, part", [
    (Setting("no_such_effect"), "no effect 'no_such_effect'"),
    (Setting("frequency_split", {"splits_hz": 1.0}), "no parameter 'splits_hz'"),
    (Setting("frequency_split", {"split_hz": 1e3}), "stay within"),
    (Setting("frequency_split", {"split_hz": float("nan")}), "stay within"),
])
def test_wrong_settings_are_refused(wrong, part):
    with pytest.raises(BadInput, match=part):
        effects.settings([wrong])


def test_too_many_effects_are_refused_by_both_twins():
    many = [typical("frequency_split")] * 17
    with pytest.raises(BadInput, match="effects"):
        envelope(case(fields("open"), many))
    with pytest.raises(BadInput, match="effects"):
        full(case(fields("open"), many))


def test_stairs_with_a_dead_band_hold_on_to_their_code():
    """Codes of a comparator, by definition: a code goes up or down when the temperature is a quarter of a step beyond the border to the next one."""
    step, band, reference_degc = 0.5, 0.25, 25.0
    stairs = Setting("thermometer_quantisation", {"step_degc": step, "dead_band": band})
    ramps = {**fields("open"), "duration_s": 14.0, "command": []}
    degc, shown = (full(case(ramps, chosen, frame_ticks=1))["temperature_measured"] for chosen in ((), [stairs]))
    code, expected = round((degc[0] - reference_degc) / step), []
    for value in (degc - reference_degc) / step:
        code = int(np.floor(value + 0.5 - band)) if value > code + 0.5 + band else int(np.ceil(value - 0.5 + band)) if value < code - 0.5 - band else code
        expected.append(reference_degc + step * code)
    assert np.ptp(degc) > 15.0 and np.max(np.diff(degc)) > 0.0 > np.min(np.diff(degc))
    assert np.mean(np.abs(shown - expected) < 1e-3) > 0.999  # but for readings that the rounding of telemetry puts on the other side of a border


@pytest.mark.parametrize("loop", ["open", "rebalance"])
def test_another_frequency_over_temperature_is_another_slope_in_the_description(loop):
    """Split, quadrature and Q stay, so that a tolerance and the effect cannot be told apart: of shells whose described frequency does not move."""
    plain = case({**fields(loop), "override": {"resonator.frequency_slope_ppm_per_degc": 0.0, "resonator.frequency_curvature_ppm_per_degc2": 0.0,
                                               "resonator.split_hz": 0.05, "resonator.quadrature_rad_s": 2e-3}})
    steeper = plain.run.truth.override({"resonator.frequency_slope_ppm_per_degc": 5.0, "resonator.frequency_curvature_ppm_per_degc2": 0.03})
    nominal, described = envelope(plain), envelope(replace(plain, run=replace(plain.run, truth=steeper)))
    acting = envelope(replace(plain, effects=(Setting("frequency_temperature", {"slope_ppm_per_degc": 5.0, "curvature_ppm_per_degc2": 0.03}),)))
    for name in HELD + OWN[loop]:
        assert rms(acting[name] - described[name]) <= 1e-3 * rms(described[name] - nominal[name]) + 1e-12, name


@pytest.mark.parametrize("loop", ["open", "rebalance"])
def test_steps_of_the_drive_leak_through_a_capacitance_in_both_twins(loop):
    """By itself, and a quarter of a turn from what leaks through a resistance: a step is that of the force's sine over a sample."""
    fast0, slow0 = nominal(loop, 5000.0)
    fast, slow = both(case(fields(loop), [Setting("drive_feedthrough", {"edge": 1e-3})]), START_S)
    kept = calm(len(fast["rate"]))
    for name in OWN[loop]:
        true, found, plain = (slow[name] - slow0[name])[kept], (fast[name] - fast0[name])[kept], (fast0[name] - slow0[name])[kept]
        assert rms(true) > 10.0 * rms(plain)
        assert rms(found - true) <= 0.01 * rms(true) + 2.0 * rms(plain), name
