"""What the internal 12-bit converters cost: device `metal-bringup`. The numbers stand in docs/guides/stm32f405.md and docs/NUMBERS.md."""

import numpy as np
import pytest
from test_system_rebalance import AT_A_TENTH, DEG_H, DEG_S, NO_BIAS, Bench, worst_of_plain_rounding

from wineglass import device as devices
from wineglass import paths
from wineglass.wire import Status

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")


def test_it_is_the_metal_device_at_other_converters():
    metal, bringup = devices.load("metal"), devices.load("metal-bringup")
    assert bringup.resonator == metal.resonator and bringup.firmware == metal.firmware
    electronics = bringup.electronics
    assert (electronics.sample_rate_hz, electronics.adc.bits, electronics.dac.bits, electronics.dac.latency_samples) == (50e3, 12, 12, 1)


def test_rounding_forces_to_12_bits():
    """The shaper keeps the bias out; forces that are rounded to the nearest code would leave hundreds of degrees per hour."""
    rates = np.linspace(0.0, 0.05, 5) / DEG_S

    def measured(bits):
        bench = Bench(AT_A_TENTH | {"electronics.dac.bits": bits})
        found = []
        for rate in rates:
            bench.turn(rate, 0.3)
            heard = bench.listen(np.full(300, rate))
            found.append((heard["rate_rad_s"].mean(), heard["rebalance_in_phase"].mean(), heard["rebalance_quadrature"].mean()))
        return np.array(found)

    shaped, exact = measured(12), measured(32)
    bias = np.max(np.abs(shaped[:, 0] - exact[:, 0])) * DEG_H
    plain = 16.0 * worst_of_plain_rounding((exact[:, 1] + 1j * exact[:, 2]) / 16.0) * DEG_H  # a code is 16 times larger
    print(f"rounding to 12 bits: {bias:.2g} deg/h shaped, {plain:.0f} deg/h to the nearest code")
    assert bias <= 0.05
    assert 100.0 < plain < 300.0


@pytest.mark.parametrize("loop, bar_deg_h", [("rebalance", 400.0), ("open", 15.0)])
def test_noise_of_12_bits(loop, bar_deg_h):
    """It locks and delivers a valid rate, 20 times noisier than at 16 bits where the loop is closed."""
    bench = Bench(NO_BIAS, device="metal-bringup", loop=loop, settle_s=4.0)
    heard = bench.listen(np.zeros(3000))
    assert np.all(heard["status"] & Status.LOCKED) and np.all(heard["status"] & Status.RATE_VALID)
    noise = heard["rate_rad_s"].reshape(-1, 100).mean(axis=1).std() * DEG_H
    print(f"{loop}: {noise:.3g} deg/h rms of means over 0.1 s")
    assert noise <= bar_deg_h
