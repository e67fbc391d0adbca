"""A converter that jumps at zero, as raw codes of the sampled twin show it, and where it lets a rebalanced secondary rest."""

import numpy as np
import pytest

from wineglass import device as devices
from wineglass import scenario
from wineglass.calibration_block import from_binary
from wineglass.diagnosis import curve_of_codes, noise_added, raw_codes
from wineglass.effects import Setting
from wineglass.recording import Recording
from wineglass.simulation import simulate

SEED = 43
FRAME_S = 0.25
FREQ_HZ = np.geomspace(1e-5, 0.5 / FRAME_S, 300)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("codes")

    def make(name, effects, frequency_hz=5003.7):
        run = scenario.prepare(scenario.parse({
            "device": "metal-fast", "duration_s": 20.0, "seed": SEED, "mode": {"loop": "rebalance"}, "temperature": {"kind": "constant", "value_degc": 25.0},
            "override": {"resonator.frequency_hz": frequency_hz},
            "recording": {"baseband_hz": 50.0, "output_hz": 50.0, "reference_hz": 10.0, "bursts": [{"time_s": time_s, "samples": 2500} for time_s in (6.0, 10.0, 14.0, 18.0)]}}, "test"))
        path = folder / f"{name}.h5"
        simulate(run, path, effects=effects)
        return path

    return make


@pytest.mark.parametrize(("name", "value", "jump_fs"), [("sign_step_fs", 2e-4, 2e-4), ("sign_step_fs", -3e-4, -3e-4), ("teeth_fs", 4e-4, -8e-4), ("cubic", 3e-3, 0.0)])
def test_a_jump_at_zero_is_read_from_the_codes_and_a_bend_is_none(recorded, name, value, jump_fs):
    with Recording.open(recorded(f"{name}{value}", [Setting("adc_nonlinearity", {name: value})])) as recording:
        found = raw_codes.examine(recording, devices.loads(recording.device_toml))
    primary = [burst for burst in found.bursts if burst.channel == curve_of_codes.PRIMARY]
    assert primary
    jump, deviation = curve_of_codes.jump_at_zero(primary)
    assert abs(jump - jump_fs) <= 4.0 * deviation and deviation < 2e-5
    assert (curve_of_codes.unread_fs(found.bursts) > 0.0) == (jump_fs < 0.0)


def test_where_the_secondary_rests_unread_its_loop_pushes_as_much_as_the_floor_grants(recorded):
    """At ten samples a cycle the place stays as it is; where samples walk along the cycle it changes, and its mean is less."""
    teeth, unread = Setting("adc_nonlinearity", {"teeth_fs": 4e-4}), 2.0 / np.pi * 8e-4
    with Recording.open(recorded("with", [teeth], 5000.0)) as recording, Recording.open(recorded("without", [], 5000.0)) as quiet:
        device, calibration = devices.loads(recording.device_toml), from_binary(recording.calibration_block)
        first = np.searchsorted(recording.tap("baseband").time_s, 12.0)
        moved = [float(np.mean(recording.tap("baseband")[name][first:] - quiet.tap("baseband")[name][first:])) for name in noise_added.FORCES]
    density = noise_added.Added({noise_added.UNREAD: unread}).densities(device, calibration, "rebalance", FRAME_S, noise_added.FORCES, FREQ_HZ)
    granted = np.sqrt(np.trapezoid(density, FREQ_HZ, axis=1))
    assert granted[0] == granted[1]
    assert np.hypot(*moved) == pytest.approx(granted[0], rel=0.15)
    open_loop = noise_added.Added({noise_added.UNREAD: unread}).densities(device, calibration, "open", FRAME_S, noise_added.FORCES, FREQ_HZ)
    assert not open_loop.any()
