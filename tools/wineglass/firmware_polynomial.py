"""The firmware's own thermal polynomial (firmware/core/thermal_polynomial.h), applied to arrays of temperatures."""

from __future__ import annotations

import numpy as np

from wineglass import calibration_block
from wineglass.errors import BadInput
from wineglass.native import library, pointer

SHIFT_ONE = 2.0**20  # temperature shift, Q20 degC
RATE_ONE = 2.0**31  # bias, Q31 rad/s
MAX_SHIFT_DEGC = 128.0


def bias_rad_s(coefficients: np.ndarray, shift_degc: np.ndarray) -> np.ndarray:
    """sum c_i shift^i as the firmware computes it: coefficients (k,) in rad/s/degC^i, shift (n,) in degC -> (n,) in rad/s.

    BadInput when a coefficient, a temperature or the result does not fit the firmware's formats.
    """
    if len(coefficients) > calibration_block.MAX_ORDER + 1:
        raise BadInput(f"order {len(coefficients) - 1} is beyond the firmware's", "thermal polynomial", f"use at most {calibration_block.MAX_ORDER}")
    if np.max(np.abs(shift_degc), initial=0.0) >= MAX_SHIFT_DEGC:
        raise BadInput(f"a temperature is {MAX_SHIFT_DEGC:g} degC or more from the calibration temperature", "thermal polynomial",
                       "choose a calibration temperature nearer to the middle")
    coef = np.zeros(calibration_block.MAX_ORDER + 1, np.int32)
    for i, value in enumerate(coefficients):
        coef[i] = calibration_block.polynomial_coefficient("bias_rad_s", i, float(value))
    shift = np.round(np.asarray(shift_degc) * SHIFT_ONE).astype(np.int32)
    out = np.empty(len(shift), np.int32)
    clamped = library().wg_thermal_polynomial_eval(
        pointer(coef, "int32_t"), len(coefficients) - 1, pointer(shift, "int32_t"), pointer(out, "int32_t"), len(shift)
    )
    if clamped != 0:
        raise BadInput(f"{clamped} results leave the firmware's range of 1 rad/s", "thermal polynomial", "lower the order of the fit")
    return out / RATE_ONE
