"""From a sweep to a compensated gyro, as a user does it: record, calibrate, load the block, run another profile."""

import os

import numpy as np
import pytest

from wineglass import experiments, paths, scenario
from wineglass.cli import main

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")

SEED = int(os.environ.get("WINEGLASS_SEED", "7"))


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    folder = tmp_path_factory.mktemp("calibration")
    sweep, block = folder / "sweep.h5", folder / "calibration.json"
    assert main(["simulate", "thermal-sweep", "--seed", str(SEED), "-o", str(sweep), "-q"]) == 0
    assert main(["calibrate", str(sweep), "-o", str(block), "-q"]) == 0
    return block


def output_rad_s(compensation: str, calibration) -> np.ndarray:
    """Rate of another unit of noise on another profile at zero rate, from 10 s on."""
    run = scenario.prepare(scenario.parse({
        "device": "metal-fast", "duration_s": 120, "seed": SEED + 1, "calibration": str(calibration),
        "temperature": {"kind": "sine", "mean_degc": 20, "amplitude_degc": 40, "period_s": 100},
        "mode": {"compensation": compensation, "output_filter_hz": 10}}, "case"))
    return experiments.simulate(run).rate_rad_s[10_000:]


def test_the_calibrated_gyro_keeps_a_five_hundredth_of_its_thermal_bias(calibration):
    print(f"seed {SEED}")
    rms = {name: float(np.sqrt(np.mean(np.square(output_rad_s(name, calibration))))) for name in ("none", "static", "g2")}
    print(rms)
    assert rms["g2"] <= rms["none"] / 500
    assert rms["g2"] <= rms["static"] / 10
