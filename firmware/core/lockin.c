#include "core/lockin.h"

#include "core/fixed.h"

void lockin_reset(struct lockin_state *state)
{
    *state = (struct lockin_state){{0, 0}, {0, 0}};
}

/* A function of its own: among the rest of the sample, compilers for 32-bit machines no longer see that both factors have 32 bits. */
void lockin_step(struct lockin_state *state, int32_t pickoff_q31, const struct lockin_reference *reference)
{
    state->in_phase.falling_q52 += (int64_t)pickoff_q31 * reference->falling_cosine_q21;
    state->in_phase.rising_q52 += (int64_t)pickoff_q31 * reference->rising_cosine_q21;
    state->quadrature.falling_q52 += (int64_t)pickoff_q31 * reference->falling_minus_sine_q21;
    state->quadrature.rising_q52 += (int64_t)pickoff_q31 * reference->rising_minus_sine_q21;
}

/* Amplitude = 2 x mean = sum x 2 / N^2; sum in Q52 times 4 / N^2 in Q31, upper part: Q51 of twice that, so Q52.
 * Range: 2^30 2^31 4 / N^2 + 2^30 < 2^62. The result reaches 2^31 only for a full-scale input beside an oscillator that stands still; it
 * is clamped then. */
static int32_t channel_output(const struct lockin_cfg *cfg, struct lockin_channel *channel)
{
    bool clamped = false;
    struct fixed_words sum = fixed_words(channel->falling_q52);
    int64_t amplitude_q52 = (int64_t)sum.high * cfg->normalise_q31 + fixed_mul_high_floor(sum.low, cfg->normalise_q31);
    channel->falling_q52 = channel->rising_q52;
    channel->rising_q52 = 0;
    return fixed_saturate_i32(fixed_round_shift(amplitude_q52, 22), &clamped);
}

struct complex_q30 lockin_output(const struct lockin_cfg *cfg, struct lockin_state *state)
{
    struct complex_q30 amplitude = {channel_output(cfg, &state->in_phase), channel_output(cfg, &state->quadrature)};
    return amplitude;
}
