"""Calibrate on synthetic recordings: lag, branches, order, scale factor, and refusals. The plant is integrated here, by another method."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wineglass import calibration_block
from wineglass.calibration.branches import find_branches
from wineglass.calibration.identify import Settings, identify
from wineglass.calibration.lag import Lag
from wineglass.calibration.observations import Observations
from wineglass.cli import main
from wineglass.recording import Recording, RecordingMeta, RecordingWriter, TapFormat, float_format

ALPHA = np.array([1.0792e-3, -4.631e-5, 7.7044e-7, -5.8598e-9])
T0 = 25.0


def bias(temperature, alpha=ALPHA):
    return sum(a * (temperature - T0) ** i for i, a in enumerate(alpha))


def sweep(count=2400, low=-35.0, high=75.0, cycles=1.5):
    """Triangle over temperature: cooling first, `cycles` full swings."""
    phase = (np.arange(count) / count * cycles + 0.25) % 1.0
    return low + (high - low) * np.abs(2.0 * phase - 1.0)


def observations(count=2400, sigma=2e-5, seed=0, temperature=None, alpha=ALPHA, step_s=0.5, **changes):
    rng = np.random.default_rng(seed)
    temperature = sweep(count) if temperature is None else temperature
    data = Observations("rate_uncompensated", False, np.arange(len(temperature)) * step_s, temperature,
                        bias(temperature, alpha) + sigma * rng.standard_normal(len(temperature)), None, np.ones(len(temperature), bool))
    return replace(data, **changes)


# ---- the lag ----------------------------------------------------------------------------------------------------------------


def test_lag_agrees_with_an_ode_solver():
    """Piecewise straight input at uneven times, time constant that changes: scipy's RK45 with tight tolerance as reference."""
    rng = np.random.default_rng(1)
    time_s = np.cumsum(rng.uniform(0.05, 0.4, 60))
    u = rng.standard_normal(60).cumsum()
    tau = 0.7
    solved = solve_ivp(lambda t, y: (np.interp(t, time_s, u) - y) / tau, (time_s[0], time_s[-1]), [u[0]], t_eval=time_s, rtol=1e-10,
                       atol=1e-12, max_step=0.02)
    np.testing.assert_allclose(Lag(time_s, np.full(60, tau))(u), solved.y[0], atol=1e-7)


def test_lag_of_a_ramp_is_its_time_constant():
    """Settled, the answer to a ramp is the ramp tau + delay earlier (closed form)."""
    time_s = np.arange(0, 60, 0.1)
    out = Lag(time_s, np.full(len(time_s), 2.0), delay_s=0.37)(np.column_stack([time_s, 3.0 * time_s]))
    np.testing.assert_allclose(out[-1], [time_s[-1] - 2.37, 3.0 * (time_s[-1] - 2.37)], rtol=1e-9)


def test_no_lag_changes_nothing():
    u = np.random.default_rng(2).standard_normal((50, 3))
    np.testing.assert_array_equal(Lag(np.arange(50.0), np.zeros(50))(u), u)


def test_a_ramp_with_lag_does_not_bias_the_fit():
    """Silica-like: 46 s of lag, the shell swept at 0.1 degC/s. Without the lag in the model the coefficients are wrong."""
    tau = 46.0
    data = observations(count=4800, sigma=0.0)
    true = bias(data.temperature_degc)
    solved = solve_ivp(lambda t, y: (np.interp(t, data.time_s, true) - y) / tau, (0, data.time_s[-1]), [true[0]], t_eval=data.time_s,
                       rtol=1e-8, atol=1e-14, max_step=2.0)
    measured = solved.y[0] + 1e-6 * np.random.default_rng(3).standard_normal(len(true))
    data = replace(data, measured=measured)
    settings = Settings(order=3, tau_s=lambda temperature: np.full(len(temperature), tau))
    with_lag, without = identify(data, settings), identify(data, Settings(order=3))
    # the intervals; Legendre order 3 of a lagged triangle is not exactly in the model's first samples, hence the factor
    assert np.all(np.abs(with_lag.bias_rad_s - ALPHA) < 2.0 * with_lag.bias_half_width_rad_s)
    assert np.any(np.abs(without.bias_rad_s - ALPHA) > 20.0 * with_lag.bias_half_width_rad_s)
    assert with_lag.residual_rms < 2e-6 < without.residual_rms


# ---- branches ---------------------------------------------------------------------------------------------------------------


def kinds(temperature):
    return [(b.kind, b.start, b.stop) for b in find_branches(np.asarray(temperature, float))]


def test_branches_of_a_triangle():
    rng = np.random.default_rng(4)
    temperature = np.interp(np.arange(3001), [0, 1000, 2000, 3000], [20, -30, 60, 10]) + 0.2 * rng.standard_normal(3001)
    found = kinds(temperature)
    assert [kind for kind, _, _ in found] == ["cooling", "heating", "cooling"]
    assert found[0][1] == 0 and found[-1][2] == 3001
    for (_, _, stop), (_, start, _), turn in zip(found, found[1:], (1000, 2000)):
        assert stop == start and abs(stop - turn) < 30


def test_a_dwell_belongs_to_the_branch_before_it():
    temperature = np.interp(np.arange(2000), [0, 500, 1200, 1999], [0, 50, 50, 0])
    (first, _, turn), (second, _, stop) = kinds(temperature)
    assert (first, second, stop) == ("heating", "cooling", 2000) and 1190 <= turn <= 1230


@pytest.mark.parametrize("temperature, count", [(np.full(100, 20.0), 1), (np.linspace(0, 50, 100), 1), ([1.0, 2.0, 3.0], 1)])
def test_one_branch(temperature, count):
    assert len(kinds(temperature)) == count


# ---- the order --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [0, 1, 2, 3, 4])
def test_the_order_is_found(order):
    """Polynomials whose highest term is 30 times the noise of a block; the choice may be higher in a few of 12 seeds, never lower."""
    alpha = np.array([1e-3, -4e-5, 8e-7, -2e-8, 4e-10])[: order + 1]
    chosen = [identify(observations(seed=seed, alpha=alpha, sigma=1e-5), Settings()).order for seed in range(12)]
    assert min(chosen) == order and np.mean(np.array(chosen) == order) >= 0.75, chosen


def test_hysteresis_is_seen_by_held_out_branches_only():
    """Heating and cooling differ by 1e-3: held-out branches score it, a residual in sample hides half of it."""
    data = observations(sigma=1e-5, temperature=np.interp(np.arange(2400), [0, 1200, 2399], [-30, 70, -30]))
    rising = np.gradient(data.temperature_degc) > 0
    data = replace(data, measured=data.measured + np.where(rising, 5e-4, -5e-4))
    found = identify(data, Settings())
    scores = {b.kind: b.rms_by_order[found.order] for b in found.choice.branches}
    assert scores["heating"] > 8e-4 and found.residual_rms < 6e-4


def test_held_out_scores_are_those_of_a_fit_to_the_rest():
    """Recomputed with numpy's polyfit."""
    data = observations(sigma=1e-4, temperature=np.interp(np.arange(2000), [0, 1000, 1999], [-20, 60, -20]))
    found = identify(data, Settings())
    branches = find_branches(data.temperature_degc)
    for branch, scored in zip(branches, found.choice.branches):
        rest = np.ones(2000, bool)
        rest[branch.where] = False
        for order in (0, 3, 5):
            fit = np.polynomial.Polynomial.fit(data.temperature_degc[rest], data.measured[rest], order)
            errors = data.measured[branch.where] - fit(data.temperature_degc[branch.where])
            assert scored.rms_by_order[order] == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-3)


# ---- whole identifications ---------------------------------------------------------------------------------------------------


def test_the_intervals_of_identify_cover_the_truth():
    """The whole path at 30 seeds with coloured noise (the 1000 seeds are in test_calibrate_noise.py)."""
    hits = []
    for seed in range(30):
        data = observations(count=1200, seed=seed)
        rng = np.random.default_rng(1000 + seed)
        drift = np.zeros(1200)
        for i in range(1, 1200):
            drift[i] = 0.9 * drift[i - 1] + 1e-5 * rng.standard_normal()
        found = identify(replace(data, measured=data.measured + drift), Settings(order=3))
        hits += (np.abs(found.bias_rad_s - ALPHA) <= found.bias_half_width_rad_s).tolist()
    assert 0.86 <= np.mean(hits) <= 0.999


def turntable(count, step_s):
    """Turns of 30 s, +-0.2 rad/s, at every temperature."""
    return np.select([(np.arange(count) * step_s) % 60 < 15, (np.arange(count) * step_s) % 60 < 30], [0.2, -0.2], 0.0)


def test_scale_factor_and_bias_together():
    """ratio = (rate + bias) / S(T) through 0.6 s of lag, integrated with scipy; both polynomials inside their intervals."""
    count, step_s, tau = 6000, 0.2, 0.6
    temperature, rate = sweep(count), turntable(6000, 0.2)
    scale = np.array([1.57, 3.1e-3, 6.0e-6])
    time_s = np.arange(count) * step_s
    target = (rate + bias(temperature)) / sum(c * (temperature - T0) ** i for i, c in enumerate(scale))
    solved = solve_ivp(lambda t, y: (np.interp(t, time_s, target) - y) / tau, (0, time_s[-1]), [target[0]], t_eval=time_s, rtol=1e-8,
                       atol=1e-12, max_step=0.2)
    ratio = solved.y[0] + 1e-5 * np.random.default_rng(5).standard_normal(count)
    data = Observations("ratio", True, time_s, temperature, ratio, rate, np.ones(count, bool))
    found = identify(data, Settings(max_order=4, tau_s=lambda t: np.full(len(t), tau)))
    assert found.order == 3 and len(found.scale) == 3
    assert np.all(np.abs(found.bias_rad_s - ALPHA) < 1.6 * found.bias_half_width_rad_s)
    assert np.all(np.abs(found.scale - scale) < 1.6 * found.scale_half_width)
    assert found.scale_half_width[0] < 1e-4 * found.scale[0]


def test_a_wrong_scale_factor_of_the_firmware_is_found():
    """Only the rate channel and the table: the correction is the ratio of true to shown rate."""
    rate = turntable(2400, 0.5)
    data = observations(true_rate_rad_s=rate)
    data = replace(data, measured=(data.measured + rate) / 1.03)
    found = identify(data, Settings(order=3, scale_order=0))
    assert found.scale[0] == pytest.approx(1.03, abs=5e-5) and not found.scale_is_ratio
    assert np.all(np.abs(found.bias_rad_s - ALPHA) < 1.6 * found.bias_half_width_rad_s)


def test_a_constant_true_rate_is_taken_off():
    data = observations(true_rate_rad_s=np.full(2400, 7e-5))
    data = replace(data, measured=data.measured + 7e-5)
    found = identify(data, Settings(order=3))
    assert found.scale is None and abs(found.bias_rad_s[0] - ALPHA[0]) < 1.6 * found.bias_half_width_rad_s[0]


def test_long_records_are_thinned_without_changing_the_answer(tmp_path):
    rng = np.random.default_rng(6)
    temperature = sweep(120_000)
    path = tmp_path / "a.h5"
    write(path, temperature, bias(temperature) + 1e-5 * rng.standard_normal(120_000), rate_hz=100.0)
    result = calibrated(path, "--order", "3")
    assert result["samples"] <= 50_000
    for term, truth in zip(result["bias"], ALPHA):
        centre, half = np.mean(term["interval_95"]), np.ptp(term["interval_95"]) / 2
        assert abs(centre - truth) < 2 * half


# ---- the command -------------------------------------------------------------------------------------------------------------


def write(path, temperature, rate, rate_hz=2.0, lost=None, **meta):
    with RecordingWriter(path, RecordingMeta(counter_rate_hz=rate_hz, **meta)) as writer:
        writer.add_tap("output", TapFormat(rate_hz, {"temperature_measured": float_format(), "rate_uncompensated": float_format()}))
        writer.append("output", {"temperature_measured": temperature, "rate_uncompensated": rate}, 0, lost=lost)


def calibrated(path, *flags):
    import contextlib
    import io

    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main(["calibrate", str(path), "--json", *flags]) == 0
    return json.loads(out.getvalue())


def test_the_command_writes_a_block_the_firmware_reads(tmp_path, capsys):
    data = observations()
    write(tmp_path / "a.h5", data.temperature_degc, data.measured)
    assert main(["calibrate", str(tmp_path / "a.h5"), "-o", str(tmp_path / "cal.json"), "--device", "metal", "--loop", "closed"]) == 0
    out = capsys.readouterr().out
    for word in ("alpha3", "held out", "heating", "cooling", "deg/h", "chosen", "95 %"):
        assert word in out
    calibration = calibration_block.read_json(tmp_path / "cal.json")
    assert calibration.device_name == "metal"
    np.testing.assert_allclose(calibration.bias_rad_s, ALPHA, rtol=0.05)
    assert (calibration.temperature_min_degc, calibration.temperature_max_degc) == pytest.approx((-35, 75), abs=0.2)
    block = calibration_block.to_binary(calibration)
    assert main(["calibrate", str(tmp_path / "a.h5"), "-o", str(tmp_path / "cal.bin"), "--device", "metal", "--loop", "closed", "-q"]) == 0
    written = calibration_block.from_binary((tmp_path / "cal.bin").read_bytes())
    np.testing.assert_allclose(written.bias_rad_s, calibration_block.from_binary(block).bias_rad_s, rtol=1e-12)


def test_the_base_keeps_its_other_fields(tmp_path):
    data = observations()
    write(tmp_path / "a.h5", data.temperature_degc, data.measured)
    assert main(["calibrate", str(tmp_path / "a.h5"), "-o", str(tmp_path / "one.json"), "--device", "silica", "-q", "--order", "3"]) == 0
    write(tmp_path / "b.h5", data.temperature_degc, 2.0 * data.measured)
    flags = ["--base", str(tmp_path / "one.json"), "--loop", "closed", "--order", "3", "-q"]
    assert main(["calibrate", str(tmp_path / "b.h5"), "-o", str(tmp_path / "two.json"), *flags]) == 0
    one, two = (calibration_block.read_json(tmp_path / name) for name in ("one.json", "two.json"))
    changed = {name for name, value in one.model_dump().items() if two.model_dump()[name] != value}
    assert changed <= {"bias_rad_s", "sequence", "created_unix_s"} and two.sequence == one.sequence + 1
    np.testing.assert_allclose(two.bias_rad_s[0], 2 * ALPHA[0], rtol=0.01)


def test_lost_samples_do_not_count(tmp_path):
    data = observations()
    lost = np.random.default_rng(7).random(2400) < 0.3
    rate = np.where(lost, 99.0, data.measured)
    write(tmp_path / "a.h5", data.temperature_degc, rate, lost=lost)
    with Recording.open(tmp_path / "a.h5") as recording:
        assert recording.tap("output").lost.sum() == lost.sum()
    result = calibrated(tmp_path / "a.h5", "--order", "3")
    assert result["bias"][0]["value"] == pytest.approx(ALPHA[0], rel=0.01)


def narrow(span):
    return 25.0 + span * (sweep() - 20.0) / 110.0


HALF = np.linspace(-30.0, 70.0, 1200)
PLATEAUS = np.repeat([0.0, 40.0, 0.0], 400)
REFUSED = {
    "span too small": ({"temperature": narrow(3.0)}, [], "spans 3 degC"),
    "span too small for a given order": ({"temperature": narrow(9.0)}, ["--order", "2"], "spans 9 degC"),
    "one branch": ({"temperature": HALF}, [], "give --order N"),
    "constant temperature": ({"temperature": np.full(1200, 25.0)}, [], "too little"),
    "two plateaus cannot carry a cubic": ({"temperature": PLATEAUS}, ["--order", "3"], "cannot tell 4 coefficients apart"),
    "too short": ({"temperature": HALF[::100]}, ["--order", "1"], "only 12 usable samples"),
    "order beyond the firmware": ({}, ["--order", "6"], "orders 0 to 5"),
    "order is a word": ({}, ["--order", "many"], "no order"),
    "channel that is not there": ({}, ["--channel", "rate"], "no channel rate"),
    "no baseband for the ratio": ({}, ["--channel", "ratio"], "baseband"),
    "unknown device": ({}, ["--device", "brass"], "no device 'brass'"),
    "base missing": ({}, ["--base", "none.json"], "none.json"),
}


@pytest.mark.parametrize("data, flags, message", REFUSED.values(), ids=REFUSED.keys())
def test_refusals_are_one_line_and_write_nothing(tmp_path, capsys, data, flags, message):
    made = observations(**data)
    write(tmp_path / "a.h5", made.temperature_degc, made.measured)
    assert main(["calibrate", str(tmp_path / "a.h5"), "-o", str(tmp_path / "cal.json"), *flags]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_a_constant_bias_needs_no_span(tmp_path):
    made = observations(temperature=np.full(1200, 25.0), alpha=ALPHA[:1])
    write(tmp_path / "a.h5", made.temperature_degc, made.measured)
    assert calibrated(tmp_path / "a.h5", "--order", "0")["bias"][0]["value"] == pytest.approx(ALPHA[0], abs=2e-6)


def test_nan_and_foreign_units_are_refused_before_anything_is_fitted(tmp_path, capsys):
    import h5py

    made = observations()
    rate = made.measured.copy()
    rate[100] = np.nan
    write(tmp_path / "a.h5", made.temperature_degc, rate)
    assert main(["calibrate", str(tmp_path / "a.h5")]) == 2
    assert "nan at sample 100" in capsys.readouterr().err
    write(tmp_path / "a.h5", made.temperature_degc, made.measured)
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["output/rate_uncompensated"].attrs["unit"] = "V"
    assert main(["calibrate", str(tmp_path / "a.h5")]) == 2
    assert "unit 'V' is unknown" in capsys.readouterr().err


def test_the_output_filters_delay_is_the_firmwares():
    """A ramp through the firmware's filter, settled, against the delay the model uses."""
    from wineglass.calibration.base import Base, nominal_calibration
    from wineglass.device import load
    from wineglass.native import library, pointer

    calibration = nominal_calibration(load("metal")).with_changes(output_filter="0.01")
    ramp = (np.arange(4000) * 10_000).astype(np.int32)
    out = np.empty_like(ramp)
    assert library().wg_output_filter_run(1, 0, pointer(ramp, "int32_t"), pointer(out, "int32_t"), len(ramp)) == 0
    delay_s = float(ramp[-1] - out[-1]) / 10_000 / calibration.slow_rate_hz
    assert Base(calibration, "", True).delay_s == pytest.approx(delay_s, rel=0.01)


# ---- what counts in a device's recording -------------------------------------------------------------------------------------


def write_device(path, compensation="none", unlocked=0, count=1200):
    """A device's recording at 2 Hz with a turntable: rate channel and baseband tell different biases, so that they can be told apart."""
    from wineglass.calibration.base import nominal_calibration
    from wineglass.device import load

    data, rate = observations(count=count), turntable(count, 0.5)
    status = np.where(np.arange(count) < unlocked, 0, 1).astype(np.uint32)
    secondary = np.where(status, 0.45 * (rate + data.measured), 99.0)
    block = calibration_block.to_binary(nominal_calibration(load("metal")).with_changes(compensation=compensation))
    baseband = {"primary_in_phase": np.full(count, 0.9), "primary_quadrature": np.zeros(count), "secondary_in_phase": secondary,
                "secondary_quadrature": np.zeros(count), "status": status}
    from wineglass.recording import ChannelFormat

    with RecordingWriter(path, RecordingMeta(counter_rate_hz=2.0, calibration_block=block)) as writer:
        form = {name: float_format() for name in baseband} | {"status": ChannelFormat("u4")}
        writer.add_tap("baseband", TapFormat(2.0, form))
        writer.append("baseband", baseband, 0)
        writer.add_tap("output", TapFormat(2.0, {"temperature_measured": float_format(), "rate_uncompensated": float_format()}))
        writer.append("output", {"temperature_measured": data.temperature_degc, "rate_uncompensated": rate + data.measured}, 0)
        writer.add_tap("reference", TapFormat(2.0, {"true_rate": float_format()}))
        writer.append("reference", {"true_rate": rate}, 0)


def test_samples_before_the_lock_do_not_count(tmp_path):
    write_device(tmp_path / "a.h5", unlocked=40)
    result = calibrated(tmp_path / "a.h5", "--order", "3", "--scale-order", "0", "--loop", "closed")
    assert result["channel"] == "ratio" and result["samples"] <= 1160
    assert result["scale"]["terms"][0]["value"] == pytest.approx(2.0, rel=1e-3)
    assert result["bias"][0]["value"] == pytest.approx(ALPHA[0], rel=0.02)


@pytest.mark.parametrize("compensation, channel", [("none", "ratio"), ("static", "ratio"), ("g2", "rate_uncompensated")])
def test_the_baseband_behind_the_decoupler_is_not_used(tmp_path, compensation, channel):
    write_device(tmp_path / "a.h5", compensation)
    assert calibrated(tmp_path / "a.h5", "--order", "3", "--scale-order", "0", "--loop", "closed")["channel"] == channel


def test_a_sweep_of_the_twin_gives_the_shells_own_polynomial(tmp_path):
    """Firmware in the loop from cold start, rate turns in between, no split: bias and its order are those of the simulated shell."""
    path = tmp_path / "sweep.h5"
    assert main(["simulate", "thermal-sweep", "--set", "resonator.split_hz=0", "--seed", "3", "-o", str(path), "-q"]) == 0
    result = calibrated(path, "-o", str(tmp_path / "cal.json"))
    assert result["order"] == 3 and result["channel"] == "ratio" and result["loop"] == "open"
    for term, truth in zip(result["bias"], ALPHA):
        centre, half = np.mean(term["interval_95"]), np.ptp(term["interval_95"]) / 2
        assert abs(centre - truth) < 2.5 * half and half < 0.01 * abs(truth)
    assert calibration_block.read_json(tmp_path / "cal.json").scale_rad_s_per_ratio[0] == pytest.approx(np.pi * 5000 / 1e4, rel=1e-4)


def test_a_delay_beyond_the_known_lag_is_fitted_and_reported():
    """A thermometer read 0.15 s too late on a device with 0.6 s of lag: closed form, the answer to smooth inputs is 0.45 s later."""
    def temperature(t):
        return 20.0 - 55.0 * np.cos(2 * np.pi * t / 600)

    time_s = np.arange(0, 1800, 0.5)
    tau, late = 0.6, 0.15
    omega = 2 * np.pi / 600  # W of a slow sine: gain 1/sqrt(1 + (omega tau)^2) = 1 - 2e-5, hence the small tolerance below
    rate = bias(temperature(time_s - np.arctan(omega * tau) / omega)) + 1e-6 * np.random.default_rng(9).standard_normal(len(time_s))
    data = Observations("rate_uncompensated", False, time_s, temperature(time_s - late), rate, None, np.ones(len(time_s), bool))
    found = identify(data, Settings(tau_s=lambda t: np.full(len(t), tau)))
    assert found.delay_s == pytest.approx(-late, abs=2 * found.delay_half_width_s + 1e-3)
    assert found.order == 3 and np.all(np.abs(found.bias_rad_s - ALPHA) < 2.0 * found.bias_half_width_rad_s + 1e-4 * np.abs(ALPHA))


def test_no_delay_is_claimed_where_there_is_none():
    data = observations()
    settings = Settings(order=3, tau_s=lambda t: np.full(len(t), 1e-6))
    assert identify(data, settings).delay_s is None
