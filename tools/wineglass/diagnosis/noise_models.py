"""What a remainder may look like: white noise plus a correlated part of one of three classes.

    floor     a Gauss-Markov process no larger than the noise of one sample: any gyro has that much
    flicker   a sum of Gauss-Markov processes over all time scales, larger than that: the bias wanders
    other     a smooth Gaussian process (Matern 3/2), larger than that: something that no effect explains

Amplitudes of the correlated part are in units of the noise of one sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

FLOOR_AMPLITUDES = (0.1, 0.3, 1.0)
LARGE_AMPLITUDES = (2.0, 5.0, 12.0, 30.0, 80.0)
CLASSES = ("floor", "flicker", "other")
CLASS_PRIOR = {"floor": 0.7, "flicker": 0.1, "other": 0.2}


@dataclass(frozen=True)
class NoiseModel:
    """covariance (n, n) in units of white_rad_s^2; log_prior includes that of its class."""

    kind: str
    amplitude: float
    correlation_time_s: float
    covariance: np.ndarray
    log_prior: float

    def whitener(self, rows: np.ndarray) -> tuple[np.ndarray, float]:
        """(Cholesky factor of the rows' covariance, its log determinant)"""
        factor = np.linalg.cholesky(self.covariance[np.ix_(rows, rows)])
        return factor, 2.0 * float(np.sum(np.log(np.diag(factor))))


def whiten(factor: np.ndarray, columns: np.ndarray) -> np.ndarray:
    return solve_triangular(factor, columns, lower=True, check_finite=False)


def candidates(time_s: np.ndarray, relative_sample_noise: float) -> list[NoiseModel]:
    """relative_sample_noise: noise of one sample over that of a block mean."""
    span = float(time_s[-1] - time_s[0])
    distance = np.abs(time_s[:, None] - time_s[None, :])
    taus = span * np.array([0.01, 0.04, 0.16])
    eye = np.eye(len(time_s))

    def models(kind: str, pairs: list[tuple[float, float, np.ndarray]]) -> list[NoiseModel]:
        log_prior = float(np.log(CLASS_PRIOR[kind] / len(pairs)))
        return [NoiseModel(kind, a, tau, eye + (a * relative_sample_noise) ** 2 * shape, log_prior) for a, tau, shape in pairs]

    markov = {tau: np.exp(-distance / tau) for tau in taus}
    flicker = np.mean([np.exp(-distance / tau) for tau in span * np.geomspace(0.005, 1.0, 6)], axis=0)
    smooth = {tau: (1.0 + distance / tau) * np.exp(-distance / tau) for tau in span * np.array([0.02, 0.06, 0.18])}
    floor = [(0.0, 0.0, np.zeros_like(eye))] * 4  # half of the class's weight on purely white noise
    floor += [(a, tau, shape) for a in FLOOR_AMPLITUDES for tau, shape in markov.items()]
    return _merged(models("floor", floor)) + models("flicker", [(a, span, flicker) for a in LARGE_AMPLITUDES]) + models(
        "other", [(a, tau, shape) for a in LARGE_AMPLITUDES for tau, shape in smooth.items()])


def _merged(models: list[NoiseModel]) -> list[NoiseModel]:
    """White noise once, with the weight of all its copies."""
    white = [m for m in models if m.amplitude == 0.0]
    first = white[0]
    return [NoiseModel(first.kind, 0.0, 0.0, first.covariance, first.log_prior + float(np.log(len(white))))] + [
        m for m in models if m.amplitude > 0.0
    ]
