"""Loop model against the full twin: the Bode plot by rate and by test force, step, noise, and the command as a whole."""

import json
import math

import numpy as np
import pytest

from wineglass import cli, paths
from wineglass import device as devices
from wineglass.calibration_block import read_json
from wineglass.commands.design_loop import _calibration
from wineglass.loop_design import rebalance, report

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")

QUIET = {"electronics.adc.bits": 32, "electronics.adc.snr_db": 0.0, "electronics.dac.bits": 32}
UP_TO_100_HZ = (1.0, 10.0, 33.0, 70.0, 100.0)


def prepared(changes, gains_of):
    device = devices.load("metal").override(changes)
    gains = gains_of(device)
    run, calibration = _calibration(device, loop="rebalance", rebalance_kp=gains.proportional, rebalance_ki_per_s=gains.integral_per_s)
    return rebalance.model(device, gains), run, calibration


def assert_near(measured, expected, part, degrees):
    ratio = measured / expected
    assert np.max(np.abs(np.abs(ratio) - 1)) < part
    assert np.max(np.abs(np.degrees(np.angle(ratio)))) < degrees


@pytest.mark.parametrize("seed", [1, 2])
def test_model_and_twin_agree_up_to_100_hz(seed):
    from wineglass.loop_design import measure

    model, run, calibration = prepared({}, lambda device: rebalance.design(device, 100.0))
    rate = measure.rate_response(run, calibration, UP_TO_100_HZ, seed=seed)
    force = measure.test_force_response(run, calibration, UP_TO_100_HZ, seed=seed)
    assert_near(rate.gain, model.rate_response(rate.frequency_hz), 0.02, 2.0)
    assert_near(force.gain, model.test_response(force.frequency_hz), 0.02, 2.0)


@pytest.mark.parametrize("changes", [
    {"resonator.frequency_hz": 5013.0},
    {"resonator.frequency_hz": 4987.0, "electronics.adc.delay_samples": 1.3, "electronics.dac.latency_samples": 3},
    {"resonator.frequency_hz": 5013.0, "firmware.decimation": 20, "firmware.loops_per_slow": 2},
    {"resonator.frequency_hz": 5013.0, "electronics.adc.secondary_delay_samples": 1.0},
])
def test_without_noise_and_standing_image_the_model_is_exact(changes):
    """A carrier that shares no period with the loop tick lets the image at its double average out."""
    from wineglass.loop_design import measure

    model, run, calibration = prepared({**QUIET, **changes}, lambda device: rebalance.gains_of_speed(device, 2 * math.pi * 90.0, 40.0))
    force = measure.test_force_response(run, calibration, (2.0, 20.0, 100.0, 200.0))
    assert_near(force.gain, model.test_response(force.frequency_hz), 1e-3, 0.05)
    rate = measure.rate_response(run, calibration, (2.0, 20.0, 50.0))
    assert_near(rate.gain, model.rate_response(rate.frequency_hz), 2e-3, 0.1)


def test_step_noise_and_margins_as_designed():
    from wineglass.loop_design import measure

    model, run, calibration = prepared({}, lambda device: rebalance.design(device, 150.0, 60.0))
    designed = report.of_rebalance(model, calibration.rebalance_in_phase_limit_fs, calibration.rebalance_quadrature_limit_fs)
    frequencies = (50.0, 70.0, 100.0, 130.0, 160.0, 200.0)
    measured = report.of_measurement(model, measure.rate_response(run, calibration, frequencies),
                                     measure.test_force_response(run, calibration, frequencies), measure.step_response(run, calibration))
    assert measured.overshoot == pytest.approx(designed.step.overshoot, abs=0.03)
    assert measured.noise_rad_s == pytest.approx(designed.noise_rad_s, rel=0.15)  # of 500 outputs, correlated
    assert measured.bandwidth_hz == pytest.approx(designed.bandwidth_hz, rel=0.04)
    assert measured.crossover_hz == pytest.approx(designed.margins.crossover_hz, rel=0.03)
    assert measured.phase_margin_deg == pytest.approx(designed.margins.phase_margin_deg, abs=2.0)


def test_nominal_loop_reaches_the_bars_on_the_twin():
    from wineglass.loop_design import measure

    model, run, calibration = prepared({}, lambda device: rebalance.gains_of_speed(device, 2 * math.pi * 100.0))
    rate = measure.rate_response(run, calibration)
    force = measure.test_force_response(run, calibration, (70.0, 100.0, 130.0))
    measured = report.of_measurement(model, rate, force, measure.step_response(run, calibration))
    assert measured.bandwidth_hz >= 100.0
    assert measured.phase_margin_deg >= 60.0
    assert measured.overshoot <= 0.15


def test_command_writes_calibration_and_plot(tmp_path, capsys):
    target, plot = tmp_path / "metal.json", tmp_path / "metal.png"
    assert cli.main(["--json", "design-loop", "metal", "--bandwidth", "120", "-o", str(target), "--plot", str(plot)]) == 0
    result = json.loads(capsys.readouterr().out)
    assert plot.read_bytes()[:4] == b"\x89PNG"
    calibration = read_json(target)
    assert calibration.loop == "rebalance" and calibration.output_filter == "none"
    assert calibration.rebalance_kp == pytest.approx(result["designed"]["gains"]["proportional"])
    assert result["designed"]["bandwidth_hz"] == pytest.approx(120.0, rel=1e-4)
    assert result["measured"]["bandwidth_hz"] == pytest.approx(120.0, rel=0.04)
    assert len(result["measured"]["rate"]["gain"]) == len(result["measured"]["force"]["gain"]) == 12
