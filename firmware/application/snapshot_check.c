#include "application/snapshot_check.h"

#include <stddef.h>

#include "application/calibration.h"
#include "application/layout.h"
#include "application/limits.h"

/* min <= value <= max. */
struct bound {
    uint16_t offset; /* in struct gyro_state */
    uint8_t width;
    int64_t min, max;
};

#define BOUND(member, width, min, max) {offsetof(struct gyro_state, member), (width), (min), (max)}
#define WITHIN(member, width, limit)   BOUND(member, (width), -(limit), (limit))
#define POWER(exponent)                (INT64_C(1) << (exponent))
#define PHASOR(member)                 WITHIN(member.cosine_q30, 4, POWER(30) + POWER(13)), WITHIN(member.sine_q30, 4, POWER(30) + POWER(13))
#define MEMORY(member)                 WITHIN(member.next, 8, POWER(59)), WITHIN(member.after, 8, POWER(59))
#define FILTER(member)                 MEMORY(member.memory[0]), MEMORY(member.memory[1])

/* What is not in this table or in a function below may have any value: it is bounded before it is used, or counted modulo its range.
 * Each bound is that of the range proof at the place named. */
static const struct bound bounds[] = {
    WITHIN(decoupler_coefs.minus_gain_q48, 4, POWER(30)), WITHIN(gain_step_q48, 4, POWER(30)),
    WITHIN(decoupler_coefs.a1_q30, 4, POWER(31) - POWER(18)), WITHIN(decoupler_coefs.a1_low_q36, 4, POWER(5)), /* core/decoupler.h */
    BOUND(decoupler_coefs.minus_r2_q30, 4, -POWER(30), 0), WITHIN(decoupler_coefs.minus_r2_low_q36, 4, POWER(5)),
    WITHIN(decoupler.next_q61, 8, 3 * POWER(60) + POWER(50)), WITHIN(decoupler.after_q61, 8, POWER(60) + POWER(50)),
    BOUND(acquisition.phase, 4, ACQUISITION_CHIRP, ACQUISITION_DONE), BOUND(acquisition.attempt, 4, 0, 6), /* core/acquisition.c */
    BOUND(drive.drive_integral_q54, 8, 0, POWER(54)), BOUND(drive.drive_q31, 4, 0, DRIVE_MAX_Q31), /* core/drive_loop.c */
    WITHIN(rebalance.in_phase.integral_q54, 8, POWER(54)), WITHIN(rebalance.quadrature.integral_q54, 8, POWER(54)), /* core/rebalance.c */
    WITHIN(rebalance.in_phase.force_q31, 4, DRIVE_MAX_Q31), WITHIN(rebalance.quadrature.force_q31, 4, DRIVE_MAX_Q31),
    WITHIN(drive_shaper.error1, 4, POWER(23)), WITHIN(drive_shaper.error2, 4, POWER(23)), /* core/dac_shaper.h */
    WITHIN(rebalance_shaper.error1, 4, POWER(23)), WITHIN(rebalance_shaper.error2, 4, POWER(23)),
    WITHIN(rate.removed_rad_s_q46, 8, POWER(46)), /* core/rate.h */
    FILTER(filter), FILTER(filter_uncompensated), /* core/output_filter.c */
    PHASOR(drive_lead), PHASOR(demodulation), /* core/oscillator.h */
    BOUND(blank_ticks, 4, 0, 16), BOUND(lock_ticks, 4, 0, 1000000), BOUND(silent_ticks, 4, 0, 8192), /* core/gyro_loop.c */
    BOUND(loop, 4, 0, GYRO_LOOP_COUNT - 1), BOUND(compensation, 4, 0, GYRO_COMPENSATION_COUNT - 1),
};

static bool element_within(const struct bound *bound, const uint8_t *element)
{
    uint64_t bits = layout_load(element, bound->width);
    int64_t value = bound->width == 4 ? (int32_t)(uint32_t)bits : (int64_t)bits;
    return value >= bound->min && value <= bound->max;
}

static bool all_within(const struct gyro_state *state)
{
    for (size_t i = 0; i < sizeof bounds / sizeof bounds[0]; i++) {
        if (!element_within(&bounds[i], (const uint8_t *)state + bounds[i].offset)) {
            return false;
        }
    }
    return true;
}

static bool slots_are_within(const struct gyro_cfg *cfg, const struct gyro_state *state)
{
    return state->loop_slot < cfg->lockin.decimation && state->slow_slot < cfg->loops_per_slow;
}

/* After n of a window's products, none above 2^(61 - reference_shift) but for the phasor's 5e-6 (core/lockin.h). */
static bool channel_is_within(const struct lockin_channel *channel, const struct gyro_cfg *cfg, int64_t taken)
{
    int64_t limit = taken * ((POWER(61) + POWER(44)) >> cfg->lockin.reference_shift);
    return channel->sum >= -limit && channel->sum <= limit;
}

static bool lockin_is_within(const struct lockin_state *lockin, const struct gyro_cfg *cfg, const struct gyro_state *state)
{
    return channel_is_within(&lockin->in_phase, cfg, state->loop_slot) && channel_is_within(&lockin->quadrature, cfg, state->loop_slot);
}

static bool force_is_within(struct gyro_force force)
{
    int64_t cosine = force.cosine_q31, sine = force.sine_q31;
    return cosine > INT32_MIN && sine > INT32_MIN && cosine * cosine + sine * sine <= INT64_C(0x7FFFFFFF) * 0x7FFFFFFF;
}

/* At most `terms` of `limit` have been added. */
static bool sum_is_within(struct gyro_sum sum, int64_t terms, int64_t limit)
{
    int64_t most = terms * limit;
    return sum.i_q30 >= -most && sum.i_q30 <= most && sum.q_q30 >= -most && sum.q_q30 <= most;
}

/* Loop ticks are added in the last slot (amplitudes) and in slot 2 (forces) and taken out in slot 3 of a slow period's first loop tick. */
static bool sums_are_within(const struct gyro_cfg *cfg, const struct gyro_state *state)
{
    int64_t terms = state->slow_slot > 0 ? state->slow_slot : state->loop_slot > 3 ? 0 : cfg->loops_per_slow;
    return sum_is_within(state->primary_sum, terms, POWER(31)) && sum_is_within(state->secondary_sum, terms, POWER(31)) &&
           sum_is_within(state->rebalance_sum, terms, DRIVE_MAX_Q31 / 2);
}

static int64_t magnitude(int64_t value)
{
    return value < 0 ? -value : value;
}

/* While it listens: the phase u moves by half a turn a tick at most, h0 and h1 are the sums of u over the first and the second M ticks. Whatever
 * comes, |h1 - h0| must end at no more than 2^31 M^2, as the range proof of ringing_offset_u64() wants. After t < M ticks that is
 * |t u - h0| <= 2^31 t (t - 1) / 2; later, with r = 2 M - t ticks to go, |h1 + r u - h0| <= 2^31 (M^2 - r (r + 1) / 2).
 * Range: M <= 2^12, so |u| <= 2^44, sums <= 2^57. */
static bool listening_is_within(const struct gyro_cfg *cfg, const struct acquisition_state *state)
{
    int64_t m = INT64_C(1) << cfg->acquisition.listen_ticks_log2, t = state->tick, rest = 2 * m - t;
    int64_t u = state->unwrapped, h0 = state->half_sum[0], h1 = state->half_sum[1];
    if (state->phase != ACQUISITION_LISTEN) {
        return true;
    }
    if (rest <= 0 || u < -t * POWER(31) || u > t * POWER(31) || h0 < -POWER(56) || h0 > POWER(56) || h1 < -POWER(56) || h1 > POWER(56)) {
        return false;
    }
    return t < m ? h1 == 0 && magnitude(t * u - h0) <= POWER(30) * t * (t - 1)
                 : magnitude(h1 + rest * u - h0) <= POWER(30) * (2 * m * m - rest * (rest + 1));
}

static bool configuration_is_sound(const struct gyro_cfg *cfg)
{
    const struct test_signal_cfg *test = &cfg->test_signal;
    return calibration_gyro_is_sound(cfg) && cfg->dac_shift <= 24 && cfg->acquisition.decimation == cfg->lockin.decimation &&
           cfg->lockin.reference_shift == lockin_reference_shift(cfg->lockin.decimation) &&
           cfg->drive.freq_min_u64 == cfg->acquisition.freq_start_u64 && cfg->drive.freq_max_u64 == cfg->acquisition.freq_end_u64 &&
           magnitude(cfg->drive.phase_set_point_i32) <= PHASE_SET_POINT_MAX_I32 && magnitude(test->in_phase_q31) <= DRIVE_MAX_Q31 &&
           magnitude(test->quadrature_q31) <= DRIVE_MAX_Q31 && test->freq_u32 <= POWER(31);
}

bool snapshot_is_sound(const struct snapshot *snapshot)
{
    const struct gyro_cfg *cfg = &snapshot->cfg;
    const struct gyro_state *state = &snapshot->state;
    return configuration_is_sound(cfg) && all_within(state) && slots_are_within(cfg, state) &&
           lockin_is_within(&state->primary_lockin, cfg, state) && lockin_is_within(&state->secondary_lockin, cfg, state) &&
           state->dac_mask == (UINT32_C(1) << cfg->dac_shift) - 1 && force_is_within(state->drive_force) &&
           force_is_within(state->rebalance_force) && sums_are_within(cfg, state) && listening_is_within(cfg, &state->acquisition);
}
