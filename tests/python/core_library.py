"""The core alone, compiled with the tests' small plant into a library of its own: inputs and states that the device does not show.

The references that use it are written in float64 and scipy; nothing of the code under test is in them.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from cffi import FFI

ROOT = Path(__file__).resolve().parents[2]
SAMPLE_RATE_HZ = 50e3
CENTER_HZ = 5000.0
DECIMATION = 10
LOOPS_PER_SLOW = 5

ffi = FFI()
ffi.cdef("""
struct fixture_device {
    double sample_rate_hz, freq_hz, center_freq_hz, quality, gain, bias_rad_s, rate_rad_s, amplitude, force_margin, adc_noise;
    uint32_t adc_bits, loop, compensation;
};
struct fixture_device fixture_default(void);
int core_record(const struct fixture_device *device, uint64_t seed, size_t settle, size_t count, void *samples);
int core_decoupler(const int32_t *coefs, const int32_t *primary_q31, size_t count, int32_t *out_q31, int64_t *out_q61);
int core_retune(double sample_rate_hz, double center_freq_hz, double freq_hz, int32_t decay_per_s_q22, int32_t bias_rad_s_q31,
                int32_t *coefs);
void core_output_filter(uint32_t choice, const int32_t *values, size_t count, int32_t *out);
size_t core_polynomial(const int32_t *coef, uint32_t order, const int32_t *argument_q31, size_t count, int32_t *out);
""")

SAMPLE = np.dtype([("freq_u64", "u8"), ("phase_u32", "u4"), ("primary_q31", "i4"), ("secondary_q31", "i4"),
                   ("bias_rad_s_q31", "i4"), ("decay_per_s_q22", "i4"), ("rate_rad_s_q28", "i4"), ("status", "u4"),
                   ("slow_tick", "u4")])


@cache
def library() -> Any:
    """Compiled once per process, with the compiler named by CC."""
    folder = tempfile.mkdtemp(prefix="wineglass-core-")
    target = Path(folder) / "libcore.so"
    sources = [*sorted((ROOT / "firmware/core").glob("*.c")),
               *(ROOT / "tests/support" / name for name in ("core_recording.c", "gyro_fixture.c", "random.c"))]
    subprocess.run([os.environ.get("CC", "cc"), "-std=c11", "-D_DEFAULT_SOURCE", "-O2", "-ffp-contract=off", "-fPIC", "-shared",
                    "-I", ROOT / "firmware", "-I", ROOT / "tests", "-o", target, *sources, "-lm"], check=True)
    loaded = ffi.dlopen(str(target))
    target.unlink()
    os.rmdir(folder)
    return loaded


def pointer(array: np.ndarray, ctype: str) -> Any:
    """C pointer to a contiguous array that outlives the call."""
    assert array.flags.c_contiguous
    return ffi.cast(f"{ctype} *", array.ctypes.data)


def record(seed: int, settle_s: float, run_s: float, **device: float) -> np.ndarray:
    """A closed run, one SAMPLE per sample, after settling. Keywords are fields of fixture_device."""
    settings = ffi.new("struct fixture_device *", library().fixture_default())
    for name, value in device.items():
        setattr(settings, name, value)
    samples = np.zeros(round(run_s * SAMPLE_RATE_HZ), SAMPLE)
    status = library().core_record(settings, seed, round(settle_s * SAMPLE_RATE_HZ), len(samples), pointer(samples, "void"))
    assert status == 0, "the gyro did not lock"
    return samples


@dataclass(frozen=True)
class Coefficients:
    """Words of the decoupler and what they mean."""

    words: np.ndarray

    @property
    def gain(self) -> np.longdouble:
        return -np.longdouble(self.words[0]) / 2**48

    @property
    def a1(self) -> np.longdouble:
        return np.longdouble(self.words[1]) / 2**30 + np.longdouble(self.words[2]) / 2**36

    @property
    def eps(self) -> np.longdouble:
        return 1 + np.longdouble(self.words[3]) / 2**30 + np.longdouble(self.words[4]) / 2**36


def retune(freq_hz: float, quality: float, bias_rad_s: float, center_hz: float | None = None) -> Coefficients:
    words = np.zeros(5, np.int32)
    decay = round(np.pi * freq_hz / quality * 2**22)
    accepted = library().core_retune(SAMPLE_RATE_HZ, center_hz or freq_hz, freq_hz, decay, round(bias_rad_s * 2**31),
                                     pointer(words, "int32_t"))
    assert accepted
    return Coefficients(words)
