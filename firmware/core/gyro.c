#include "core/gyro.h"

#include "core/fixed.h"
#include "core/gyro_tasks.h"

/* Range: cosine^2 + sine^2 <= drive_max^2 with drive_max <= 0.9999 (checked when a configuration is built) and a phasor no
 * longer than 1 + 5e-6, so the sum stays within 2^31. */
static inline int32_t force_sample_q31(struct gyro_force force, struct phasor_q30 reference)
{
    return (int32_t)(((int64_t)force.cosine_q31 * reference.cosine_q30 + (int64_t)force.sine_q31 * reference.sine_q30) >> 30);
}

/* One task a sample, so that no sample is much longer than another. */
static inline bool run_task(const struct gyro_cfg *cfg, struct gyro_state *state, int32_t thermometer_raw)
{
    if (state->loop_slot < GYRO_LOOP_TASKS) {
        gyro_loop_task(cfg, state);
        return false;
    }
    return state->slow_slot == 0 && gyro_slow_task(cfg, state, thermometer_raw);
}

static void advance_slot(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    state->loop_slot++;
    if (state->loop_slot >= cfg->lockin.decimation) {
        state->loop_slot = 0;
        state->slow_slot++;
        if (state->slow_slot >= cfg->loops_per_slow) {
            state->slow_slot = 0;
        }
    }
}

void gyro_reset(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    *state = (struct gyro_state){.compensation = cfg->compensation, .loop = cfg->loop};
    acquisition_reset(&cfg->acquisition, &state->acquisition);
    state->oscillator.freq_u64 = cfg->tuning.center_freq_u64;
    drive_loop_reset(&state->drive, cfg->tuning.center_freq_u64, 0);
    state->drive_lead = gyro_drive_lead(cfg, state);
    state->demodulation = oscillator_phasor(0);
    (void)decoupler_two_cosine(&cfg->tuning, cfg->tuning.center_freq_u64, &state->two_cos_q30);
    state->signals.freq_u64 = cfg->tuning.center_freq_u64;
}

/* Samples since the last output of the lock-ins, which is taken in slot 0 behind that slot's own sample. */
static inline uint32_t window_position(const struct gyro_cfg *cfg, const struct gyro_state *state)
{
    return (state->loop_slot == 0 ? cfg->lockin.decimation : state->loop_slot) - 1;
}

/* |value| > limit >= 0, in one comparison modulo 2^32. */
static inline bool beyond(int32_t value, int32_t limit)
{
    return (uint32_t)value + (uint32_t)limit > 2u * (uint32_t)limit;
}

/* The secondary pickoff without what cross damping puts on it. */
static inline int32_t decoupled_q31(struct gyro_state *state, const struct gyro_input *input)
{
    if (!state->decoupling) {
        return input->secondary_q31;
    }
    int32_t leaked_q31 = decoupler_step(&state->decoupler_coefs, &state->decoupler, input->primary_q31, &state->overflow);
    return fixed_saturate_i32((int64_t)input->secondary_q31 - leaked_q31, &state->overflow);
}

static inline void demodulate(const struct gyro_cfg *cfg, struct gyro_state *state, int32_t primary_q31, int32_t secondary_q31,
                              struct phasor_q30 phasor)
{
    struct lockin_reference reference = lockin_weigh(cfg->lockin.decimation, window_position(cfg, state), phasor);
    lockin_step(&state->primary_lockin, primary_q31, &reference);
    lockin_step(&state->secondary_lockin, secondary_q31, &reference);
}

static inline int32_t drive_code_q31(const struct gyro_cfg *cfg, struct gyro_state *state, struct phasor_q30 phasor)
{
    return dac_shaper_step(&state->drive_shaper, force_sample_q31(state->drive_force, phasor), state->two_cos_q30, cfg->dac_shift,
                           &state->drive_saturated);
}

static inline int32_t rebalance_code_q31(const struct gyro_cfg *cfg, struct gyro_state *state, struct phasor_q30 phasor)
{
    if ((state->rebalance_force.cosine_q31 | state->rebalance_force.sine_q31) == 0) {
        return 0;
    }
    return dac_shaper_step(&state->rebalance_shaper, force_sample_q31(state->rebalance_force, phasor), state->two_cos_q30,
                           cfg->dac_shift, &state->rebalance_saturated);
}

struct gyro_output gyro_step(const struct gyro_cfg *cfg, struct gyro_state *state, const struct gyro_input *input)
{
    struct gyro_output output;
    int32_t limit_q31 = cfg->monitor.adc_limit_q31;
    if (beyond(input->primary_q31, limit_q31) || beyond(input->secondary_q31, limit_q31)) {
        state->adc_saturated = true;
    }
    int32_t secondary_q31 = decoupled_q31(state, input);
    struct phasor_q30 phasor = oscillator_phasor(oscillator_step(&state->oscillator));
    demodulate(cfg, state, input->primary_q31, secondary_q31, phasor);
    output.drive_q31 = drive_code_q31(cfg, state, phasor);
    output.rebalance_q31 = rebalance_code_q31(cfg, state, phasor);
    output.slow_tick = run_task(cfg, state, input->thermometer_raw);
    advance_slot(cfg, state);
    return output;
}
