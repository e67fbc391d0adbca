"""Codes of a run of the digital twin, cut so that they can be replayed sample by sample on any device."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wineglass import nominal, scenario
from wineglass.calibration_block import to_binary
from wineglass.emulation.compare import Stretch
from wineglass.emulation.device import Board
from wineglass.native import library, pointer
from wineglass.scenario import Run
from wineglass.twin import Twin

_THERMOMETER_STREAM = 2  # of the twin's noise, sim/twin.h


@dataclass(frozen=True)
class Codes:
    """What a device met in the twin, and what it answered there."""

    board: Board
    block: bytes
    """calibration"""
    stretches: list[Stretch]
    dac: np.ndarray
    """(n, 2) int32, drive and rebalance"""
    telemetry: bytes


def record(name: str, n_blocks: int, commands: Mapping[int, bytes] | None = None, seed: int | None = None,
           rebalance: bool = False) -> Codes:
    """The first blocks of a scenario. `commands` are given to the device before the block with that number. With `rebalance` the
    calibration has gains for the rebalance loops, so that a command can close them."""
    run = scenario.prepare(scenario.load(name))
    calibration = nominal.calibration(run).with_changes(**(_rebalance_gains(run) if rebalance else {}))
    electronics = run.device.electronics
    board = Board(round(1000 * electronics.sample_rate_hz), electronics.adc.bits, electronics.dac.bits)
    edges = sorted({0, *(commands or {}), n_blocks})
    codes, degc, telemetry = [], [], b""
    block = to_binary(calibration)
    with Twin(run, calibration_block=block, codes=True, seed=seed) as twin:
        for first, last in zip(edges, edges[1:]):
            if commands and first in commands:
                twin.command(commands[first])
            part = twin.step(last - first)
            codes.append(part.codes)
            degc.append(part.thermometer_degc)
            telemetry += twin.telemetry()
        first_noise = np.empty(1)
        library().noise_fill(twin.seed, _THERMOMETER_STREAM, 1, pointer(first_noise, "double"))
    thermometer = electronics.thermometer
    first_degc = run.initial_degc + thermometer.noise_degc * first_noise
    raw = np.rint((np.concatenate([first_degc, *degc]) - thermometer.zero_degc) / thermometer.lsb_degc).astype(int)
    all_codes = np.concatenate(codes)
    stretches = _cut(all_codes[:, :2], raw, run.device.block_samples, commands or {})
    return Codes(board, block, stretches, all_codes[:, 2:], telemetry)


def _rebalance_gains(run: Run) -> dict[str, Any]:
    """Force a = 2 w b of the secondary's envelope A2' = (g W / 2) A1 + b force: nulling costs force = g W A1 / 2 b. Loops of 30 Hz."""
    device = run.device
    reach = device.holding_acceleration_fs_s2 * device.electronics.dac.rebalance_reach
    growth = reach / (4.0 * math.pi * device.resonator.frequency_hz)
    speed = 2.0 * math.pi * 30.0
    return {"rebalance_scale_rad_s_per_ratio": [2.0 * growth / device.resonator.angular_gain], "rebalance_kp": speed / growth,
            "rebalance_ki_per_s": speed * speed / 4.0 / growth, "rebalance_in_phase_limit_fs": 0.7, "rebalance_quadrature_limit_fs": 0.7}


def _cut(adc: np.ndarray, thermometer: np.ndarray, block_samples: int, commands: Mapping[int, bytes]) -> list[Stretch]:
    """thermometer: (blocks + 1,) codes, the first of power-up. The twin reads it just before a block's last sample, so one stretch is all but the last sample of a block and
    the next one that sample."""
    stretches = []
    for block, (code, new_code) in enumerate(zip(thermometer[:-1].tolist(), thermometer[1:].tolist())):
        first, last = block * block_samples, (block + 1) * block_samples - 1
        stretches.append(Stretch(adc[first:last], code, commands.get(block, b"")))
        stretches.append(Stretch(adc[last : last + 1], new_code))
    return stretches
