#include "core/gyro.h"

#include "core/fixed.h"

#define BLANK_TICKS 3u        /* the decimator's memory after a jump of the oscillator's phase */
#define SILENT_TICKS 8192u    /* loop ticks below audibility before acquisition starts again */

/* ---- forces ------------------------------------------------------------------------------------------------------------ */

/* Range: cosine^2 + sine^2 <= drive_max^2 with drive_max <= 0.9999 (checked when a configuration is built) and a phasor no
 * longer than 1 + 5e-6, so the sum stays within 2^31. */
static inline int32_t force_sample_q31(struct gyro_force force, struct phasor_q30 reference)
{
    return (int32_t)(((int64_t)force.cosine_q31 * reference.cosine_q30 + (int64_t)force.sine_q31 * reference.sine_q30) >> 30);
}

/* The force that is in step with the velocity: 90 degrees ahead of the displacement, plus what the loop delay takes. */
static struct gyro_force force_from_level(int32_t level_q31, struct phasor_q30 lead)
{
    struct gyro_force force = {
        (int32_t)(((int64_t)level_q31 * lead.cosine_q30) >> 30),
        (int32_t)(-(((int64_t)level_q31 * lead.sine_q30) >> 30)),
    };
    return force;
}

/* rad in Q31 -> 2^32 = one turn: divided by pi. Range: 2^31 / pi. */
static uint32_t turns_from_rad_q31(int32_t angle_rad_q31)
{
    return (uint32_t)fixed_mul_q31(angle_rad_q31, INT32_C(683565276));
}

static struct phasor_q30 drive_lead(const struct gyro_cfg *cfg, const struct gyro_state *state)
{
    uint64_t freq_u32 = state->oscillator.freq_u64 >> 32;
    uint32_t delay_u32 = (uint32_t)((freq_u32 * cfg->loop_delay_samples_q16) >> 16);
    return oscillator_phasor(UINT32_C(0x40000000) + delay_u32 + turns_from_rad_q31(state->drive_phase_rad_q31));
}

/* In-phase part along the lead (it acts like the Coriolis force), quadrature part 90 degrees behind it (like a stiffness). */
static struct gyro_force force_from_parts(int32_t in_phase_q31, int32_t quadrature_q31, struct phasor_q30 lead)
{
    struct phasor_q30 behind = {lead.sine_q30, -lead.cosine_q30};
    struct gyro_force in_phase = force_from_level(in_phase_q31, lead);
    struct gyro_force quadrature = force_from_level(quadrature_q31, behind);
    struct gyro_force force = {in_phase.cosine_q31 + quadrature.cosine_q31, in_phase.sine_q31 + quadrature.sine_q31};
    return force;
}

/* a exp(-j angle of turn). Range: |a| < 1.28 sqrt(2) keeps every sum of two Q60 products below 2^62. */
static struct complex_q30 turn_back(struct complex_q30 a, struct phasor_q30 turn)
{
    struct complex_q30 result = {
        (int32_t)(((int64_t)a.i_q30 * turn.cosine_q30 + (int64_t)a.q_q30 * turn.sine_q30) >> 30),
        (int32_t)(((int64_t)a.q_q30 * turn.cosine_q30 - (int64_t)a.i_q30 * turn.sine_q30) >> 30),
    };
    return result;
}

/* ---- loop tick --------------------------------------------------------------------------------------------------------- */

static void add_amplitude(struct gyro_sum *sum, struct complex_q30 amplitude)
{
    sum->i_q30 += amplitude.i_q30;
    sum->q_q30 += amplitude.q_q30;
}

/* Between two retunings the decoupler's gain follows the bias's expected course. */
static void follow_bias(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    state->bias_rad_s_q31 = fixed_saturate_i32((int64_t)state->bias_rad_s_q31 + state->bias_step_q31, &state->overflow);
    state->decoupler_coefs.gain_q48 = decoupler_gain_q48(&cfg->tuning, state->decay_per_s_q22, state->bias_rad_s_q31, &state->overflow);
}

static void measure_amplitudes(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    state->primary = lockin_output(&cfg->lockin, &state->primary_lockin);
    state->secondary = turn_back(lockin_output(&cfg->lockin, &state->secondary_lockin), state->demodulation);
    add_amplitude(&state->primary_sum, state->primary);
    add_amplitude(&state->secondary_sum, state->secondary);
    follow_bias(cfg, state);
}

static void begin_drive_loop(const struct gyro_cfg *cfg, struct gyro_state *state, struct acquisition_output found)
{
    drive_loop_reset(&state->drive, found.freq_u64, cfg->drive.drive_max_q31 / 2);
    state->oscillator.phase_u64 += (uint64_t)found.advance_u32 << 32;
    state->blank_ticks = BLANK_TICKS;
    state->lock_ticks = 0;
    state->silent_ticks = 0;
}

static void acquire(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    struct acquisition_output found = acquisition_step(&cfg->acquisition, &state->acquisition, state->primary_polar);
    state->oscillator.freq_u64 = found.freq_u64;
    state->drive.freq_u64 = found.freq_u64;
    state->drive.drive_q31 = found.force_on ? cfg->drive.drive_max_q31 : 0;
    if (found.done) {
        begin_drive_loop(cfg, state, found);
    }
    state->drive_lead = drive_lead(cfg, state);
}

static void watch_silence(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    state->silent_ticks = state->drive.amplitude_q30 < cfg->acquisition.audible_q30 ? state->silent_ticks + 1 : 0;
    if (state->silent_ticks >= SILENT_TICKS) {
        acquisition_reset(&cfg->acquisition, &state->acquisition);
        state->silent_ticks = 0;
        state->lock_ticks = 0;
    }
}

static void control_drive(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    if (state->blank_ticks > 0) {
        state->blank_ticks--;
        return;
    }
    drive_loop_step(&cfg->drive, &state->drive, state->primary_polar);
    state->oscillator.freq_u64 = state->drive.freq_u64;
    state->drive_saturated = state->drive_saturated || state->drive.saturated;
    watch_silence(cfg, state);
}

static void run_drive(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    if (state->acquisition.phase != ACQUISITION_DONE) {
        acquire(cfg, state);
    } else {
        control_drive(cfg, state);
    }
    state->drive_force = force_from_level(state->drive.drive_q31, state->drive_lead);
}

static bool secondary_is_controlled(const struct gyro_cfg *cfg, const struct gyro_state *state)
{
    return state->loop == GYRO_LOOP_REBALANCE && state->acquisition.phase == ACQUISITION_DONE && state->blank_ticks == 0 &&
           state->drive.amplitude_q30 > cfg->drive.amplitude_q30 / 2;
}

/* Forces on the secondary mode: rebalance, if that loop is closed, and the test force. */
static void run_secondary(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    if (secondary_is_controlled(cfg, state)) {
        rebalance_step(&cfg->rebalance, &state->rebalance, state->secondary);
    } else {
        rebalance_reset(&state->rebalance);
    }
    const struct rebalance_axis *in_phase = &state->rebalance.in_phase;
    const struct rebalance_axis *quadrature = &state->rebalance.quadrature;
    struct complex_q30 read = {-(in_phase->force_q31 / 2), quadrature->force_q31 / 2};
    struct test_signal_force test = test_signal_step(&cfg->test_signal, &state->test_signal);
    bool saturated = in_phase->saturated || quadrature->saturated;
    int64_t in_phase_limit = cfg->rebalance.in_phase_limit_q31;
    int64_t quadrature_limit = cfg->rebalance.quadrature_limit_q31;
    int64_t in_phase_q31 = (int64_t)in_phase->force_q31 + test.in_phase_q31;
    int64_t quadrature_q31 = (int64_t)quadrature->force_q31 + test.quadrature_q31;
    in_phase_q31 = fixed_clamp_i64(in_phase_q31, -in_phase_limit, in_phase_limit, &saturated);
    quadrature_q31 = fixed_clamp_i64(quadrature_q31, -quadrature_limit, quadrature_limit, &saturated);
    add_amplitude(&state->rebalance_sum, read);
    state->rebalance_force = force_from_parts((int32_t)in_phase_q31, (int32_t)quadrature_q31, state->drive_lead);
    state->rebalance_saturated = state->rebalance_saturated || saturated;
}

static int32_t distance(int32_t a, int32_t b)
{
    int64_t difference = (int64_t)a - b;
    return (int32_t)((difference < 0 ? -difference : difference) >> 1); /* halved: fits 32 bit */
}

static bool amplitude_in_range(const struct gyro_cfg *cfg, const struct gyro_state *state)
{
    return distance(state->drive.amplitude_q30, cfg->drive.amplitude_q30) <= cfg->monitor.amplitude_limit_q30 / 2;
}

static void watch_lock(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    bool within = state->acquisition.phase == ACQUISITION_DONE && state->blank_ticks == 0 && amplitude_in_range(cfg, state) &&
                  distance(state->drive.phase_error_i32, 0) <= cfg->monitor.phase_limit_i32 / 2;
    if (!within) {
        state->lock_ticks = 0;
    } else if (state->lock_ticks < cfg->monitor.hold_ticks) {
        state->lock_ticks++;
    }
}

/* ---- slow tick --------------------------------------------------------------------------------------------------------- */

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
    state->demodulation = oscillator_phasor(turns_from_rad_q31(phase_rad_q31));
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

static void retune(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    state->retune_valid = decoupler_retune(&cfg->tuning, state->oscillator.freq_u64, state->decay_per_s_q22,
                                           state->bias_rad_s_q31, &state->decoupler_coefs);
    (void)decoupler_two_cosine(&cfg->tuning, state->oscillator.freq_u64, &state->two_cos_q30);
    state->drive_lead = drive_lead(cfg, state);
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

static void compute_rate(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    struct gyro_signals *signals = &state->signals;
    bool valid = false;
    int32_t compensated_q28, uncompensated_q28;
    signals->primary = mean_amplitude(cfg, &state->primary_sum);
    signals->secondary = mean_amplitude(cfg, &state->secondary_sum);
    struct complex_q30 force = mean_amplitude(cfg, &state->rebalance_sum);
    signals->rebalance_in_phase_q31 = -2 * force.i_q30;
    signals->rebalance_quadrature_q31 = 2 * force.q_q30;
    struct complex_q30 read = state->loop == GYRO_LOOP_REBALANCE ? force : signals->secondary;
    struct complex_q30 read_quadrature = {read.q_q30, -read.i_q30};
    int32_t ratio_q29 = rate_ratio_q29(signals->primary, read, &valid, &state->overflow);
    int32_t measured_q28 = rate_scale_q28(ratio_q29, state->scale_rad_s_q28, &state->overflow);
    ratio_q29 = rate_ratio_q29(signals->primary, read_quadrature, &valid, &state->overflow);
    signals->quadrature_rad_s_q28 = rate_scale_q28(ratio_q29, state->scale_rad_s_q28, &state->overflow);
    compensate(cfg, state, measured_q28, &compensated_q28, &uncompensated_q28);
    signals->angle_u64 += (uint64_t)(int64_t)compensated_q28;
    signals->rate_rad_s_q28 = output_filter_step(cfg->output_filter, &state->filter, compensated_q28, &state->overflow);
    signals->rate_uncompensated_rad_s_q28 =
        output_filter_step(cfg->output_filter, &state->filter_uncompensated, uncompensated_q28, &state->overflow);
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
    bool rebalanced = secondary_is_controlled(cfg, state);
    bool tested = cfg->test_signal.in_phase_q31 != 0 || cfg->test_signal.quadrature_q31 != 0;
    bool closed_or_open = state->loop == GYRO_LOOP_OPEN || (rebalanced && !state->rebalance_saturated);
    bool rate_valid = locked && closed_or_open && !tested && !state->adc_saturated && !state->overflow &&
                      compensation_ready(cfg, state);
    return flag(locked, GYRO_STATUS_LOCKED) | flag(!acquiring && amplitude_in_range(cfg, state), GYRO_STATUS_AMPLITUDE_IN_RANGE) |
           flag(state->adc_saturated, GYRO_STATUS_ADC_SATURATED) | flag(state->drive_saturated, GYRO_STATUS_DRIVE_SATURATED) |
           flag(state->overflow, GYRO_STATUS_OVERFLOW) | flag(cfg->calibration_valid, GYRO_STATUS_CALIBRATION_VALID) |
           flag(state->temperature_valid, GYRO_STATUS_TEMPERATURE_VALID) | flag(state->retune_valid, GYRO_STATUS_RETUNE_VALID) |
           flag(rate_valid, GYRO_STATUS_RATE_VALID) | flag(acquiring, GYRO_STATUS_ACQUIRING) |
           flag(rebalanced, GYRO_STATUS_REBALANCE_ACTIVE) | flag(state->rebalance_saturated, GYRO_STATUS_REBALANCE_SATURATED) |
           flag(tested, GYRO_STATUS_TEST_ACTIVE);
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

/* ---- schedule ---------------------------------------------------------------------------------------------------------- */

static void run_slow_task(const struct gyro_cfg *cfg, struct gyro_state *state, const struct gyro_input *input,
                          struct gyro_output *output)
{
    switch (state->loop_slot) {
    case 4:
        compute_rate(cfg, state);
        break;
    case 5:
        publish(cfg, state);
        output->slow_tick = true;
        break;
    case 6:
        take_temperature(cfg, state, input->thermometer_raw);
        evaluate_polynomials(cfg, state);
        break;
    case 7:
        retune(cfg, state);
        break;
    default:
        break;
    }
}

/* One task a sample: slots 0 to 3 of every loop tick belong to the loops, slots 4 to 7 of the first one of a slow period to the rate. */
static void run_task(const struct gyro_cfg *cfg, struct gyro_state *state, const struct gyro_input *input,
                     struct gyro_output *output)
{
    switch (state->loop_slot) {
    case 0:
        measure_amplitudes(cfg, state);
        break;
    case 1:
        state->primary_polar = polar_from_complex(state->primary);
        break;
    case 2:
        run_drive(cfg, state);
        watch_lock(cfg, state);
        break;
    case 3:
        run_secondary(cfg, state);
        break;
    default:
        if (state->slow_slot == 0) {
            run_slow_task(cfg, state, input, output);
        }
        break;
    }
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
    state->drive_lead = drive_lead(cfg, state);
    state->demodulation = oscillator_phasor(0);
    (void)decoupler_two_cosine(&cfg->tuning, cfg->tuning.center_freq_u64, &state->two_cos_q30);
    state->signals.freq_u64 = cfg->tuning.center_freq_u64;
}

static inline bool beyond(int32_t value, int32_t limit)
{
    return value > limit || value < -limit;
}

struct gyro_output gyro_step(const struct gyro_cfg *cfg, struct gyro_state *state, const struct gyro_input *input)
{
    struct phasor_q30 reference = oscillator_phasor(oscillator_step(&state->oscillator));
    int32_t secondary_q31 = input->secondary_q31;
    state->adc_saturated |= beyond(input->primary_q31, cfg->monitor.adc_limit_q31) ||
                            beyond(secondary_q31, cfg->monitor.adc_limit_q31);
    if (state->decoupling) {
        int32_t leaked_q31 = decoupler_step(&state->decoupler_coefs, &state->decoupler, input->primary_q31, &state->overflow);
        secondary_q31 = fixed_saturate_i32((int64_t)secondary_q31 - leaked_q31, &state->overflow);
    }
    lockin_step(&state->primary_lockin, input->primary_q31, reference);
    lockin_step(&state->secondary_lockin, secondary_q31, reference);
    struct gyro_output output = {
        dac_shaper_step(&state->drive_shaper, force_sample_q31(state->drive_force, reference), state->two_cos_q30, cfg->dac_shift,
                        &state->drive_saturated),
        dac_shaper_step(&state->rebalance_shaper, force_sample_q31(state->rebalance_force, reference), state->two_cos_q30,
                        cfg->dac_shift, &state->rebalance_saturated),
        false,
    };
    run_task(cfg, state, input, &output);
    advance_slot(cfg, state);
    return output;
}
