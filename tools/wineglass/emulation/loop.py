"""Processor in the loop: the simulated resonator driven, sample by sample, by a device on whatever machine. Nothing runs ahead: every
force is computed from the sample before it."""

from __future__ import annotations

import numpy as np

from wineglass.emulation.device import Board, Device
from wineglass.native import library, pointer
from wineglass.scenario import Run
from wineglass.twin import resonator_cfg

_STATE = 4  # both positions and velocities


def board_of(run: Run) -> Board:
    electronics = run.device.electronics
    return Board(round(1000 * electronics.sample_rate_hz), electronics.adc.bits, electronics.dac.bits)


def close_loop(device: Device, run: Run, samples: int, thermometer: int, rate_rad_s: float = 0.0) -> np.ndarray:
    """Codes of every sample, (samples, 4) int32: ADC primary and secondary, DAC drive and rebalance. Converters without noise."""
    board, cfg = board_of(run), resonator_cfg(run)
    adc_full, dac_full = 2 ** (board.adc_bits - 1), 2 ** (board.dac_bits - 1)
    codes = np.zeros((samples, 4), np.int32)
    state, trajectory, forces = np.zeros(_STATE), np.zeros((1, _STATE)), np.zeros((1, 2))
    rate, slope, shell = np.array([rate_rad_s]), np.zeros(1), np.array([run.initial_degc])
    arguments = [pointer(array, "double") for array in (shell, rate, slope, forces, state, trajectory)]
    plant_run, rate_hz = library().plant_run, board.sample_rate_millihz / 1000.0
    for row in codes:
        if plant_run(cfg, rate_hz, 1, 1, *arguments) != 0:
            raise ValueError("the plant refused its inputs")
        row[:2] = np.clip(np.rint(trajectory[0, [0, 2]] * adc_full), -adc_full, adc_full - 1)
        row[2:] = device.run(row[None, :2], thermometer)[0]
        forces[0] = row[2:] / dac_full
    return codes
