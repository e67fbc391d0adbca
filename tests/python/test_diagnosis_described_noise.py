"""The slow noise that a description grants, against the Allan deviation that it is described by; whitening against noise made from its covariances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import cholesky, toeplitz

from wineglass import protocols, scenario
from wineglass.diagnosis import described_noise, drive, floors
from wineglass.diagnosis.channels import Grid
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.floors import DENSITIES, ORDER, Floor
from wineglass.profiles import ConstantRate, ConstantTemperature
from wineglass.scenario import Run

SEED = 17
FRAME_S = 0.24
FREQ_HZ = np.arange(1, DENSITIES + 1) / (2.0 * DENSITIES * FRAME_S)


def resting() -> Run:
    run = scenario.prepare(protocols.scenario("operating", device="metal-fast", seed=1))
    still = run.scenario.model_copy(update={"temperature": ConstantTemperature(acts_on="shell"), "rate": ConstantRate(), "command": []})
    return replace(run, scenario=still)


def driven(run: Run) -> Driven:
    return Driven(run, drive._nominal_block(run), "shell_temperature", True)


def allan_deviation(density: np.ndarray, tau_s: float) -> float:
    """Of noise with that one-sided density at FREQ_HZ (IEEE Std 952, annex C): by quadrature."""
    angle = np.pi * FREQ_HZ * tau_s
    return float(np.sqrt(2.0 * np.trapezoid(density * np.sin(angle) ** 4 / angle**2, FREQ_HZ)))


def test_densities_have_the_described_allan_deviation() -> None:
    run = resting()
    names = ("temperature_measured", "drive_frequency", "secondary_in_phase", "drive_level")
    found = described_noise.densities(run, driven(run), FRAME_S, names, FREQ_HZ)
    floor, resonator = run.device.noise_floor, run.device.resonator
    assert allan_deviation(found[0], 20.0) == pytest.approx(floor.temperature_degc, rel=0.05)
    assert allan_deviation(found[1], 20.0) == pytest.approx(1e-6 * floor.frequency_ppm * resonator.frequency_hz, rel=0.05)


def test_flicker_of_the_bias_passes_through_the_secondary_s_own_decay() -> None:
    """Open loop the secondary is a low-pass of its decay rate: half the power at that frequency."""
    run = resting()
    found = described_noise.densities(run, driven(run), FRAME_S, ("secondary_in_phase",), FREQ_HZ)[0]
    resonator = run.device.resonator
    corner_hz = resonator.frequency_hz / (2.0 * resonator.q)
    gain = found * FREQ_HZ
    low = float(np.mean(gain[FREQ_HZ < 0.05 * corner_hz]))
    assert float(np.interp(corner_hz, FREQ_HZ, gain)) == pytest.approx(0.5 * low, rel=0.1)


def test_whitening_leaves_white_noise_of_size_one() -> None:
    rng = np.random.default_rng(SEED)
    density = 1e-6 / FREQ_HZ
    grid = Grid(FRAME_S, 0, 2400)
    slow = floors._covariances(density[None], grid)[0]
    rms, innovation, coefficients = floors._with_slow((1e-3, 1e-3, np.zeros(floors.SHORT_ORDER)), slow)
    floor = Floor(np.array([rms]), np.array([innovation]), coefficients[None])
    count = ORDER + 1
    noise = cholesky(toeplitz(slow + np.eye(1, count)[0] * 1e-6), lower=True) @ rng.standard_normal((count, 4000))
    white = floor.whiten(0, noise.T)[:, -1]
    assert np.std(white) == pytest.approx(1.0, abs=0.04)
    before = floor.whiten(0, noise.T)[:, -2]
    assert abs(np.mean(white * before)) < 0.05
