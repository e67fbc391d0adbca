"""Rounding noise of the decoupler near the carrier, against the same difference equation in long double by scipy's float64 filter where
that is enough and by numpy's extended precision where it is not. Promise `decoupler noise`: -215 dBFS within 50 Hz of the carrier.
"""

import numpy as np
import pytest

from core_library import SAMPLE_RATE_HZ, library, pointer, retune

WINDOW = 1 << 18
BAND_HZ = 50.0


def carrier_codes(freq_hz: float, count: int, noisy: bool) -> np.ndarray:
    """A carrier of 0.9 of full scale as left-justified codes: 16 bit with 90 dB of noise, or 32 bit and clean."""
    phase = 2 * np.pi * np.remainder(np.arange(count) * (freq_hz / SAMPLE_RATE_HZ), 1.0)
    value = 0.9 * np.cos(phase)
    if not noisy:
        return np.round(value * (2**31 - 1)).astype(np.int32)
    noise = np.random.default_rng(1).standard_normal(count) * np.sqrt(0.5) * 10**-4.5
    return (np.round((value + noise) * 2**15).astype(np.int64) * 2**16).astype(np.int32)


def run(coefficients, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rounded output (Q31) and output before rounding (Q61)."""
    rounded, exact = np.zeros(len(codes), np.int32), np.zeros(len(codes), np.int64)
    overflow = library().core_decoupler(pointer(coefficients.words, "int32_t"), pointer(codes, "int32_t"), len(codes),
                                        pointer(rounded, "int32_t"), pointer(exact, "int64_t"))
    assert not overflow
    return rounded, exact


def residual(coefficients, exact_q61: np.ndarray, codes: np.ndarray) -> np.ndarray:
    """What the exact output differs by from the difference equation put to its own past: the recursion's rounding errors (extended
    precision, of full scale), one a sample."""
    y = exact_q61.astype(np.longdouble) / 2**61
    x = coefficients.gain * codes.astype(np.longdouble) / 2**31

    def past(values, samples):
        return np.concatenate([np.zeros(samples, np.longdouble), values[:-samples]])

    return y - coefficients.a1 * past(y, 1) + (1 - coefficients.eps) * past(y, 2) - (x - past(x, 2))


def band_power_dbfs(error: np.ndarray, freq_hz: float, response=None) -> float:
    """Power within the band around the carrier, 0 dBFS = a full-scale sine; `response` weights the spectrum."""
    window = np.hanning(len(error))
    spectrum = np.fft.rfft(error.astype(np.float64) * window)
    at = np.fft.rfftfreq(len(error), 1 / SAMPLE_RATE_HZ)
    if response is not None:
        spectrum = spectrum * response(at)
    near = np.abs(at - freq_hz) <= BAND_HZ
    return float(10 * np.log10(2 * np.sum(np.abs(spectrum[near])**2) / len(error) / np.sum(window**2) * 2))


@pytest.mark.parametrize("noisy", [True, False], ids=["16 bit, 90 dB", "clean"])
@pytest.mark.parametrize("freq_hz", [4000.0, 4321.0, 5000.0, 5000.3, 6250.0, 7000.0, 8000.0])
def test_noise_near_the_carrier(freq_hz, noisy):
    """At carriers that repeat every few samples, too: there, rounding errors pile up on the carrier itself."""
    coefficients = retune(freq_hz, 1e4, 1.08e-3)
    settled = 150_000
    codes = carrier_codes(freq_hz, settled + WINDOW, noisy)
    rounded, exact = run(coefficients, codes)

    def through_the_filter(at):
        back = np.exp(-2j * np.pi * at / SAMPLE_RATE_HZ)
        a1, eps = float(coefficients.a1), float(coefficients.eps)
        return 1 / (1 - a1 * back + (1 - eps) * back**2)

    output = band_power_dbfs((rounded.astype(np.longdouble) / 2**31 - exact.astype(np.longdouble) / 2**61)[settled:], freq_hz)
    inner = band_power_dbfs(residual(coefficients, exact, codes)[settled:], freq_hz, through_the_filter)
    total = 10 * np.log10(10**(output / 10) + 10**(inner / 10))
    print(f"{freq_hz:.1f} Hz: output {output:.1f}, recursion {inner:.1f}, together {total:.1f} dBFS")
    assert total <= -215


def test_recursion_stays_with_the_reference_for_a_minute():
    """Sixty seconds of carrier: the difference from extended precision does not grow (an eps off by one unit would be seen)."""
    freq_hz = 5000.3
    coefficients = retune(freq_hz, 1e4, 1.08e-3)
    codes = carrier_codes(freq_hz, 3_000_000, True)
    _, exact = run(coefficients, codes)
    errors = residual(coefficients, exact, codes)
    assert np.abs(errors).max() < 2**-52
    assert abs(errors[-500_000:].mean()) < 2**-53
