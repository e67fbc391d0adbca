#include "core/acquisition.h"

#include "core/fixed.h"

static uint64_t center_frequency(const struct acquisition_cfg *cfg)
{
    return cfg->freq_start_u64 + ((cfg->freq_end_u64 - cfg->freq_start_u64) >> 1);
}

/* Every further attempt takes four times as long. */
static uint32_t chirp_ticks_log2(const struct acquisition_cfg *cfg, const struct acquisition_state *state)
{
    return cfg->chirp_ticks_log2 + 2 * state->attempt;
}

static void enter(struct acquisition_state *state, enum acquisition_phase phase)
{
    state->phase = (uint32_t)phase;
    state->tick = 0;
}

void acquisition_reset(const struct acquisition_cfg *cfg, struct acquisition_state *state)
{
    *state = (struct acquisition_state){.attempt = 0};
    enter(state, cfg->attempts > 0 ? ACQUISITION_CHIRP : ACQUISITION_DONE);
}

static struct acquisition_output chirp(const struct acquisition_cfg *cfg, struct acquisition_state *state)
{
    uint32_t log2 = chirp_ticks_log2(cfg, state);
    uint64_t slope = (cfg->freq_end_u64 - cfg->freq_start_u64) >> log2;
    struct acquisition_output output = {cfg->freq_start_u64 + slope * state->tick, 0, true, false};
    state->tick++;
    if (state->tick >= (UINT32_C(1) << log2)) {
        enter(state, ACQUISITION_SETTLE);
    }
    return output;
}

static struct acquisition_output settle(const struct acquisition_cfg *cfg, struct acquisition_state *state, struct polar primary)
{
    struct acquisition_output output = {center_frequency(cfg), 0, false, false};
    state->tick++;
    if (state->tick >= cfg->settle_ticks) {
        enter(state, ACQUISITION_LISTEN);
        state->unwrapped = 0;
        state->half_sum[0] = 0;
        state->half_sum[1] = 0;
        state->least_q30 = INT32_MAX;
        state->last_angle_i32 = primary.angle_i32;
    }
    return output;
}

/* Frequency of the ringing relative to the centre: the mean phases of two halves of M ticks lie M ticks apart, so the slope is
 * (sum2 - sum1) / M^2 a tick. Range: half a turn a tick at most, so |sum2 - sum1| < 2^31 M^2 with M <= 2^12; scaled to 2^64 a turn
 * and divided by M^2 N it stays below 2^62. The result is floored by less than 2^-30 of itself. */
static int64_t ringing_offset_u64(const struct acquisition_cfg *cfg, const struct acquisition_state *state)
{
    int64_t difference = state->half_sum[1] - state->half_sum[0];
    unsigned shift = 2 * cfg->listen_ticks_log2; /* <= 24 */
    int64_t per_tick_u64 = (difference * (INT64_C(1) << (24 - shift))) * 64; /* 2^62 a turn: 2^31 2^24 2^6 < 2^62 */
    int32_t per_sample_q31 = (int32_t)(UINT32_C(0x7FFFFFFF) / cfg->decimation);
    return fixed_mul_i64_q31(per_tick_u64, per_sample_q31) * 4;
}

/* The amplitude heard last is the mean over the decimator's window, whose middle lies N - 1 samples back. */
static struct acquisition_output hand_over(const struct acquisition_cfg *cfg, struct acquisition_state *state)
{
    int64_t offset_u64 = ringing_offset_u64(cfg, state);
    uint32_t travelled_u32 = (uint32_t)((uint64_t)offset_u64 >> 32) * (cfg->decimation - 1);
    struct acquisition_output output = {
        center_frequency(cfg) + (uint64_t)offset_u64, (uint32_t)state->last_angle_i32 + travelled_u32, true, true};
    enter(state, ACQUISITION_DONE);
    return output;
}

static struct acquisition_output start_at_center(const struct acquisition_cfg *cfg, struct acquisition_state *state)
{
    struct acquisition_output output = {center_frequency(cfg), 0, true, true};
    enter(state, ACQUISITION_DONE);
    return output;
}

static struct acquisition_output next_attempt(const struct acquisition_cfg *cfg, struct acquisition_state *state)
{
    state->attempt++;
    if (state->attempt >= cfg->attempts) {
        return start_at_center(cfg, state);
    }
    enter(state, ACQUISITION_CHIRP);
    return chirp(cfg, state);
}

/* A ringing shell turns steadily, by no more than half the band a tick; noise turns by anything. A sixteenth of a turn is left for the
 * noise of an honest reading: eight times its rms at the audible limit. Range: a band below 2^63, 32 samples a tick: 2^30 2^5, clamped. */
static bool steady(const struct acquisition_cfg *cfg, int32_t step_i32)
{
    bool clamped = false;
    int64_t half_band_u32 = (int64_t)((cfg->freq_end_u64 - cfg->freq_start_u64) >> 33);
    int32_t limit = fixed_saturate_i32(half_band_u32 * cfg->decimation + (INT32_C(1) << 28), &clamped);
    return step_i32 <= limit && step_i32 >= -limit;
}

static struct acquisition_output listen(const struct acquisition_cfg *cfg, struct acquisition_state *state, struct polar primary)
{
    struct acquisition_output output = {center_frequency(cfg), 0, false, false};
    uint32_t half = UINT32_C(1) << cfg->listen_ticks_log2;
    int32_t step_i32 = (int32_t)((uint32_t)primary.angle_i32 - (uint32_t)state->last_angle_i32);
    int32_t heard_q30 = steady(cfg, step_i32) ? primary.magnitude_q30 : 0;
    state->unwrapped += step_i32;
    state->last_angle_i32 = primary.angle_i32;
    state->half_sum[state->tick < half ? 0 : 1] += state->unwrapped;
    if (heard_q30 < state->least_q30) {
        state->least_q30 = heard_q30;
    }
    state->tick++;
    if (state->tick < 2 * half) {
        return output;
    }
    return state->least_q30 >= cfg->audible_q30 ? hand_over(cfg, state) : next_attempt(cfg, state);
}

struct acquisition_output acquisition_step(const struct acquisition_cfg *cfg, struct acquisition_state *state,
                                           struct polar primary)
{
    switch (state->phase) {
    case ACQUISITION_CHIRP:
        return chirp(cfg, state);
    case ACQUISITION_SETTLE:
        return settle(cfg, state, primary);
    case ACQUISITION_LISTEN:
        return listen(cfg, state, primary);
    default:
        return start_at_center(cfg, state);
    }
}
