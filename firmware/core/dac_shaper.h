/* Rounds a force to the DAC's codes and feeds the rounding error back so that its spectrum has a zero at the carrier:
 * noise transfer 1 - 2 cos w z^-1 + z^-2. Plain rounding of a force that repeats every few samples leaves a fixed error at the carrier, which
 * reads as a bias of up to half a code; shaped, what remains there is zero. */
#ifndef WINEGLASS_CORE_DAC_SHAPER_H
#define WINEGLASS_CORE_DAC_SHAPER_H

#include <stdbool.h>
#include <stdint.h>

#include "core/fixed.h"

struct dac_shaper_state {
    int32_t error1, error2; /* last rounding errors, wanted minus sent, in units of 2^-31 */
};

/* Left-justified force in, left-justified code out: the low `shift` bits (0 to 24) are zero.
 * Range: |errors| <= 2^23, so the fed-back sum is below 3 x 2^23 and `wanted` below 2^32; an output at the DAC's limit is flagged and
 * forgets its error instead of winding up. */
static inline int32_t dac_shaper_step(struct dac_shaper_state *state, int32_t force_q31, int32_t two_cos_q30, unsigned shift,
                                      bool *saturated)
{
    int64_t fed_back = (((int64_t)two_cos_q30 * state->error1 + (INT64_C(1) << 29)) >> 30) - state->error2;
    int64_t wanted = force_q31 + fed_back;
    int64_t mask = (INT64_C(1) << shift) - 1;
    int64_t rounded = (wanted + ((mask + 1) >> 1)) & ~mask;
    state->error2 = state->error1;
    if (rounded > (INT32_MAX & ~mask) || rounded < INT32_MIN) {
        *saturated = true;
        state->error1 = 0;
        return rounded < 0 ? INT32_MIN : (int32_t)(INT32_MAX & ~mask);
    }
    state->error1 = (int32_t)(wanted - rounded);
    return (int32_t)rounded;
}

#endif
