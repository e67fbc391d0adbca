"""Counts every kernel and the whole sample path on the emulated Cortex-M4."""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wineglass.commands_wire import CommandEncoder
from wineglass.cost import footprint, image, rows
from wineglass.cost.counter import Counter
from wineglass.cost.footprint import Footprint
from wineglass.cost.image import Image
from wineglass.emulation import codes
from wineglass.emulation.device import StreamDevice
from wineglass.emulation.machines import M4, STM32F405
from wineglass.errors import WineglassError

KERNELS_PROGRAM = "wineglass_kernels"
SCENARIO = "cold-start"
BLOCKS = 2000  # of 1 ms: acquisition, lock, and half a second of quiet running
SWITCH_BLOCK = 1500
STEADY_BLOCKS = 200
MODES = {"open loop, G2": {}, "force-to-rebalance": {SWITCH_BLOCK: CommandEncoder().loop("rebalance")}}


@dataclass(frozen=True)
class Count:
    """Instructions a call."""

    mean: float
    worst: int


@dataclass(frozen=True)
class Cost:
    compiler: str
    kernels: dict[str, Count]
    sample: dict[str, Count]
    """whole sample path by mode; mean of the steady state, worst of everything since power-up"""
    by_slot: dict[str, list[int]]
    """worst sample path of every sample of a slow period, steady state"""
    background: Count
    """one application_poll"""
    core: Footprint
    image: Image
    """the file that is flashed"""


def measure() -> Cost:
    M4.build()
    STM32F405.build(emulated=False)
    compiler = subprocess.run([M4.compiler, "-dumpfullversion"], capture_output=True, text=True, check=True).stdout.strip()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "calls.bin"
        kernels = _kernels(out)
        modes = {mode: _sample_path(out, commands) for mode, commands in MODES.items()}
    sample, by_slot = {}, {}
    for mode, (step, application, slots, _) in modes.items():
        sample[f"gyro_step, {mode}"], sample[f"application_sample, {mode}"] = step, application
        by_slot[mode] = slots
    background = next(iter(modes.values()))[3]
    return Cost(f"gcc {compiler}", kernels, sample, by_slot, background, footprint.measure(), image.measure())


def _kernels(out: Path) -> dict[str, Count]:
    counter = Counter([kernel.function for kernel in rows.KERNELS], out, KERNELS_PROGRAM)
    done = subprocess.run(M4.command(KERNELS_PROGRAM, counter.options), check=False)
    if done.returncode != 0:
        raise WineglassError(f"{KERNELS_PROGRAM} ended with status {done.returncode}")
    counts = counter.counts()
    return {kernel.name: _count(counts[kernel.function]) for kernel in rows.KERNELS if kernel.function in counts}


def _sample_path(out: Path, commands: dict[int, bytes]) -> tuple[Count, Count, list[int], Count]:
    """(gyro_step, everything the interrupt does, worst gyro_step by its place in the slow period, background) over a cold start."""
    recorded = codes.record(SCENARIO, BLOCKS, commands, rebalance=True)
    counter = Counter(["gyro_step", "device_sample", "application_poll"], out)
    with StreamDevice(M4, recorded.board, recorded.block, counter.options) as device:
        for stretch in recorded.stretches:
            if stretch.commands:
                device.command(stretch.commands)
            device.run(stretch.adc, stretch.thermometer)
    counts = counter.counts()
    step, steady = counts["gyro_step"], STEADY_BLOCKS * len(counts["gyro_step"]) // BLOCKS
    slots = step[-steady:].reshape(STEADY_BLOCKS, -1).max(axis=0)
    return (_count(step, steady), _count(counts["device_sample"], steady), slots.tolist(), _count(counts["application_poll"]))


def _count(calls: np.ndarray, steady: int = 0) -> Count:
    """Mean of the last `steady` calls (all, if 0), worst of all."""
    if len(calls) == 0:
        raise WineglassError("a function that is to be counted was never called")
    return Count(float(calls[-steady:].mean()), int(calls.max()))
