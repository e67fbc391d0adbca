/* Slow tick: temperature, retuning, rate, status. */
#include "core/gyro_tasks.h"

#include "core/fixed.h"

/* (code - offset) gain: Range: 33 bit x 31 bit = 2^64 in the worst case, so the difference is saturated to 32 bit first;
 * Q36 >> 16 = Q20. */
static void take_temperature(const struct gyro_cfg *cfg, struct gyro_state *state, int32_t thermometer_raw)
{
    const struct gyro_thermometer_cfg *thermometer = &cfg->thermometer;
    bool clamped = thermometer_raw == GYRO_THERMOMETER_INVALID;
    if (!clamped) {
        int32_t code = fixed_saturate_i32((int64_t)thermometer_raw - thermometer->offset_raw, &clamped);
        int64_t shift_q20 = fixed_round_shift((int64_t)code * thermometer->gain_degc_q36, 16);
        state->temperature_shift_q20 = fixed_saturate_i32(shift_q20, &clamped);
    }
    state->temperature_valid = !clamped && state->temperature_shift_q20 >= thermometer->shift_min_q20 &&
                               state->temperature_shift_q20 <= thermometer->shift_max_q20;
}

/* The bias is extrapolated along its last change, so that the gain in force is the one of the middle of each loop tick. */
static void evaluate_polynomials(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    int32_t argument_q31 = thermal_polynomial_argument(state->temperature_shift_q20, &state->overflow);
    int32_t bias = thermal_polynomial_eval(&cfg->bias_rad_s_q31, argument_q31, &state->overflow);
    int32_t change = 0;
    if (state->temperature_seen) {
        change = fixed_saturate_i32((int64_t)bias - state->bias_at_tick_q31, &state->overflow);
    }
    state->temperature_seen = state->temperature_valid;
    state->bias_at_tick_q31 = bias;
    state->bias_step_q31 = change / (int32_t)cfg->loops_per_slow;
    state->bias_rad_s_q31 = fixed_saturate_i32((int64_t)bias + state->bias_step_q31 / 2, &state->overflow);
    state->decay_per_s_q22 = thermal_polynomial_eval(&cfg->decay_per_s_q22, argument_q31, &state->overflow);
    state->drive_phase_rad_q31 = thermal_polynomial_eval(&cfg->drive_phase_rad_q31, argument_q31, &state->overflow);
    const struct thermal_polynomial *scale =
        state->loop == GYRO_LOOP_REBALANCE ? &cfg->rebalance_scale_rad_s_q28 : &cfg->scale_rad_s_q28;
    state->scale_rad_s_q28 = thermal_polynomial_eval(scale, argument_q31, &state->overflow);
    int32_t phase_rad_q31 = thermal_polynomial_eval(&cfg->demodulation_phase_rad_q31, argument_q31, &state->overflow);
    state->demodulation = oscillator_phasor(0u - gyro_turns_from_rad_q31(phase_rad_q31)); /* a lag is undone by a lead */
    state->drive_lead = gyro_drive_lead(cfg, state);
}

/* A change of loop or compensation takes effect here, between two slow periods. */
static void select_mode(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    if (cfg->compensation != state->compensation || cfg->loop != state->loop) {
        decoupler_reset(&state->decoupler);
        state->rate.removed_rad_s_q46 = 0;
        state->compensation = cfg->compensation;
        state->loop = cfg->loop;
    }
    state->decoupling = state->compensation == GYRO_COMPENSATION_G2 && state->loop == GYRO_LOOP_OPEN;
}

/* Outside the tuning's validity the decoupler keeps what it has. */
static void retune(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    int64_t two_cos_q40;
    bool near = decoupler_two_cosine(&cfg->tuning, state->oscillator.freq_u64, &two_cos_q40);
    if (near) {
        state->two_cos_q30 = (int32_t)(two_cos_q40 >> 10);
    }
    state->retune_valid = near && decoupler_tune(&cfg->tuning, two_cos_q40, state->decay_per_s_q22, state->bias_rad_s_q31,
                                                 &state->decoupler_coefs);
    state->gain_step_q48 = state->retune_valid
        ? decoupler_gain_q48(&cfg->tuning, state->decay_per_s_q22, state->bias_step_q31, &state->overflow) : 0;
    state->dac_mask = (UINT32_C(1) << cfg->dac_shift) - 1;
    select_mode(cfg, state);
}

static struct complex_q30 mean_amplitude(const struct gyro_cfg *cfg, struct gyro_sum *sum)
{
    int32_t reciprocal_q31 = (int32_t)(UINT32_C(0x7FFFFFFF) / cfg->loops_per_slow);
    struct complex_q30 mean = {
        (int32_t)fixed_mul_i64_q31(sum->i_q30, reciprocal_q31),
        (int32_t)fixed_mul_i64_q31(sum->q_q30, reciprocal_q31),
    };
    *sum = (struct gyro_sum){0, 0};
    return mean;
}

/* decay rate (1/s, Q22) x sample period (Q46) = Q68 per sample; x samples per slow tick, to Q31. Range: 2^31 2^31 >> 30 = 2^32,
 * x 2^11 = 2^43, >> 7; saturated at one. */
static int32_t decay_per_slow_tick_q31(const struct gyro_cfg *cfg, int32_t decay_per_s_q22)
{
    bool clamped = false;
    int64_t per_sample_q38 = ((int64_t)decay_per_s_q22 * cfg->tuning.sample_period_q46) >> 30;
    return fixed_saturate_i32((per_sample_q38 * cfg->lockin.decimation * cfg->loops_per_slow) >> 7, &clamped);
}

/* Adds what the compensation takes away, or takes it away: `measured` is the rate as demodulated behind the decoupler, if any. */
static void compensate(const struct gyro_cfg *cfg, struct gyro_state *state, int32_t measured_q28, int32_t *compensated_q28,
                       int32_t *uncompensated_q28)
{
    int32_t static_q28 = state->bias_at_tick_q31 / 8;
    int32_t decay_q31 = decay_per_slow_tick_q31(cfg, state->decay_per_s_q22);
    *compensated_q28 = measured_q28;
    *uncompensated_q28 = measured_q28;
    if (state->compensation != GYRO_COMPENSATION_NONE && !state->decoupling) {
        *compensated_q28 = fixed_saturate_i32((int64_t)measured_q28 - static_q28, &state->overflow);
    } else if (state->decoupling) {
        int32_t removed_q28 = rate_removed_step_q28(&state->rate, state->bias_at_tick_q31, decay_q31);
        *uncompensated_q28 = fixed_saturate_i32((int64_t)measured_q28 + removed_q28, &state->overflow);
    }
}

static void take_means(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    struct gyro_signals *signals = &state->signals;
    signals->primary = mean_amplitude(cfg, &state->primary_sum);
    signals->secondary = mean_amplitude(cfg, &state->secondary_sum);
    struct complex_q30 force = mean_amplitude(cfg, &state->rebalance_sum);
    signals->rebalance_in_phase_q31 = -2 * force.i_q30;
    signals->rebalance_quadrature_q31 = 2 * force.q_q30;
}

/* What the rate is read from: amplitudes or, force in Q31 halved to Q30, what nulls them. */
static struct complex_q30 read_amplitude(const struct gyro_state *state)
{
    const struct gyro_signals *signals = &state->signals;
    if (state->loop != GYRO_LOOP_REBALANCE) {
        return signals->secondary;
    }
    return (struct complex_q30){-(signals->rebalance_in_phase_q31 / 2), signals->rebalance_quadrature_q31 / 2};
}

/* Leaves both rates unfiltered; the next slot filters them. */
static void compute_rate(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    struct gyro_signals *signals = &state->signals;
    take_means(cfg, state);
    struct rate_ratio ratio = rate_ratio_q29(signals->primary, read_amplitude(state), &state->overflow);
    int32_t measured_q28 = rate_scale_q28(ratio.in_phase_q29, state->scale_rad_s_q28, &state->overflow);
    signals->quadrature_rad_s_q28 = rate_scale_q28(ratio.quadrature_q29, state->scale_rad_s_q28, &state->overflow);
    compensate(cfg, state, measured_q28, &signals->rate_rad_s_q28, &signals->rate_uncompensated_rad_s_q28);
    signals->angle_u64 += (uint64_t)(int64_t)signals->rate_rad_s_q28;
}

static void filter_rate(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    struct gyro_signals *signals = &state->signals;
    signals->rate_rad_s_q28 = output_filter_step(cfg->output_filter, &state->filter, signals->rate_rad_s_q28, &state->overflow);
    signals->rate_uncompensated_rad_s_q28 =
        output_filter_step(cfg->output_filter, &state->filter_uncompensated, signals->rate_uncompensated_rad_s_q28, &state->overflow);
}

static bool compensation_ready(const struct gyro_cfg *cfg, const struct gyro_state *state)
{
    if (state->compensation == GYRO_COMPENSATION_NONE) {
        return true;
    }
    bool thermal = cfg->calibration_valid && state->temperature_valid;
    return state->decoupling ? thermal && state->retune_valid : thermal;
}

static uint32_t flag(bool condition, uint32_t bit)
{
    return condition ? bit : 0;
}

static uint32_t status_of(const struct gyro_cfg *cfg, const struct gyro_state *state)
{
    bool acquiring = state->acquisition.phase != ACQUISITION_DONE;
    bool locked = state->lock_ticks >= cfg->monitor.hold_ticks;
    bool rebalanced = gyro_secondary_is_controlled(cfg, state);
    bool tested = cfg->test_signal.in_phase_q31 != 0 || cfg->test_signal.quadrature_q31 != 0 || cfg->drive.phase_set_point_i32 != 0;
    bool closed_or_open = state->loop == GYRO_LOOP_OPEN || (rebalanced && !state->rebalance_saturated);
    bool rate_valid = locked && closed_or_open && !tested && !cfg->drive.off && !state->adc_saturated && !state->overflow &&
                      compensation_ready(cfg, state);
    return flag(locked, GYRO_STATUS_LOCKED) | flag(!acquiring && gyro_amplitude_in_range(cfg, state), GYRO_STATUS_AMPLITUDE_IN_RANGE) |
           flag(state->adc_saturated, GYRO_STATUS_ADC_SATURATED) | flag(state->drive_saturated, GYRO_STATUS_DRIVE_SATURATED) |
           flag(state->overflow, GYRO_STATUS_OVERFLOW) | flag(cfg->calibration_valid, GYRO_STATUS_CALIBRATION_VALID) |
           flag(state->temperature_valid, GYRO_STATUS_TEMPERATURE_VALID) | flag(state->retune_valid, GYRO_STATUS_RETUNE_VALID) |
           flag(rate_valid, GYRO_STATUS_RATE_VALID) | flag(acquiring, GYRO_STATUS_ACQUIRING) |
           flag(rebalanced, GYRO_STATUS_REBALANCE_ACTIVE) | flag(state->rebalance_saturated, GYRO_STATUS_REBALANCE_SATURATED) |
           flag(tested, GYRO_STATUS_TEST_ACTIVE) | flag(cfg->drive.off, GYRO_STATUS_DRIVE_OFF);
}

static void publish(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    struct gyro_signals *signals = &state->signals;
    signals->freq_u64 = state->oscillator.freq_u64;
    signals->drive_level_q31 = state->drive.drive_q31;
    signals->amplitude_set_point_q30 = cfg->drive.amplitude_q30;
    signals->temperature_shift_q20 = state->temperature_shift_q20;
    signals->bias_rad_s_q31 = state->bias_at_tick_q31;
    signals->status = status_of(cfg, state);
    state->adc_saturated = false;
    state->drive_saturated = false;
    state->rebalance_saturated = false;
    state->overflow = false;
}

bool gyro_slow_task(const struct gyro_cfg *cfg, struct gyro_state *state, uint32_t slot, int32_t thermometer_raw)
{
    switch (slot) {
    case GYRO_LOOP_TASKS:
        compute_rate(cfg, state);
        return false;
    case GYRO_LOOP_TASKS + 1:
        filter_rate(cfg, state);
        publish(cfg, state);
        return true;
    case GYRO_LOOP_TASKS + 2:
        take_temperature(cfg, state, thermometer_raw);
        evaluate_polynomials(cfg, state);
        return false;
    case GYRO_LOOP_TASKS + 3:
        retune(cfg, state);
        return false;
    default:
        return false;
    }
}
