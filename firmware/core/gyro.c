#include "core/gyro.h"

#include "core/fixed.h"
#include "core/gyro_tasks.h"

/* Range: cosine^2 + sine^2 <= drive_max^2 with drive_max <= 0.9999 (checked when a configuration is built) and a phasor no
 * longer than 1 + 5e-6, so the sum stays within 2^31. */
static inline int32_t force_sample_q31(struct gyro_force force, struct phasor_q30 reference)
{
    return fixed_middle_word((int64_t)force.cosine_q31 * reference.cosine_q30 + (int64_t)force.sine_q31 * reference.sine_q30, 30);
}

/* One task a sample, so that no sample is much longer than another; then the next slot. */
static inline bool run_task(const struct gyro_cfg *cfg, struct gyro_state *state, int32_t thermometer_raw)
{
    uint32_t slot = state->loop_slot, next = slot + 1;
    state->loop_slot = next;
    if (slot < GYRO_LOOP_TASKS) {
        gyro_loop_task(cfg, state, slot);
    } else if (next >= cfg->lockin.decimation) {
        gyro_loop_tick(cfg, state);
    } else if (state->slow_slot == 0) {
        return gyro_slow_task(cfg, state, slot, thermometer_raw);
    }
    return false;
}

void gyro_reset(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    *state = (struct gyro_state){.compensation = cfg->compensation, .loop = cfg->loop};
    acquisition_reset(&cfg->acquisition, &state->acquisition);
    state->oscillator.freq_u64 = cfg->tuning.center_freq_u64;
    drive_loop_reset(&state->drive, cfg->tuning.center_freq_u64, 0);
    state->drive_lead = gyro_drive_lead(cfg, state);
    state->demodulation = oscillator_phasor(0);
    state->two_cos_q30 = (int32_t)(cfg->tuning.center_2cos_q40 >> 10);
    state->signals.freq_u64 = cfg->tuning.center_freq_u64;
    state->loop_slot = cfg->lockin.decimation - 1; /* the schedule begins with a loop tick */
    state->slow_slot = cfg->loops_per_slow - 1;
    decoupler_reset(&state->decoupler);
    state->dac_mask = (UINT32_C(1) << cfg->dac_shift) - 1;
}

/* |value| > limit >= 0, in one comparison modulo 2^32. */
static inline bool beyond(int32_t value, int32_t limit)
{
    return (uint32_t)value + (uint32_t)limit > 2u * (uint32_t)limit;
}

static inline void watch_pickoffs(const struct gyro_cfg *cfg, struct gyro_state *state, const struct gyro_input *input)
{
    int32_t limit_q31 = cfg->monitor.adc_limit_q31;
    if (beyond(input->primary_q31, limit_q31) || beyond(input->secondary_q31, limit_q31)) {
        state->adc_saturated = true;
    }
}

/* The secondary pickoff without what cross damping puts on it. */
static inline int32_t decoupled_q31(struct gyro_state *state, const struct gyro_input *input)
{
    if (!state->decoupling) {
        return input->secondary_q31;
    }
    int32_t leaked_q31 = decoupler_step(&state->decoupler_coefs, &state->decoupler, input->primary_q31, &state->overflow);
    int32_t left_q31;
    if (fixed_sub_wraps(input->secondary_q31, leaked_q31, &left_q31)) {
        state->overflow = true;
        left_q31 = (input->secondary_q31 >> 31) ^ INT32_MAX;
    }
    return left_q31;
}

static inline int32_t drive_code_q31(struct gyro_state *state, struct phasor_q30 phasor)
{
    return dac_shaper_step(&state->drive_shaper, force_sample_q31(state->drive_force, phasor), state->two_cos_q30, state->dac_mask,
                           &state->drive_saturated);
}

static inline int32_t rebalance_code_q31(struct gyro_state *state, struct phasor_q30 phasor)
{
    if ((state->rebalance_force.cosine_q31 | state->rebalance_force.sine_q31) == 0) {
        return 0;
    }
    return dac_shaper_step(&state->rebalance_shaper, force_sample_q31(state->rebalance_force, phasor), state->two_cos_q30, state->dac_mask,
                           &state->rebalance_saturated);
}

/* The primary's products come first: a sign extension that only one branch needs is an obstacle to 32-bit compilers. */
struct gyro_output gyro_step(const struct gyro_cfg *cfg, struct gyro_state *state, const struct gyro_input *input)
{
    struct gyro_output output;
    struct phasor_q30 phasor = oscillator_phasor(oscillator_step(&state->oscillator));
    struct lockin_reference reference = lockin_reference(cfg->lockin.reference_shift, phasor);
    watch_pickoffs(cfg, state, input);
    lockin_step(&state->primary_lockin, input->primary_q31, reference);
    lockin_step(&state->secondary_lockin, decoupled_q31(state, input), reference);
    output.drive_q31 = drive_code_q31(state, phasor);
    output.rebalance_q31 = rebalance_code_q31(state, phasor);
    output.slow_tick = run_task(cfg, state, input->thermometer_raw);
    return output;
}
