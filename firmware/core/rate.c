#include "core/rate.h"

#include "core/fixed.h"

#define LEAST_POWER_Q60 (UINT64_C(1) << 48) /* |z1| = 2^-6 */

/* The power's upper 31 bits D and what they were shifted by: power = D 2^(33 - zeros), D in [2^30, 2^31). Range: power in [2^48, 2^62). */
struct divisor {
    int32_t reciprocal_q60; /* 2^60 / D */
    unsigned zeros;         /* 2 .. 15 */
};

static struct divisor divisor_of(uint64_t power_q60)
{
    uint32_t high = (uint32_t)(power_q60 >> 32), low = (uint32_t)power_q60;
    unsigned zeros = fixed_leading_zeros(high);
    uint32_t upper = (high << zeros) | (low >> (32 - zeros));
    return (struct divisor){fixed_reciprocal_q60(upper >> 1), zeros};
}

/* number / power in Q29 = number (2^60 / D) 2^(zeros - 64). */
static int32_t divide_q29(int64_t number_q60, struct divisor divisor, bool *overflow)
{
    return fixed_saturate_i32(fixed_round_shift(fixed_mul_i64_q31(number_q60, divisor.reciprocal_q60), 33 - divisor.zeros), overflow);
}

/* Range: parts within +-1.28 in Q30, so each product < 2^60.8 and each sum < 2^61.8. */
struct rate_ratio rate_ratio_q29(struct complex_q30 primary, struct complex_q30 secondary, bool *overflow)
{
    int64_t in_phase_q60 = (int64_t)secondary.i_q30 * primary.i_q30 + (int64_t)secondary.q_q30 * primary.q_q30;
    int64_t quadrature_q60 = (int64_t)secondary.q_q30 * primary.i_q30 - (int64_t)secondary.i_q30 * primary.q_q30;
    uint64_t power_q60 = (uint64_t)((int64_t)primary.i_q30 * primary.i_q30 + (int64_t)primary.q_q30 * primary.q_q30);
    if (power_q60 < LEAST_POWER_Q60) {
        return (struct rate_ratio){0, 0, false};
    }
    struct divisor divisor = divisor_of(power_q60);
    return (struct rate_ratio){divide_q29(in_phase_q60, divisor, overflow), divide_q29(quadrature_q60, divisor, overflow), true};
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
