#include "core/rate.h"

#include "core/fixed.h"

#define LEAST_POWER_Q60 (UINT64_C(1) << 48) /* |z1| = 2^-6 */

/* Range: parts within +-1.28 in Q30, so each product < 2^60.8 and each sum < 2^61.8. The power is scaled into [2^60, 2^61),
 * its upper word D into [2^29, 2^30); ratio = number 2^scale / power = number (2^60 / D) 2^scale / 2^91. */
int32_t rate_ratio_q29(struct complex_q30 primary, struct complex_q30 secondary, bool *valid, bool *overflow)
{
    int64_t number_q60 = (int64_t)secondary.i_q30 * primary.i_q30 + (int64_t)secondary.q_q30 * primary.q_q30;
    uint64_t power_q60 = (uint64_t)((int64_t)primary.i_q30 * primary.i_q30 + (int64_t)primary.q_q30 * primary.q_q30);
    *valid = power_q60 >= LEAST_POWER_Q60;
    if (!*valid) {
        return 0;
    }
    unsigned scale = 1; /* power may reach 2^61.8: start from half of it */
    power_q60 >>= 1;
    while (power_q60 < (UINT64_C(1) << 60)) {
        power_q60 <<= 1;
        scale++;
    }
    int32_t reciprocal = fixed_reciprocal_q60((uint32_t)(power_q60 >> 31));
    /* `scale` counts from power / 2^2, so the exponent of the result is 62 - (scale - 2) = 31 + (33 - scale). */
    return fixed_saturate_i32(fixed_round_shift(fixed_mul_i64_q31(number_q60, reciprocal), 33 - scale), overflow);
}

/* Range: 2^31 2^31 >> 29 = 2^33, saturated: rates beyond +-8 rad/s. */
int32_t rate_scale_q28(int32_t ratio_q29, int32_t scale_rad_s_q28, bool *overflow)
{
    return fixed_saturate_i32(fixed_round_shift((int64_t)ratio_q29 * scale_rad_s_q28, 29), overflow);
}

/* Range: bias in Q31 x 2^15 < 2^46, the difference < 2^47; a convex step keeps the state within the bias's range. */
int32_t rate_removed_step_q28(struct rate_state *state, int32_t bias_rad_s_q31, int32_t decay_per_tick_q31)
{
    int64_t difference_q46 = (int64_t)bias_rad_s_q31 * 32768 - state->removed_rad_s_q46;
    int32_t half_square_q31 = fixed_mul_q31(decay_per_tick_q31, decay_per_tick_q31) / 2; /* 1 - exp(-d) = d - d^2/2 */
    state->removed_rad_s_q46 += fixed_mul_i64_q31(difference_q46, decay_per_tick_q31 - half_square_q31);
    return (int32_t)fixed_round_shift(state->removed_rad_s_q46, 18);
}
