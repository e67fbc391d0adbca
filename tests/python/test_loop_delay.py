"""A codec whose filters take 24 samples: the delay goes into the calibration as it is, and the loops lock, hold and measure as without it."""

import dataclasses

import numpy as np
import pytest
from test_rebalance_margins import GOLDEN, _sealed, firmware_reason

from wineglass import calibration_block as cb
from wineglass import paths, scenario
from wineglass.commands_wire import CommandEncoder
from wineglass.twin import Twin
from wineglass.wire import Status

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")

ADC_SAMPLES, DAC_SAMPLES = 12.0, 11  # 24 with half a sample of hold; the codec of docs/guides/stm32f405.md


def behind_a_codec(freq_hz: float, rate_deg_s: float = 0.0) -> scenario.Run:
    run = scenario.prepare(scenario.parse({"duration_s": 4.0, "rate": {"value_deg_s": rate_deg_s}}, "codec"))
    electronics = run.device.electronics
    slow = electronics.model_copy(update={"adc": electronics.adc.model_copy(update={"delay_samples": ADC_SAMPLES}),
                                          "dac": electronics.dac.model_copy(update={"latency_samples": DAC_SAMPLES})})
    device = run.device.model_copy(update={"electronics": slow})
    resonator = device.resonator.model_copy(update={"frequency_hz": freq_hz})
    return dataclasses.replace(run, device=device, truth=device.model_copy(update={"resonator": resonator}))


@pytest.mark.parametrize("freq_hz", [4945.0, 4987.0, 5000.0, 5013.0, 5055.0])
def test_cold_start_behind_a_codec(freq_hz):
    """Over the whole search band: at its edge a delay that is one turn too short would be off by 4 degrees, 17 mHz of resonance."""
    off_hz = []
    with Twin(behind_a_codec(freq_hz), amplitudes=True) as twin:
        twin.step(1500)
        assert twin.signals()["status"] & Status.LOCKED
        for _ in range(40):
            last, truth = twin.step(10), twin.truth()
            off_hz.append(truth.oscillator_hz - truth.resonance_hz)
    assert abs(np.mean(off_hz)) <= 0.001
    assert abs(last.primary[-1]) == pytest.approx(0.9, rel=0.01)
    late_turns = ADC_SAMPLES * truth.resonance_hz / 50e3
    assert abs((np.angle(last.primary[-1]) / (2 * np.pi) - late_turns + 0.5) % 1.0 - 0.5) <= 1 / 360


def test_rebalance_behind_a_codec():
    """The loop of the device's design is closed and delivers the rate."""
    with Twin(behind_a_codec(5003.0, 5.0)) as twin:
        twin.step(1500)
        twin.command(CommandEncoder().loop("rebalance"))
        twin.step(1500)
        assert twin.signals()["status"] & Status.LOCKED and twin.signals()["status"] & Status.RATE_VALID
        rates = []
        for _ in range(50):
            twin.step(10)
            rates.append(twin.signals()["rate_rad_s_q28"] / 2**28)
    assert np.degrees(np.mean(rates)) == pytest.approx(5.0, rel=0.01)


@pytest.mark.parametrize("samples, accepted", [(24.0, True), (63.9, True), (64.0, False), (1000.0, False)])
def test_limit_of_the_delay(samples, accepted):
    golden = cb.read_json(GOLDEN).with_changes(rebalance_kp=1.0, rebalance_ki_per_s=0.0)
    reason = firmware_reason(_sealed(golden, {"loop_delay_samples_q16": round(samples * 2**16)}))
    assert (reason == 0) == accepted, reason
    if not accepted:
        with pytest.raises(Exception, match="loop_delay_samples"):
            golden.with_changes(loop_delay_samples=samples)


@pytest.mark.parametrize("product, accepted", [(0.699, True), (0.701, False)])
def test_rebalance_gains_are_judged_with_the_whole_delay(product, accepted):
    """b Kp D <= 0.7 with D = 1.5 (N - 1) + 4 + delay, worked out here by hand."""
    golden = cb.read_json(GOLDEN).with_changes(rebalance_kp=1e-3, rebalance_ki_per_s=0.0)
    growth = 0.5 * golden.rebalance_scale_rad_s_per_ratio[0] * golden.angular_gain * golden.pickoff_gain_ratio
    delay_s = (1.5 * (golden.decimation - 1) + 4 + 24) / golden.sample_rate_hz
    numbers = {"loop_delay_samples_q16": 24 * 2**16, "rebalance_proportional_q16": round(product / delay_s / growth * 2**16)}
    assert (firmware_reason(_sealed(golden, numbers)) == 0) == accepted
