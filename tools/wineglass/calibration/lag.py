"""The open loop's answer: one pole, tau(T) y' + y = u (paper eq 11), discretised exactly for inputs that are straight between samples."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_banded


class OnePole:
    """Applies the lag to columns.

    time_s: (n,) rising; tau_s: (n,) time constant at each sample, 0 for no lag. The state before the first sample is settled.
    """

    def __init__(self, time_s: np.ndarray, tau_s: np.ndarray):
        step_s = np.diff(time_s)
        tau_mean = 0.5 * (tau_s[1:] + tau_s[:-1])
        self._active = bool(np.any(tau_mean > 0))
        if not self._active:
            return
        x = step_s / np.maximum(tau_mean, 1e-12)
        self._decay = np.exp(-x)
        mean = -np.expm1(-x) / x
        self._from_last = mean - self._decay
        self._from_new = 1.0 - mean
        self._bands = np.ones((2, len(time_s)))
        self._bands[1, :-1] = -self._decay

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """values (n,) or (n, k) -> the same shape."""
        if not self._active:
            return values
        columns = values.reshape(len(values), -1)
        driven = np.empty_like(columns)
        driven[0] = columns[0]
        driven[1:] = self._from_last[:, None] * columns[:-1] + self._from_new[:, None] * columns[1:]
        return solve_banded((1, 0), self._bands, driven, check_finite=False).reshape(values.shape)
