"""Kernels of the core through the C library, against numpy and scipy in float64 on the same input."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import signal

from wineglass.bench.model import Row, side_by_side
from wineglass.native import library, pointer

SAMPLES = 1_000_000
SAMPLE_RATE_HZ, FREQ_HZ, Q = 50_000.0, 5_000.0, 1e4
DECIMATION = 10


def rows() -> Iterator[Row]:
    yield _oscillator()
    yield _lockin()
    yield _decoupler()
    yield _polar()
    yield _polynomial()


def _codes() -> np.ndarray:
    phase = 2 * np.pi * FREQ_HZ / SAMPLE_RATE_HZ * np.arange(SAMPLES)
    return np.round(0.9 * 2**31 * np.cos(phase)).astype(np.int32)


def _empty() -> np.ndarray:
    return np.empty(SAMPLES, np.int32)


def _oscillator() -> Row:
    phase = (np.arange(SAMPLES, dtype=np.uint64) * 429496730 % 2**32).astype(np.uint32)
    angle = phase * (2 * np.pi / 2**32)
    cosine, sine = _empty(), _empty()
    return side_by_side("cosine and sine", "numpy cos, sin", SAMPLES,
                        lambda: library().wg_oscillator_eval(pointer(phase, "uint32_t"), pointer(cosine, "int32_t"), pointer(sine, "int32_t"), SAMPLES),
                        lambda: (np.cos(angle), np.sin(angle)))


def _lockin() -> Row:
    codes = _codes()
    values = codes / 2**31
    carrier = np.exp(-2j * np.pi * FREQ_HZ / SAMPLE_RATE_HZ * np.arange(SAMPLES))
    window = np.convolve(np.ones(DECIMATION), np.ones(DECIMATION)) * (2 / DECIMATION**2)
    i, q = np.empty(SAMPLES // DECIMATION, np.int32), np.empty(SAMPLES // DECIMATION, np.int32)
    freq = int(round(FREQ_HZ / SAMPLE_RATE_HZ * 2**64))
    return side_by_side("lock-in of one pickoff, sine and cosine included", "numpy mixing, scipy upfirdn (sine and cosine for free)", SAMPLES,
                        lambda: library().wg_lockin_run(DECIMATION, 0, freq, pointer(codes, "int32_t"),
                                                        pointer(i, "int32_t"), pointer(q, "int32_t"), SAMPLES),
                        lambda: signal.upfirdn(window, values * carrier, 1, DECIMATION))


def _decoupler() -> Row:
    codes, out = _codes(), _empty()
    values = codes / 2**31
    angle, decay = 2 * np.pi * FREQ_HZ / SAMPLE_RATE_HZ, np.pi * FREQ_HZ / Q
    radius, gain = np.exp(-decay / SAMPLE_RATE_HZ), 1.08e-3 / SAMPLE_RATE_HZ
    numerator, denominator = [gain, 0.0, -gain * radius], [1.0, -2 * radius * np.cos(angle), radius**2]
    freq = int(round(FREQ_HZ / SAMPLE_RATE_HZ * 2**64))
    tuning = np.array([freq, round(2 * np.cos(angle) * 2**40), round(np.cos(angle) * 2**31), round(np.sin(angle) * 2**31),
                       round(2**46 / SAMPLE_RATE_HZ), round(2 * 2**44 / SAMPLE_RATE_HZ)], np.int64)
    return side_by_side("decoupling biquad", "scipy lfilter", SAMPLES,
                        lambda: library().wg_decoupler_run(pointer(tuning, "int64_t"), freq, round(decay * 2**22), round(1.08e-3 * 2**31),
                                                           pointer(codes, "int32_t"), pointer(out, "int32_t"), SAMPLES),
                        lambda: signal.lfilter(numerator, denominator, values))


def _polar() -> Row:
    rng = np.random.default_rng(1)
    i, q = (rng.integers(-2**30, 2**30, SAMPLES, dtype=np.int32) for _ in range(2))
    x, y = i / 2**30, q / 2**30
    magnitude, angle = _empty(), _empty()
    return side_by_side("magnitude and angle", "numpy hypot, arctan2", SAMPLES,
                        lambda: library().wg_polar_eval(pointer(i, "int32_t"), pointer(q, "int32_t"), pointer(magnitude, "int32_t"),
                                                        pointer(angle, "int32_t"), SAMPLES),
                        lambda: (np.hypot(x, y), np.arctan2(y, x)))


def _polynomial() -> Row:
    shift = np.linspace(-60, 60, SAMPLES)
    codes = np.round(shift * 2**20).astype(np.int32)
    alpha = np.array([1.0792e-3, -4.631e-5, 7.7044e-7, -5.8598e-9])
    coef = np.zeros(6, np.int32)
    coef[:4] = np.round(alpha * 128.0 ** np.arange(4) * 2**31)
    out = _empty()
    return side_by_side("thermal polynomial, order 3", "numpy polyval", SAMPLES,
                        lambda: library().wg_thermal_polynomial_eval(pointer(coef, "int32_t"), 3, pointer(codes, "int32_t"),
                                                                     pointer(out, "int32_t"), SAMPLES),
                        lambda: np.polyval(alpha[::-1], shift))
