#include "core/thermal_polynomial.h"

#include "core/fixed.h"

/* Q20 degC / 128 degC = Q27, so Q31 is 16 times the integer. Range: 2^31 x 2^4 fits 64 bit. */
int32_t thermal_polynomial_argument(int32_t shift_degc_q20, bool *overflow)
{
    return fixed_saturate_i32((int64_t)shift_degc_q20 * 16, overflow);
}

/* Range: |product| <= 2^31, plus a 32-bit coefficient < 2^32 in 64 bit, saturated at every step. Error: half a unit a step. */
int32_t thermal_polynomial_eval(const struct thermal_polynomial *polynomial, int32_t argument_q31, bool *overflow)
{
    uint32_t order = polynomial->order;
    if (order > THERMAL_POLYNOMIAL_MAX_ORDER) {
        order = THERMAL_POLYNOMIAL_MAX_ORDER;
    }
    int32_t value = polynomial->coef[order];
    while (order > 0) {
        order--;
        value = fixed_saturate_i32((int64_t)fixed_mul_q31(value, argument_q31) + polynomial->coef[order], overflow);
    }
    return value;
}
