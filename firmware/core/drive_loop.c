#include "core/drive_loop.h"

#include "core/fixed.h"

void drive_loop_reset(struct drive_loop_state *state, uint64_t freq_u64, int32_t drive_q31)
{
    *state = (struct drive_loop_state){
        .freq_integral_u64 = freq_u64,
        .freq_u64 = freq_u64,
        .drive_integral_q54 = (int64_t)drive_q31 << 23,
        .drive_q31 = drive_q31,
    };
}

/* Adds a signed step to a frequency and keeps it within the limits.
 * Range: limits are below 2^63 (half a turn a sample), |step| <= 2^31 2^32 = 2^63 / 1, so the sum is done in two's complement and
 * the comparison on signed values after bounding the step. */
static uint64_t step_frequency(const struct drive_loop_cfg *cfg, uint64_t freq_u64, int64_t step_u64)
{
    int64_t up = (int64_t)(cfg->freq_max_u64 - freq_u64);
    int64_t down = (int64_t)(cfg->freq_min_u64 - freq_u64);
    bool clamped = false;
    return freq_u64 + (uint64_t)fixed_clamp_i64(step_u64, down, up, &clamped);
}

/* Range: |error| <= 2^31, gain < 2^31: the product fits 63 bit and already counts 2^64 per turn. */
static void step_phase(const struct drive_loop_cfg *cfg, struct drive_loop_state *state, int32_t error_i32)
{
    state->phase_error_i32 = error_i32;
    state->freq_integral_u64 = step_frequency(cfg, state->freq_integral_u64, (int64_t)error_i32 * (int64_t)cfg->pll_integral_q32);
    state->freq_u64 = step_frequency(cfg, state->freq_integral_u64, (int64_t)error_i32 * (int64_t)cfg->pll_proportional_q32);
}

/* Range: |error| < 2^31 in Q30, gains < 2^31: products fit, the proportional part is bounded to 2^62. The integral moves only while the force is free or the error takes it back from its limit. */
static void step_amplitude(const struct drive_loop_cfg *cfg, struct drive_loop_state *state, int32_t amplitude_q30)
{
    bool clamped = false;
    int32_t error_q30 = fixed_error(cfg->amplitude_q30, amplitude_q30);
    int64_t limit_q54 = (int64_t)cfg->drive_max_q31 << 23;
    int64_t wanted_q54 = fixed_proportional_q54(error_q30, cfg->agc_proportional_q16) + state->drive_integral_q54;
    bool held_high = wanted_q54 > limit_q54 && error_q30 > 0;
    bool held_low = wanted_q54 < 0 && error_q30 < 0;
    if (!held_high && !held_low) {
        int64_t integral = state->drive_integral_q54 + (int64_t)error_q30 * cfg->agc_integral_q24;
        state->drive_integral_q54 = fixed_clamp_i64(integral, 0, limit_q54, &clamped);
    }
    state->amplitude_q30 = amplitude_q30;
    state->saturated = wanted_q54 >= limit_q54;
    state->drive_q31 = (int32_t)(fixed_clamp_i64(wanted_q54, 0, limit_q54, &clamped) >> 23);
}

/* The integral is what held the amplitude before: the loop goes on with it. */
static void rest(struct drive_loop_state *state, int32_t amplitude_q30)
{
    state->amplitude_q30 = amplitude_q30;
    state->saturated = false;
    state->drive_q31 = 0;
}

void drive_loop_hold(struct drive_loop_state *state, int32_t amplitude_q30)
{
    state->phase_error_i32 = 0;
    state->freq_u64 = state->freq_integral_u64;
    rest(state, amplitude_q30);
}

void drive_loop_step(const struct drive_loop_cfg *cfg, struct drive_loop_state *state, struct polar primary)
{
    step_phase(cfg, state, (int32_t)((uint32_t)primary.angle_i32 - (uint32_t)cfg->phase_set_point_i32));
    if (cfg->off) {
        rest(state, primary.magnitude_q30);
    } else {
        step_amplitude(cfg, state, primary.magnitude_q30);
    }
}
