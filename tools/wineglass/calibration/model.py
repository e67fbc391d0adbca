"""What a gyro's rate channel shows at a given temperature and true rate, and its least-squares fit.

    measured = gain(T) W[ (true rate + bias(T)) / (gain(T) scale(T)) ]        W: the open loop's one-pole lag, tau(T)

seen `delay` later than the model's own lag says (thermometer and rate are not stamped at the same instant, thermometers lag). bias and
scale are polynomials in the temperature. For the in-phase ratio gain = 1 and scale is in rad/s per unit of ratio. For a
rate channel gain(T) is the scale factor that the firmware has multiplied with, and scale is the correction to it: 1 where no moving
rate can show it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre, Polynomial

from wineglass.calibration.lag import Lag


DELAY_SIGNIFICANCE = 4.0


@dataclass(frozen=True)
class Terms:
    """Orders of the two polynomials; scale None: scale is 1 and not fitted. delay: is it fitted, too?

    The coefficients stand in one vector: bias, scale, delay.
    """

    bias: int
    scale: int | None = None
    delay: bool = False

    @property
    def polynomials(self) -> int:
        return self.bias + 1 + (0 if self.scale is None else self.scale + 1)

    @property
    def count(self) -> int:
        return self.polynomials + int(self.delay)


class Basis:
    """Legendre polynomials over the record's temperatures: well conditioned up to any order of use here.

    shift_degc: (n,) temperature minus the calibration temperature
    """

    def __init__(self, shift_degc: np.ndarray):
        low, high = float(shift_degc.min()), float(shift_degc.max())
        self.domain = [low, high] if high > low else [low - 0.5, high + 0.5]

    def columns(self, shift_degc: np.ndarray, order: int) -> np.ndarray:
        """(n, order + 1)"""
        x = (2.0 * shift_degc - sum(self.domain)) / (self.domain[1] - self.domain[0])
        return np.polynomial.legendre.legvander(x, order)

    def to_powers(self, order: int) -> np.ndarray:
        """Matrix (order + 1, order + 1): Legendre coefficients -> coefficients of shift^i."""
        matrix = np.zeros((order + 1, order + 1))
        for i in range(order + 1):
            powers = Legendre.basis(i, domain=self.domain).convert(kind=Polynomial).coef
            matrix[: len(powers), i] = powers
        return matrix


@dataclass(frozen=True)
class Model:
    """All arrays (n,). `measured` must be finite where it is used."""

    basis: Basis
    time_s: np.ndarray
    shift_degc: np.ndarray
    true_rate_rad_s: np.ndarray
    gain: np.ndarray
    lag: Lag

    def evaluate(self, terms: Terms, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(prediction (n,), its derivatives (n, terms.count)) at the coefficients theta (terms.count,)."""
        columns = self.basis.columns(self.shift_degc, max(terms.bias, terms.scale or 0))
        bias_columns = columns[:, : terms.bias + 1]
        total = self.true_rate_rad_s + bias_columns @ theta[: terms.bias + 1]
        if terms.scale is None:
            inner = np.column_stack([total, bias_columns]) / self.gain[:, None]
        else:
            scale_columns = columns[:, : terms.scale + 1]
            scale = scale_columns @ theta[terms.bias + 1 : terms.polynomials]
            inner = np.column_stack([total, bias_columns, -scale_columns * (total / scale)[:, None]])
            inner /= (self.gain * scale)[:, None]
        lagged = self.gain[:, None] * self.lag(inner)
        if not terms.delay:
            return lagged[:, 0], lagged[:, 1:]
        slope = np.gradient(lagged, self.time_s, axis=0)
        lagged -= theta[-1] * slope
        return lagged[:, 0], np.column_stack([lagged[:, 1:], -slope[:, 0]])

    def start(self, terms: Terms, measured: np.ndarray, use: np.ndarray) -> np.ndarray:
        """A first guess: no bias, constant scale."""
        theta = np.zeros(terms.count)
        if terms.scale is not None:
            seen = self.gain * self.lag(self.true_rate_rad_s / self.gain)
            slope = np.sum(seen[use] * measured[use]) / np.sum(seen[use] ** 2)
            theta[terms.bias + 1] = 1.0 / slope if slope else 1.0
        return theta


def needs_delay(model: Model, terms: Terms, measured: np.ndarray, use: np.ndarray) -> bool:
    """Is a delay seen, DELAY_SIGNIFICANCE times its error by plain least squares (with as many samples as there are)?"""
    theta = fit(model, terms, measured, use)
    wider = Terms(terms.bias, terms.scale, delay=True)
    prediction, jacobian = model.evaluate(wider, np.append(theta, 0.0))
    norms = np.linalg.norm(jacobian[use], axis=0)
    if not norms[-1] > 0:
        return False
    design, residual = jacobian[use] / norms, (measured - prediction)[use]
    step, _, rank, _ = np.linalg.lstsq(design, residual, rcond=None)
    if rank < wider.count:
        return False
    rest = residual - design @ step
    error = np.sqrt(np.linalg.inv(design.T @ design)[-1, -1] * (rest @ rest) / max(1, len(rest) - wider.count))
    return bool(abs(step[-1]) > DELAY_SIGNIFICANCE * error)


def fit(model: Model, terms: Terms, measured: np.ndarray, use: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
    """Least squares over the samples `use` (mask (n,)); Gauss-Newton, exact at the first step where only the bias is fitted."""
    theta = model.start(terms, measured, use) if start is None else start
    for _ in range(1 if terms.scale is None and not terms.delay else 12):
        prediction, jacobian = model.evaluate(terms, theta)
        step = np.linalg.lstsq(jacobian[use], (measured - prediction)[use], rcond=None)[0]
        theta = theta + step
        if np.linalg.norm(jacobian[use] @ step) <= 1e-9 * np.linalg.norm(measured[use]):
            break
    return theta
