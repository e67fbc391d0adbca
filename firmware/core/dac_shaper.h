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

/* Left-justified force in, left-justified code out: the bits of `mask` = 2^n - 1 (n = 0 to 24) are zero.
 * Range: |errors| <= 2^23, so what is fed back, plus half a code, is below 2^25 and only the sum with the force can leave 32 bit. An output
 * at the DAC's limit is flagged and forgets its error instead of winding up. */
static inline int32_t dac_shaper_step(struct dac_shaper_state *state, int32_t force_q31, int32_t two_cos_q30, uint32_t mask,
                                      bool *saturated)
{
    int32_t half = (int32_t)(mask >> 1), last = state->error1;
    int32_t fed_back = fixed_mul_high_floor(two_cos_q30, last * 4) - state->error2 + half;
    int32_t sum;
    if (fixed_add_wraps(force_q31, fed_back, &sum)) {
        *saturated = true;
        *state = (struct dac_shaper_state){0, last};
        return (int32_t)((uint32_t)((force_q31 >> 31) ^ INT32_MAX) & ~mask);
    }
    *state = (struct dac_shaper_state){(int32_t)((uint32_t)sum & mask) - half, last};
    return (int32_t)((uint32_t)sum & ~mask);
}

#endif
