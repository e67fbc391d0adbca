"""The firmware is not the one that the recording says, or its output was changed on the way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wineglass.blind.generator.effects.register import effect
from wineglass.blind.generator.world import World
from wineglass.calibration_block import from_binary, to_binary

RATE_UNIT = 2.0**-28  # rad/s a code of the output
DEG_H = np.pi / 180.0 / 3600.0
RATES = ("rate", "rate_uncompensated")


def _patch(world: World, names: tuple[str, ...], change: Callable[[np.ndarray], np.ndarray]) -> None:
    def patch(tap: str, data: dict[str, np.ndarray], first_sample: int) -> dict[str, np.ndarray]:
        if tap != "output":
            return data
        return {name: np.rint(change(codes.astype(float))).astype(codes.dtype) if name in names else codes for name, codes in data.items()}

    world.output_patches.append(patch)


@effect("firmware_mismatch", "scaled_output", stage="firmware", unit="1", typical=0.01)
def scaled(world: World, strength: float) -> None:
    """the recorded rate is the firmware's times a factor"""
    _patch(world, RATES, lambda codes: codes * (1.0 + strength))


@effect("firmware_mismatch", "shifted_output", stage="firmware", unit="deg/h", typical=30.0)
def shifted(world: World, strength: float) -> None:
    """the recorded rate is the firmware's plus a constant"""
    _patch(world, ("rate",), lambda codes: codes + strength * DEG_H / RATE_UNIT)


@effect("firmware_mismatch", "other_bias", stage="firmware", unit="deg/h", typical=30.0)
def other_bias(world: World, strength: float) -> None:
    """the device runs with another bias polynomial than the recorded calibration says"""
    def patch(block: bytes) -> bytes:
        calibration = from_binary(block)
        bias = list(calibration.bias_rad_s)
        return to_binary(calibration.with_changes(bias_rad_s=[bias[0] + strength * DEG_H, *bias[1:]]))

    world.calibration_patches.append(patch)


@effect("firmware_mismatch", "other_scale", stage="firmware", unit="1", typical=0.01)
def other_scale(world: World, strength: float) -> None:
    """the device runs with another scale factor than the recorded calibration says"""
    def patch(block: bytes) -> bytes:
        calibration = from_binary(block)
        return to_binary(calibration.with_changes(
            scale_rad_s_per_ratio=[value * (1.0 + strength) for value in calibration.scale_rad_s_per_ratio],
            rebalance_scale_rad_s_per_ratio=[value * (1.0 + strength) for value in calibration.rebalance_scale_rad_s_per_ratio]))

    world.calibration_patches.append(patch)
