"""What is counted, what it may cost, and what others need for the same."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Kernel:
    name: str
    function: str
    """symbol in the program of kernels (tests/target/kernels.c)"""
    how_often: str
    """sample, loop tick (decimation samples) or slow tick"""
    peers: str = ""
    """published figures, instructions or cycles a call as their authors give them"""
    worst_bar: int | None = None


KERNELS = (
    Kernel("cosine and sine", "cost_cosine_sine", "sample", "idsp 46, CMSIS-DSP sin_cos 133", 32),
    Kernel("lock-in, both pickoffs", "cost_lockin_pair", "sample", "idsp 98, one pickoff"),
    Kernel("decoupler (one biquad)", "cost_decoupler", "sample", "idsp wide biquad 73, CMSIS-DSP 32x64 biquad 177", 50),
    Kernel("DAC shaper, one force", "cost_dac_shaper", "sample"),
    Kernel("lock-in output, one pickoff", "lockin_output", "loop tick", "CMSIS-DSP decimator 83"),
    Kernel("magnitude and angle", "polar_from_complex", "loop tick", "idsp atan2 95, angle only"),
    Kernel("drive loop (PLL and AGC)", "drive_loop_step", "loop tick", "idsp PLL 84"),
    Kernel("rebalance loops", "rebalance_step", "loop tick"),
    Kernel("thermal polynomial, order 5", "thermal_polynomial_eval", "slow tick"),
    Kernel("rate ratio", "rate_ratio_q29", "slow tick"),
    Kernel("output filter, order 4", "output_filter_step", "slow tick"),
    Kernel("decoupler retuning", "decoupler_retune", "slow tick"),
)

BARS: dict[str, float] = {
    "gyro_step, open loop, G2, mean": 220,
    "gyro_step, open loop, G2, worst": 600,
    "gyro_step, force-to-rebalance, mean": 220,
    "gyro_step, force-to-rebalance, worst": 600,
    "flash, bytes": 8 * 1024,
    "memory, bytes": 1024,
    "software division and floating point, functions": 0,
}

NOT_YET = ("gyro_step, open loop, G2, mean", "gyro_step, force-to-rebalance, mean", "flash, bytes")
"""Bars that are known not to be reached; whoever reaches one takes it off the list."""
