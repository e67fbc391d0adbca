"""Evidence as a few hundred block means, with the white noise measured inside the blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wineglass.calibration.branches import Branch, find_branches
from wineglass.diagnosis.evidence import PAUSE_S, Evidence

BLOCKS = 240
FINE = 8  # fine means per block: the paths of lag and play are followed on these
LEAST_SAMPLES = 160
STEADY_DEGC = 1.0  # within that the temperature has no branches
_TINY = 1e-12  # of the rate's spread: noise of data without any


@dataclass(frozen=True)
class Blocks:
    """Coarse arrays (n,), fine arrays (n * per_block,).

    white_rad_s: noise of a block mean; sample_noise_rad_s: noise of one sample, from neighbours
    residual_rad_s: rate minus true rate minus the calibrated bias
    """

    evidence: Evidence
    per_block: int
    samples_per_block: float
    time_s: np.ndarray
    temperature_degc: np.ndarray
    residual_rad_s: np.ndarray
    white_rad_s: float
    sample_noise_rad_s: float
    fine_time_s: np.ndarray
    fine_temperature_degc: np.ndarray
    fine_measured_degc: np.ndarray | None
    fine_true_rate: np.ndarray | None
    fine_slope: np.ndarray | None
    branches: list[Branch]
    """of the blocks; turns shorter than a tenth of the record belong to the branch before"""
    segment: np.ndarray
    """number of the power-up of each block"""
    edges: np.ndarray
    """first sample of every fine mean, and the end"""
    fine_uncertain: np.ndarray | None = None
    """(n * per_block, k): what one standard deviation of every uncertain value does, where the device is described"""

    def __len__(self) -> int:
        return len(self.time_s)

    def fine(self, values: np.ndarray) -> np.ndarray:
        """(samples, ...) -> (n * per_block, ...)"""
        return _fine(values, self.edges)

    def mean(self, fine: np.ndarray) -> np.ndarray:
        """(n * per_block, ...) -> (n, ...)"""
        return fine.reshape(len(self), self.per_block, *fine.shape[1:]).mean(axis=1)


def make_blocks(evidence: Evidence) -> Blocks | None:
    """None where there are too few samples."""
    count = len(evidence.time_s)
    if count < LEAST_SAMPLES:
        return None
    per_block = FINE if count >= FINE * 60 else 2
    blocks = min(BLOCKS, count // per_block)
    edges = np.linspace(0, count, blocks * per_block + 1).astype(int)

    def fine(values: np.ndarray) -> np.ndarray:
        return _fine(values, edges)

    residual = evidence.measured_minus_reference - (0.0 if evidence.bias_rad_s is None else evidence.bias_rad_s)
    time_s, temperature, fine_residual = fine(evidence.time_s), fine(evidence.temperature_degc), fine(residual)
    coarse = temperature.reshape(blocks, per_block).mean(axis=1)
    coarse_time = time_s.reshape(blocks, per_block).mean(axis=1)
    fold = fine_residual.reshape(blocks, per_block)
    spread = float(np.std(residual)) + 1e-300
    return Blocks(
        evidence=evidence,
        per_block=per_block,
        samples_per_block=count / blocks,
        time_s=coarse_time,
        temperature_degc=coarse,
        residual_rad_s=fold.mean(axis=1),
        white_rad_s=max(_white(fold), _TINY * spread),
        sample_noise_rad_s=max(_sample_noise(residual), _TINY * spread),
        fine_time_s=time_s,
        fine_temperature_degc=temperature,
        fine_measured_degc=None if evidence.measured_degc is None else fine(evidence.measured_degc),
        fine_true_rate=None if evidence.true_rate_rad_s is None else fine(evidence.true_rate_rad_s),
        fine_slope=None if evidence.bias_slope is None else fine(evidence.bias_slope),
        branches=_long_branches(coarse),
        segment=_segments(evidence.time_s, coarse_time),
        edges=edges,
        fine_uncertain=None if evidence.expected is None else fine(evidence.expected.uncertain),
    )


def _fine(values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    return (np.add.reduceat(values, edges[:-1], axis=0).T / np.diff(edges)).T


def _white(fold: np.ndarray) -> float:
    """Noise of a block's mean from the scatter of its fine means about a straight line (about the mean, where there are two)."""
    count = fold.shape[1]
    if count > 3:
        x = np.arange(count) - 0.5 * (count - 1)
        rest = fold - fold.mean(axis=1, keepdims=True) - np.outer(fold @ x / (x @ x), x)
        variance = np.sum(rest**2, axis=1) / (count - 2)
    else:
        step = np.diff(fold, axis=1)[:, 0]
        variance = 0.5 * (step - np.median(step)) ** 2
    usual = np.mean(np.sort(variance)[: max(1, int(0.9 * len(variance)))])  # a step inside a block is no noise
    return float(np.sqrt(usual / 0.87 / count)) if count > 3 else float(np.sqrt(usual / 0.62 / count))


def _sample_noise(values: np.ndarray) -> float:
    """From second differences: a slope does not count, and few outliers hardly do."""
    second = np.diff(values, 2) / np.sqrt(6.0)
    return float(np.median(np.abs(second)) / 0.6745)


def _long_branches(temperature: np.ndarray) -> list[Branch]:
    if np.ptp(temperature) < STEADY_DEGC:
        return [Branch("heating", 0, len(temperature))]
    merged: list[Branch] = []
    for branch in find_branches(temperature):
        if merged and branch.stop - branch.start < 0.08 * len(temperature):
            merged[-1] = Branch(merged[-1].kind, merged[-1].start, branch.stop)
        else:
            merged.append(branch)
    return merged


def _segments(sample_time_s: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    steps = np.diff(sample_time_s)
    pause = np.flatnonzero(steps > PAUSE_S + 20.0 * np.median(steps))
    return np.searchsorted(sample_time_s[pause + 1], time_s, side="right")
