"""Thermal polynomial against exact rational arithmetic. Promise `polynomial`: 3 units of its own format."""

import os
from fractions import Fraction

import numpy as np
from hypothesis import given, seed, settings, strategies

from core_library import library, pointer

SEED = int(os.environ.get("WINEGLASS_SEED", "1"), 0)
WORD = strategies.integers(-2**31, 2**31 - 1)


def evaluate(coefficients: list[int], argument_q31: int) -> tuple[int, bool]:
    padded = np.array(coefficients + [0] * (6 - len(coefficients)), np.int32)
    argument, out = np.array([argument_q31], np.int32), np.zeros(1, np.int32)
    clamped = library().core_polynomial(pointer(padded, "int32_t"), len(coefficients) - 1, pointer(argument, "int32_t"), 1,
                                        pointer(out, "int32_t"))
    return int(out[0]), bool(clamped)


def exact(coefficients: list[int], argument_q31: int) -> list[Fraction]:
    """Horner's partial sums, the last one the value."""
    argument, value, sums = Fraction(argument_q31, 2**31), Fraction(0), []
    for coefficient in reversed(coefficients):
        value = value * argument + coefficient
        sums.append(value)
    return sums


@seed(SEED)
@settings(max_examples=2000, deadline=None)
@given(strategies.lists(WORD, min_size=1, max_size=6), WORD)
def test_within_three_units_or_clamped(coefficients, argument_q31):
    value, clamped = evaluate(coefficients, argument_q31)
    sums = exact(coefficients, argument_q31)
    inside = all(-2**31 + 3 <= x <= 2**31 - 4 for x in sums)
    outside = any(x < -2**31 - 3 or x > 2**31 + 2 for x in sums)
    if inside:
        assert not clamped
        assert abs(value - sums[-1]) <= 3
    if outside:
        assert clamped
