"""What noise effects add to slow channels, in closed form, against the full twin with the effect; and the wander of the bias by another way."""

import numpy as np
import pytest

from wineglass import device as devices
from wineglass import scenario
from wineglass.calibration_block import from_binary
from wineglass.diagnosis import noise_added
from wineglass.effects import Setting
from wineglass.recording import Recording
from wineglass.simulation import simulate

SEED = 41
FRAME_S = 0.26
"""thirteen samples of the telemetry"""
FREQ_HZ = np.arange(1, 513) / (1024 * FRAME_S)


@pytest.fixture(scope="module")
def resting(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rest")

    def make(name, loop, effects):
        run = scenario.prepare(scenario.parse({
            "device": "metal-fast", "duration_s": 130.0, "seed": SEED, "mode": {"loop": loop}, "temperature": {"kind": "constant", "value_degc": 25.0},
            "recording": {"baseband_hz": 50.0, "output_hz": 50.0, "reference_hz": 10.0}}, "test"))
        simulate(run, folder / name, effects=effects)
        return folder / name

    return make


def third_differences(values):
    """(n,) frames: variance of their third differences over that of white noise; slow content has gone."""
    return float(np.mean(np.diff(values, 3) ** 2)) / 20.0


@pytest.mark.parametrize(("loop", "setting", "strengths", "tap", "names"), [
    ("open", Setting("clock_jitter", {"jitter_s": 2e-8}), {"jitter_s": 2e-8}, "baseband",
     ("primary_in_phase", "primary_quadrature", "drive_frequency", "drive_level")),
    ("rebalance", Setting("excess_noise", {"primary_fs": 0.0, "secondary_fs": 3e-4}), {"secondary_fs": 3e-4}, "baseband",
     ("rebalance_in_phase", "rebalance_quadrature")),
    ("open", Setting("excess_noise", {"primary_fs": 0.0, "secondary_fs": 3e-4}), {"secondary_fs": 3e-4}, "output", ("rate", "rate_uncompensated")),
])
def test_added_noise_is_that_of_the_full_twin(resting, loop, setting, strengths, tap, names):
    """The effects are ten times the floor, which is neglected: 1 %. 480 frames leave 5 % of chance, twice that since differences hang together."""
    with Recording.open(resting(f"{setting.id}_{loop}_{tap}.h5", loop, [setting])) as recording:
        described, calibration = devices.loads(recording.device_toml), from_binary(recording.calibration_block)
        used = recording.tap(tap)
        first = np.searchsorted(used.time_s, 5.0)
        expected = noise_added.Added(strengths).densities(described, calibration, loop, FRAME_S, names, FREQ_HZ)
        for name, density in zip(names, expected, strict=True):
            values = used[name][first:]
            frames = values[: len(values) // 13 * 13].reshape(-1, 13).mean(axis=1)
            weight = (2.0 * np.sin(np.pi * FREQ_HZ * FRAME_S)) ** 6 / 20.0
            variance = float(np.trapezoid(density * weight, FREQ_HZ))
            assert third_differences(frames) == pytest.approx(variance, rel=0.25), name


def test_wander_of_relaxations_has_their_exponentials():
    found = noise_added.Added({"bias_rad_s": 2e-6}).wander_covariance(np.array([0.0, 1.0, 10.0, 100.0]))
    tau = np.array([1.0, 4.0, 16.0, 64.0, 256.0])
    by_hand = [4e-12 * np.exp(-lag / tau).sum() for lag in (0.0, 1.0, 10.0, 100.0)]
    assert found == pytest.approx(by_hand, rel=0.1, abs=0.3e-12)


def test_without_flicker_nothing_wanders():
    added = noise_added.Added({"primary_fs": 1e-4})
    assert not added.wander_psd(FREQ_HZ).any() and not added.wander_covariance(np.array([0.0])).any()
