"""How coarse a table's numbers are, and what that does. A step is no gap where nobody said how fine the readings should be: it is said in a note."""

from __future__ import annotations

import numpy as np

REPEATED = 3.0  # times that a value is read on average: below that the digits are finer than what moves the readings
ON_STEP = 0.02
LEAST_ON_STEP = 0.9


def step_of(values: np.ndarray) -> float | None:
    """The step of which nearly all differences between readings (n,) are multiples; None where there is none to be seen."""
    levels = np.unique(values)
    if len(levels) < 3 or len(values) < REPEATED * len(levels):
        return None
    distances = np.diff(levels)
    distances = distances[distances > 1e-9 * float(np.max(np.abs(levels)))]
    if len(distances) == 0:
        return None
    step = float(np.quantile(distances, 0.1))
    turns = distances / step
    near = np.abs(turns - np.round(turns)) < ON_STEP * np.maximum(1.0, np.round(turns))
    return step if float(np.mean(near)) >= LEAST_ON_STEP else None


def notes(temperature_degc: np.ndarray, rate_rad_s: np.ndarray, noise_rad_s: float) -> list[str]:
    """All samples (n,) of both; noise_rad_s: of one sample of the rate."""
    found = []
    thermometer, rate = step_of(temperature_degc), step_of(rate_rad_s)
    if thermometer is not None and np.ptp(temperature_degc) > 0.0:
        curve = np.polynomial.Polynomial.fit(temperature_degc, rate_rad_s, min(3, len(np.unique(temperature_degc)) - 1)).deriv()(temperature_degc)
        error = float(np.sqrt(np.mean(curve**2))) * thermometer / np.sqrt(12.0)
        found.append(f"the thermometer reads in steps of {thermometer:.3g} degC: over the bias' slope that is {error:.2g} rad/s rms, where a sample's noise is "
                     f"{noise_rad_s:.2g}; nobody said how fine it should be, so that thermometer_quantisation is not named")
    if rate is not None and rate > noise_rad_s:
        found.append(f"the rate has steps of {rate:.3g} rad/s, more than its noise: what is smaller cannot be seen in single samples")
    return found
