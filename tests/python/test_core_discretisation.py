"""Which discretisation of G2(s): the table of docs/DESIGN.md. Closed forms and scipy, float64; f = 5 kHz, Q = 1e4, fs = 50 kHz.

Two errors of H/G2 - 1: at resonance, and the worst within 5 Hz of it (20 half bandwidths: what the transient is made of).
"""

import numpy as np
import pytest
from scipy import signal

from core_library import retune

FS = 50e3
PERIOD = 1 / FS
K = 2 * np.pi * 5000.0
QUALITY = 1e4
DECAY = K / (2 * QUALITY)
OFFSETS_HZ = np.linspace(-5, 5, 2001)
OMEGA = K + 2 * np.pi * OFFSETS_HZ
AT_RESONANCE = len(OMEGA) // 2

NUMERATOR, DENOMINATOR = [1.0, 0.0], [1.0, 2 * DECAY, K**2]  # g w_b = 1 rad/s
ANALOGUE = 1j * OMEGA / (K**2 - OMEGA**2 + 2j * DECAY * OMEGA)


def digital(numerator, denominator) -> np.ndarray:
    back = np.exp(-1j * OMEGA * PERIOD)
    return np.polyval(np.flip(numerator), back) / np.polyval(np.flip(denominator), back)


def by_scipy(method: str) -> np.ndarray:
    numerator, denominator, _ = signal.cont2discrete((NUMERATOR, DENOMINATOR), PERIOD, method)
    return digital(np.squeeze(numerator), denominator)


def bilinear_prewarped() -> np.ndarray:
    rate = K / (2 * np.tan(K * PERIOD / 2))
    return digital(*signal.bilinear(NUMERATOR, DENOMINATOR, fs=rate))


def impulse_invariant() -> np.ndarray:
    damped = np.sqrt(K**2 - DECAY**2)
    pole = np.exp((-DECAY + 1j * damped) * PERIOD)
    residue = (-DECAY + 1j * damped) / (2j * damped) * PERIOD
    numerator = [2 * residue.real, -2 * (residue * pole.conjugate()).real]
    return digital(numerator, [1.0, -2 * pole.real, abs(pole)**2])


def exact_poles(numerator_shape) -> np.ndarray:
    """Numerator with two real parameters, fitted to the complex gain at K."""
    radius = np.exp(-DECAY * PERIOD)
    denominator = [1.0, -2 * radius * np.cos(K * PERIOD), radius**2]
    back = np.exp(-1j * K * PERIOD)
    wanted = ANALOGUE[AT_RESONANCE] * np.polyval(np.flip(denominator), back)
    columns = np.array([[np.polyval(np.flip(shape), back)] for shape in numerator_shape]).reshape(-1)
    a, b = np.linalg.solve(np.array([columns.real, columns.imag]), [wanted.real, wanted.imag])
    numerator = a * np.array(numerator_shape[0], float) + b * np.array(numerator_shape[1], float)
    return digital(numerator, denominator)


def ours() -> np.ndarray:
    """The documented form with unquantised coefficients."""
    radius_squared = np.exp(-2 * DECAY * PERIOD)
    gain = PERIOD / 2 * (1 - radius_squared) / (2 * DECAY * PERIOD)
    return digital([gain, 0.0, -gain], [1.0, -(1 + radius_squared) * np.cos(K * PERIOD), radius_squared])


FIRST_TWO, FIRST_AND_THIRD = ([1, 0, 0], [0, 1, 0]), ([1, 0, 0], [0, 0, 1])
TABLE = {
    "zero-order hold": (lambda: by_scipy("zoh"), 3.1e-1, 3.1e-1),
    "first-order hold": (lambda: by_scipy("foh"), 3.2e-2, 3.25e-2),
    "bilinear, prewarped": (bilinear_prewarped, 0.0, 6.5e-2),
    "impulse invariant": (impulse_invariant, 3.2e-5, 6.3e-4),
    "exact poles, numerator b0 + b1/z fitted": (lambda: exact_poles(FIRST_TWO), 0.0, 6.6e-4),
    "exact poles, numerator b0 + b2/z^2 fitted": (lambda: exact_poles(FIRST_AND_THIRD), 0.0, 7.1e-5),
    "ours": (ours, 0.0, 6.75e-5),
}


def errors(response: np.ndarray) -> tuple[float, float]:
    error = np.abs(response / ANALOGUE - 1)
    return float(error[AT_RESONANCE]), float(error.max())


@pytest.mark.parametrize("name", TABLE)
def test_table_of_the_design(name):
    make, at_resonance, near = TABLE[name]
    measured = errors(make())
    print(f"{name}: {measured[0]:.1e} at resonance, {measured[1]:.2e} within 5 Hz")
    assert measured[0] == pytest.approx(at_resonance, rel=0.05, abs=1e-9)
    assert measured[1] == pytest.approx(near, rel=0.05)


def test_the_firmwares_words_are_ours():
    coefficients = retune(5000.0, QUALITY, 0.5e-3)
    a1, eps, gain = (float(x) for x in (coefficients.a1, coefficients.eps, coefficients.gain))
    words = digital([gain, 0.0, -gain], [1.0, -a1, 1 - eps]) / (2 * 0.5e-3)  # g = 2
    assert np.abs(words / ours() - 1).max() < 2e-6
