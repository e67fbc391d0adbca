/* Polynomial in the temperature shift (paper eq 10, 11), orders 0 to 5, by Horner's rule. */
#ifndef WINEGLASS_CORE_THERMAL_POLYNOMIAL_H
#define WINEGLASS_CORE_THERMAL_POLYNOMIAL_H

#include <stdbool.h>
#include <stdint.h>

#define THERMAL_POLYNOMIAL_MAX_ORDER 5
#define THERMAL_POLYNOMIAL_SPAN_DEGC 128 /* the argument is shift / 128 degC, so that it lies within +-1 */

/* value = sum coef[i] t^i with t = (T - T0) / 128 degC; the coefficients carry the result's own format. */
struct thermal_polynomial {
    int32_t coef[THERMAL_POLYNOMIAL_MAX_ORDER + 1];
    uint32_t order;
};

/* Temperature shift in Q20 degC -> argument in Q31 of 128 degC; saturates beyond +-128 degC. */
int32_t thermal_polynomial_argument(int32_t shift_degc_q20, bool *overflow);

/* Saturates at the limits of 32 bit and sets *overflow; it is never cleared. order > 5 counts as 5. */
int32_t thermal_polynomial_eval(const struct thermal_polynomial *polynomial, int32_t argument_q31, bool *overflow);

#endif
