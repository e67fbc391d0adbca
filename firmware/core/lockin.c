#include "core/lockin.h"

#include "core/fixed.h"

void lockin_reset(struct lockin_state *state)
{
    *state = (struct lockin_state){{0, 0, 0}, {0, 0, 0}};
}

/* Amplitude = 2 x mean = ramp x 2 / N^2; ramp in Q52 times 4 / N^2 in Q31, upper part: Q51 of twice that, so Q52.
 * Range: 2^30 2^31 4 / N^2 + 2^30 < 2^62; N times a window's sum <= N^2 2^52 <= 2^62. */
static int64_t channel_output_q52(const struct lockin_cfg *cfg, struct lockin_channel *channel)
{
    struct fixed_words ramp = fixed_words(channel->ramp_q52);
    int64_t rising_q52 = channel->sum_q52 * cfg->decimation - (channel->ramp_q52 - channel->rising_q52);
    *channel = (struct lockin_channel){0, rising_q52, rising_q52};
    return (int64_t)ramp.high * cfg->normalise_q31 + fixed_mul_high_floor(ramp.low, cfg->normalise_q31);
}

/* Q52 -> Q30. The result reaches 2^31 only for a full-scale input beside an oscillator that stands still; it is clamped then. */
static int32_t rounded_q30(int64_t amplitude_q52)
{
    bool clamped = false;
    return fixed_saturate_i32(fixed_round_shift(amplitude_q52, 22), &clamped);
}

struct complex_q30 lockin_output(const struct lockin_cfg *cfg, struct lockin_state *state)
{
    int64_t in_phase_q52 = channel_output_q52(cfg, &state->in_phase);
    int64_t quadrature_q52 = channel_output_q52(cfg, &state->quadrature);
    return (struct complex_q30){rounded_q30(in_phase_q52), rounded_q30(-quadrature_q52)};
}
