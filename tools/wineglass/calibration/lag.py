"""The open loop's answer: one pole, tau(T) y' + y = u (paper eq 11), discretised exactly for inputs that are straight between samples,
and the constant delay of the output filter after it."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_banded


class Lag:
    """Applies lag and delay to columns.

    time_s: (n,) rising; tau_s: (n,) time constant at each sample, 0 for no lag; delay_s: on top. The state before the first sample is
    settled.
    """

    def __init__(self, time_s: np.ndarray, tau_s: np.ndarray, delay_s: float = 0.0):
        step_s = np.diff(time_s)
        self._prepare_delay(time_s, delay_s)
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
        return self._delayed(self._lagged(values))

    def _prepare_delay(self, time_s: np.ndarray, delay_s: float) -> None:
        self._delays = delay_s > 0.0
        if self._delays:
            wanted = np.maximum(time_s - delay_s, time_s[0])
            self._before = np.clip(np.searchsorted(time_s, wanted, side="right") - 1, 0, len(time_s) - 2)
            self._fraction = (wanted - time_s[self._before]) / (time_s[self._before + 1] - time_s[self._before])

    def _delayed(self, values: np.ndarray) -> np.ndarray:
        if not self._delays:
            return values
        fraction = self._fraction.reshape(-1, *[1] * (values.ndim - 1))
        return (1.0 - fraction) * values[self._before] + fraction * values[self._before + 1]

    def _lagged(self, values: np.ndarray) -> np.ndarray:
        if not self._active:
            return values
        columns = values.reshape(len(values), -1)
        driven = np.empty_like(columns)
        driven[0] = columns[0]
        driven[1:] = self._from_last[:, None] * columns[:-1] + self._from_new[:, None] * columns[1:]
        return solve_banded((1, 0), self._bands, driven, check_finite=False).reshape(values.shape)
