"""Noise of every slow channel as the described device should have it: a short run of the full twin at rest, what the description grants beside it
(described_noise.py), and an autoregressive model of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.linalg import solve_toeplitz

from wineglass import calibration_block
from wineglass.diagnosis import channels, described_noise
from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.noise_added import Added
from wineglass.envelope import Envelope
from wineglass.profiles import ConstantRate, ConstantTemperature
from wineglass.scenario import Run
from wineglass.schedule import LoopCommand
from wineglass.simulation import in_memory

REST_FRAMES = 280
LEFT_OUT_S = 4.0
ORDER, SHORT_ORDER = 120, 4  # of the whole noise, which is slow; of what the short run shows
DENSITIES, ADDED_AT = 1 << 14, 48  # of a spectrum up to half the frame rate; of what is smooth in it
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
        count = series.shape[-1]
        length = fft.next_fast_len(count + ORDER, real=True)
        taps = fft.rfft(np.concatenate([[1.0], -self.coefficients[channel]]) / self.innovation[channel], length)
        return fft.irfft(fft.rfft(series, length) * taps, length)[..., :count]

    def independent(self, channel: int) -> float:
        """Which share of its frames count when a mean of squares is taken: noise that wanders repeats itself."""
        density = 1.0 / np.abs(fft.fft(np.concatenate([[1.0], -self.coefficients[channel]]), 2 * DENSITIES)) ** 2
        return float(np.mean(density) ** 2 / np.mean(density**2))


def at_rest(driven: Driven, grid: Grid, names: tuple[str, ...], loops: frozenset[str], added: Added | None = None) -> Floor:
    """The floor of `names`, from the described device standing still at its calibration temperature. Where it ran in both loops, every
    channel counts in the loop in which it moves: `counts_in`. added: noise that this recording is known to have beside."""
    found = {loop: _resting(driven, grid, names, loop, added) for loop in loops}
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


def _resting(driven: Driven, grid: Grid, names: tuple[str, ...], loop: str, added: Added | None) -> Floor:
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
    freq_hz = np.arange(1, DENSITIES + 1) / (2.0 * DENSITIES * grid.frame_s)
    slow = described_noise.densities(Run(resting, run.device, run.truth), driven, grid.frame_s, names, freq_hz)
    if added is not None:
        few_hz = np.geomspace(freq_hz[0], freq_hz[-1], ADDED_AT)
        more = added.densities(run.device, calibration_block.from_binary(driven.calibration_block), loop, grid.frame_s, names, few_hz)
        slow = slow + np.array([np.interp(freq_hz, few_hz, row) for row in more])
    return _model(frames, {name: quiet[name] for name in names}, names, _covariances(slow, grid))


def _covariances(densities: np.ndarray, grid: Grid) -> np.ndarray:
    """(channels, ORDER + 1) at lags of whole frames. What takes longer than the record is none of its noise."""
    freq_hz = np.arange(DENSITIES + 1) / (2.0 * DENSITIES * grid.frame_s)
    whole = np.pad(densities, ((0, 0), (1, 0)))
    whole[:, freq_hz < 0.5 / (grid.count * grid.frame_s)] = 0.0
    return fft.irfft(whole, axis=1)[:, : ORDER + 1] / (2.0 * grid.frame_s)


def _model(frames: Frames, quiet: dict[str, np.ndarray], names: tuple[str, ...], slow: np.ndarray) -> Floor:
    """Noise: full twin minus envelope twin, so that transients of the start are no noise; and what is described beside it, (channels, ORDER + 1)."""
    rows = []
    for name, covariance in zip(names, slow, strict=True):
        use = (frames.grid.time_s > LEFT_OUT_S) & frames.use[frames.names.index(name)]
        rows.append(_with_slow(_autoregression(_detrended((frames[name] - quiet[name][: frames.grid.count])[use])), covariance))
    rms, innovation, coefficients = zip(*rows, strict=True)
    return Floor(np.array(rms), np.array(innovation), np.array(coefficients))


def _detrended(values: np.ndarray) -> np.ndarray:
    basis = np.vander(np.linspace(-1.0, 1.0, len(values)), 4)
    return values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0]


def _autoregression(noise: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Yule-Walker. rms, innovation, coefficients; zeros for a channel without noise."""
    n = len(noise)
    covariance = np.array([noise[: n - lag] @ noise[lag:] / n for lag in range(SHORT_ORDER + 1)])
    if covariance[0] <= 0.0:
        return 0.0, 0.0, np.zeros(SHORT_ORDER)
    coefficients = solve_toeplitz(covariance[:SHORT_ORDER], covariance[1:])
    variance = covariance[0] - coefficients @ covariance[1:]
    rms = float(np.sqrt(covariance[0]))
    return rms, max(float(np.sqrt(max(variance, 0.0))), LEAST_INNOVATION * rms), coefficients


def _with_slow(short: tuple[float, float, np.ndarray], slow: np.ndarray) -> tuple[float, float, np.ndarray]:
    """rms, innovation and coefficients (ORDER,) of the sum of an autoregressive noise and of one with these covariances (ORDER + 1,)."""
    if short[0] == 0.0:
        return 0.0, 0.0, np.zeros(ORDER)
    covariance = slow + _covariance_of(short)
    coefficients = solve_toeplitz(covariance[:ORDER], covariance[1:])
    variance = covariance[0] - coefficients @ covariance[1:]
    return float(np.sqrt(covariance[0])), float(np.sqrt(variance)), coefficients


def _covariance_of(short: tuple[float, float, np.ndarray]) -> np.ndarray:
    """(ORDER + 1,) of an autoregressive noise."""
    _, innovation, coefficients = short
    response = fft.rfft(np.concatenate([[1.0], -coefficients]), 2 * DENSITIES)
    return fft.irfft(innovation**2 / np.abs(response) ** 2)[: ORDER + 1]
