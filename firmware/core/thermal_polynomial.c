#include "core/thermal_polynomial.h"

#include "core/fixed.h"

/* Q20 degC / 128 degC = Q27, so Q31 is 16 times the integer. Range: 2^31 x 2^4 fits 64 bit. */
int32_t thermal_polynomial_argument(int32_t shift_degc_q20, bool *overflow)
{
    return fixed_saturate_i32((int64_t)shift_degc_q20 * 16, overflow);
}

/* Range: |argument| < 1, so the product, rounded, is no larger than the value; the sum with a coefficient is saturated at every step. Error:
 * half a unit a step. */
int32_t thermal_polynomial_eval(const struct thermal_polynomial *polynomial, int32_t argument_q31, bool *overflow)
{
    uint32_t order = polynomial->order < THERMAL_POLYNOMIAL_MAX_ORDER ? polynomial->order : THERMAL_POLYNOMIAL_MAX_ORDER;
    int32_t value = polynomial->coef[order];
    int32_t factor_q31 = argument_q31 == INT32_MIN ? -INT32_MAX : argument_q31;
    while (order > 0) {
        order--;
        int32_t coef = polynomial->coef[order];
        int32_t product = fixed_middle_word((int64_t)value * factor_q31 + (INT32_C(1) << 30), 31);
        if (fixed_add_wraps(product, coef, &value)) {
            *overflow = true;
            value = (coef >> 31) ^ INT32_MAX;
        }
    }
    return value;
}
