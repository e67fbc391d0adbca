#include "core/lockin.h"

#include "core/fixed.h"

void lockin_reset(struct lockin_state *state)
{
    *state = (struct lockin_state){{0, 0, 0}, {0, 0, 0}};
}

/* Sum of the triangle's products, in the ramp's unit; then the next window begins. Floors took half a unit N times. */
static int32_t take_sum(uint32_t decimation, struct lockin_channel *channel)
{
    uint32_t sum = channel->ramp + decimation / 2;
    uint32_t rising = decimation * (uint32_t)fixed_high_word(channel->sum) - (channel->ramp - channel->rising);
    *channel = (struct lockin_channel){0, rising, rising};
    return (int32_t)sum;
}

/* Amplitude = 2 x mean = sum x 2 / N^2. The sum counts 2^(29-s), so in Q30 the factor is 2^(s+2) / N^2, above 1 and at most 2: 4 / N^2 in Q31 times
 * 2^s / 4, as Q29. The result reaches 2^31 only for a full-scale input beside an oscillator that stands still; it is clamped then. */
static int32_t factor_q29(const struct lockin_cfg *cfg)
{
    return fixed_middle_word((int64_t)((uint64_t)(uint32_t)cfg->normalise_q31 * (UINT32_C(1) << cfg->reference_shift)), 2);
}

static int32_t rounded_q30(int64_t product_q59)
{
    bool clamped = false;
    return fixed_saturate_i32(fixed_round_shift(product_q59, 29), &clamped);
}

struct complex_q30 lockin_output(const struct lockin_cfg *cfg, struct lockin_state *state)
{
    int32_t factor = factor_q29(cfg);
    int64_t in_phase_q59 = (int64_t)take_sum(cfg->decimation, &state->in_phase) * factor;
    int64_t quadrature_q59 = (int64_t)take_sum(cfg->decimation, &state->quadrature) * factor;
    return (struct complex_q30){rounded_q30(in_phase_q59), rounded_q30(-quadrature_q59)};
}
