"""Noise of every slow channel as the described device should have it: a short run of the full twin at rest, and an autoregressive model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz

from wineglass.diagnosis import channels
from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.drive import Driven
from wineglass.envelope import Envelope
from wineglass.profiles import ConstantRate, ConstantTemperature
from wineglass.scenario import Run
from wineglass.schedule import LoopCommand
from wineglass.simulation import in_memory

REST_FRAMES = 280
LEFT_OUT_S = 4.0
ORDER = 4
SEED = 7
LEAST_INNOVATION = 0.2  # of the rms: a channel that seems more predictable than that was only short


@dataclass(frozen=True)
class Floor:
    """Per channel: rms of a frame's noise, of what is new in it (innovation), and the autoregressive coefficients (order,)."""

    rms: np.ndarray
    innovation: np.ndarray
    coefficients: np.ndarray

    def whiten(self, channel: int, series: np.ndarray) -> np.ndarray:
        """Series (..., n) in the channel's unit -> innovations in units of the floor."""
        white = np.array(series, dtype=np.float64)
        for lag, coefficient in enumerate(self.coefficients[channel], start=1):
            white[..., lag:] -= coefficient * series[..., :-lag]
        white /= self.innovation[channel]
        return white


def at_rest(driven: Driven, grid: Grid, names: tuple[str, ...], loops: frozenset[str]) -> Floor:
    """The floor of `names`, from the described device standing still at its calibration temperature. Where it ran in both loops, every
    channel counts in the loop in which it moves: `counts_in`."""
    found = {loop: _resting(driven, grid, names, loop) for loop in loops}
    one = next(iter(found.values()))
    if len(found) == 1:
        return one
    rows = [found["rebalance" if name.startswith("rebalance") else "open"] for name in names]
    return Floor(np.array([f.rms[i] for i, f in enumerate(rows)]), np.array([f.innovation[i] for i, f in enumerate(rows)]),
                 np.array([f.coefficients[i] for i, f in enumerate(rows)]))


def counts_in(name: str) -> str | None:
    """The loop in which a channel says something, None: in both. Held at rest, the secondary shows its own noise only."""
    if name.startswith("secondary"):
        return "open"
    return "rebalance" if name.startswith("rebalance") else None


def _resting(driven: Driven, grid: Grid, names: tuple[str, ...], loop: str) -> Floor:
    run = driven.run
    held = ConstantTemperature(value_degc=run.device.resonator.reference_temperature_degc, acts_on=run.scenario.temperature.acts_on)
    resting = run.scenario.model_copy(update={
        "duration_s": LEFT_OUT_S + REST_FRAMES * grid.frame_s, "seed": SEED, "temperature": held, "rate": ConstantRate(),
        "command": [LoopCommand(at_s=0.0, mode=loop)]})
    frames = channels.read(in_memory(Run(resting, run.device, run.truth), calibration_block=driven.calibration_block),
                           Grid(grid.frame_s, 0, int(resting.duration_s / grid.frame_s)))
    ticks = max(1, round(grid.frame_s * run.device.slow_rate_hz))
    with Envelope(Run(resting, run.device, run.truth), calibration_block=driven.calibration_block, frame_ticks=ticks) as envelope:
        quiet = envelope.run()
    return _model(frames, {name: quiet[name] for name in names}, names)


def _model(frames: Frames, quiet: dict[str, np.ndarray], names: tuple[str, ...]) -> Floor:
    """Noise: full twin minus envelope twin, so that transients of the start are no noise."""
    rows = []
    for name in names:
        use = (frames.grid.time_s > LEFT_OUT_S) & frames.use[frames.names.index(name)]
        rows.append(_autoregression(_detrended((frames[name] - quiet[name][: frames.grid.count])[use])))
    rms, innovation, coefficients = zip(*rows, strict=True)
    return Floor(np.array(rms), np.array(innovation), np.array(coefficients))


def _detrended(values: np.ndarray) -> np.ndarray:
    basis = np.vander(np.linspace(-1.0, 1.0, len(values)), 4)
    return values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0]


def _autoregression(noise: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Yule-Walker. rms, innovation, coefficients; zeros for a channel without noise."""
    n = len(noise)
    covariance = np.array([noise[: n - lag] @ noise[lag:] / n for lag in range(ORDER + 1)])
    if covariance[0] <= 0.0:
        return 0.0, 0.0, np.zeros(ORDER)
    coefficients = solve_toeplitz(covariance[:ORDER], covariance[1:])
    variance = covariance[0] - coefficients @ covariance[1:]
    rms = float(np.sqrt(covariance[0]))
    return rms, max(float(np.sqrt(max(variance, 0.0))), LEAST_INNOVATION * rms), coefficients
