"""The condition on the rebalance gains: it keeps the margins that it promises, and tools and firmware draw the line at the same place."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wineglass import calibration_block as cb
from wineglass import rebalance

GOLDEN = Path(__file__).resolve().parents[1] / "golden/calibration_block.json"


def firmware_reason(block: bytes) -> int:
    from wineglass.native import ffi, library

    cfg = ffi.new("struct wg_device_cfg *", {"sample_rate_millihz": 50_000_000, "adc_bits": 16, "dac_bits": 16})
    return library().wg_calibration_check(cfg, block, len(block))


def stable_by_nyquist(loop: rebalance.Loop, turn_deg: float, gain: float) -> bool:
    """No encirclement of -1 with the loop turned back by an angle and amplified: by winding number, not by margins."""
    frequency = np.geomspace(1e-4, 0.9 / loop.delay_s, 40_001)
    response = loop.open_loop(frequency) * gain * np.exp(-1j * math.radians(turn_deg))
    turned = np.unwrap(np.angle(1.0 + response))
    return abs(turned[-1] - turned[0] - (0.0 - np.angle(1.0 + response[0]))) < 0.5


@settings(max_examples=40, deadline=None)
@given(crossover_delay=st.floats(0.002, 0.6999), zero=st.floats(0.0, 0.9999), decay=st.floats(0.001, 300.0), growth=st.floats(0.01, 50.0))
def test_accepted_gains_keep_the_margins(crossover_delay, zero, decay, growth):
    delay = 19 / 50e3
    kp = crossover_delay / delay / growth
    loop = rebalance.Loop(growth, kp, kp * zero * (0.25 * growth * kp + decay), decay, delay)
    assert rebalance.is_accepted(loop)
    assert stable_by_nyquist(loop, rebalance.PHASE_MARGIN_DEG, 1.0)
    assert stable_by_nyquist(loop, 0.0, 10 ** (rebalance.GAIN_MARGIN_DB / 20))


def test_the_winding_number_can_tell():
    """The reference above says no where the loop is known to be unstable: an integrator with crossover times delay beyond pi/2."""
    delay = 19 / 50e3
    assert not stable_by_nyquist(rebalance.Loop(1.0, 1.7 / delay, 0.0, 1e-3, delay), 0.0, 1.0)
    assert stable_by_nyquist(rebalance.Loop(1.0, 1.4 / delay, 0.0, 1e-3, delay), 0.0, 1.0)


@pytest.mark.parametrize(("product", "zero", "accepted"), [
    (0.699, 0.0, True), (0.701, 0.0, False), (0.3, 0.99, True), (0.3, 1.01, False), (0.02, 0.99, True), (0.02, 1.01, False),
])
def test_tools_and_firmware_draw_the_same_line(product, zero, accepted):
    golden = cb.read_json(GOLDEN).with_changes(rebalance_kp=1e-3, rebalance_ki_per_s=0.0, loop="rebalance")
    loop = rebalance.loop_of(golden)
    kp = product / loop.delay_s / loop.growth_per_s
    ki = zero * kp * (0.25 * loop.growth_per_s * kp + loop.decay_per_s)
    numbers = cb.integers(golden) | {"rebalance_proportional_q16": round(kp * 2**16), "rebalance_integral_q24": round(ki * 2**24 / 5e3)}
    assert rebalance.is_accepted(rebalance.Loop(loop.growth_per_s, kp, ki, loop.decay_per_s, loop.delay_s)) == accepted
    assert (firmware_reason(_sealed(golden, numbers)) == 0) == accepted
    if not accepted:
        assert firmware_reason(_sealed(golden, numbers)) == 23
        with pytest.raises(Exception, match="unstable"):
            golden.with_changes(rebalance_kp=kp, rebalance_ki_per_s=ki)


def _sealed(calibration: cb.Calibration, numbers: dict[str, int]) -> bytes:
    """A block with some integers exchanged behind the back of the tools' checks."""
    import struct
    import zlib

    layout = struct.Struct("<" + "".join(code for _, code in cb.LAYOUT))
    values = cb.unpack(cb.to_binary(calibration)) | numbers
    body = layout.pack(*(values[name] for name, _ in cb.LAYOUT))[:-4]
    return body + struct.pack("<I", zlib.crc32(body))


def test_closed_loop_of_the_design_reaches_100_hz():
    margins = rebalance.margins(rebalance.Loop(3.61, 174.0, 174.0 * 1.571, 1.571, 19 / 50e3))
    assert margins.crossover_hz == pytest.approx(100.0, rel=0.01)
    assert margins.phase_deg == pytest.approx(90 - 360 * 100 * 19 / 50e3, abs=0.1)
    assert margins.bandwidth_hz > 100
