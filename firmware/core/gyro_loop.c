/* Loop tick: amplitudes, drive loop, forces on the secondary axis. */
#include "core/gyro_tasks.h"

#include "core/fixed.h"

#define BLANK_TICKS 3u        /* the decimator's memory after a jump of the oscillator's phase */
#define SILENT_TICKS 8192u    /* loop ticks below audibility before acquisition starts again */

/* ---- forces ------------------------------------------------------------------------------------------------------------ */

/* The force that is in step with the velocity: 90 degrees ahead of the displacement, plus what the loop delay takes. */
static struct gyro_force force_from_level(int32_t level_q31, struct phasor_q30 lead)
{
    struct gyro_force force = {
        (int32_t)(((int64_t)level_q31 * lead.cosine_q30) >> 30),
        (int32_t)(-(((int64_t)level_q31 * lead.sine_q30) >> 30)),
    };
    return force;
}

struct phasor_q30 gyro_drive_lead(const struct gyro_cfg *cfg, const struct gyro_state *state)
{
    uint64_t freq_u32 = state->oscillator.freq_u64 >> 32;
    uint32_t delay_u32 = (uint32_t)((freq_u32 * cfg->loop_delay_samples_q16) >> 16);
    return oscillator_phasor(UINT32_C(0x40000000) + delay_u32 + gyro_turns_from_rad_q31(state->drive_phase_rad_q31));
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

/* ---- tasks ------------------------------------------------------------------------------------------------------------- */

static void add_amplitude(struct gyro_sum *sum, struct complex_q30 amplitude)
{
    sum->i_q30 += amplitude.i_q30;
    sum->q_q30 += amplitude.q_q30;
}

/* Between two retunings the decoupler's gain follows the bias's expected course; what leaves the range has the gain's own sign. */
static void follow_bias(struct gyro_state *state)
{
    int32_t last_q48 = state->decoupler_coefs.minus_gain_q48, gain_q48;
    if (fixed_sub_wraps(last_q48, state->gain_step_q48, &gain_q48) || gain_q48 > DECOUPLER_GAIN_MAX_Q48 ||
        gain_q48 < -DECOUPLER_GAIN_MAX_Q48) {
        state->overflow = true;
        gain_q48 = last_q48 < 0 ? -DECOUPLER_GAIN_MAX_Q48 : DECOUPLER_GAIN_MAX_Q48;
    }
    state->decoupler_coefs.minus_gain_q48 = gain_q48;
    state->bias_rad_s_q31 = fixed_saturate_i32((int64_t)state->bias_rad_s_q31 + state->bias_step_q31, &state->overflow);
}

static void measure_amplitudes(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    state->primary = lockin_output(&cfg->lockin, &state->primary_lockin);
    state->secondary = turn_back(lockin_output(&cfg->lockin, &state->secondary_lockin), state->demodulation);
    add_amplitude(&state->primary_sum, state->primary);
    add_amplitude(&state->secondary_sum, state->secondary);
    if (state->decoupling) {
        follow_bias(state);
    }
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
    state->drive_lead = gyro_drive_lead(cfg, state);
}

/* A shell that rings down on purpose is not lost. */
static void watch_silence(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    bool lost = state->drive.amplitude_q30 < cfg->acquisition.audible_q30 && !cfg->drive.off;
    state->silent_ticks = lost ? state->silent_ticks + 1 : 0;
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
    if (cfg->drive.off && state->primary_polar.magnitude_q30 < cfg->acquisition.audible_q30) {
        drive_loop_hold(&state->drive, state->primary_polar.magnitude_q30);
    } else {
        drive_loop_step(&cfg->drive, &state->drive, state->primary_polar);
    }
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

bool gyro_secondary_is_controlled(const struct gyro_cfg *cfg, const struct gyro_state *state)
{
    return state->loop == GYRO_LOOP_REBALANCE && state->acquisition.phase == ACQUISITION_DONE && state->blank_ticks == 0 &&
           state->drive.amplitude_q30 > cfg->drive.amplitude_q30 / 2;
}

/* Forces on the secondary mode: rebalance, if that loop is closed, and the test force. */
static void force_secondary(const struct gyro_cfg *cfg, struct gyro_state *state)
{
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

static void run_secondary(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    bool controlled = gyro_secondary_is_controlled(cfg, state);
    bool tested = cfg->test_signal.in_phase_q31 != 0 || cfg->test_signal.quadrature_q31 != 0;
    if (controlled) {
        rebalance_step(&cfg->rebalance, &state->rebalance, state->secondary);
    } else {
        rebalance_reset(&state->rebalance);
    }
    if (controlled || tested) {
        force_secondary(cfg, state);
    } else {
        state->test_signal.phase_u32 = 0;
        state->rebalance_force = (struct gyro_force){0, 0};
    }
}

int32_t gyro_half_distance(int32_t a, int32_t b)
{
    uint32_t distance = a < b ? (uint32_t)b - (uint32_t)a : (uint32_t)a - (uint32_t)b;
    return (int32_t)(distance >> 1);
}

bool gyro_amplitude_in_range(const struct gyro_cfg *cfg, const struct gyro_state *state)
{
    return gyro_half_distance(state->drive.amplitude_q30, cfg->drive.amplitude_q30) <= cfg->monitor.amplitude_limit_q30 / 2;
}

static void watch_lock(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    bool within = state->acquisition.phase == ACQUISITION_DONE && state->blank_ticks == 0 && gyro_amplitude_in_range(cfg, state) &&
                  gyro_half_distance(state->drive.phase_error_i32, 0) <= cfg->monitor.phase_limit_i32 / 2;
    if (!within) {
        state->lock_ticks = 0;
    } else if (state->lock_ticks < cfg->monitor.hold_ticks) {
        state->lock_ticks++;
    }
}

void gyro_loop_tick(const struct gyro_cfg *cfg, struct gyro_state *state)
{
    state->loop_slot = 0;
    state->slow_slot++;
    if (state->slow_slot >= cfg->loops_per_slow) {
        state->slow_slot = 0;
    }
    measure_amplitudes(cfg, state);
}

void gyro_loop_task(const struct gyro_cfg *cfg, struct gyro_state *state, uint32_t slot)
{
    switch (slot) {
    case 0:
        state->primary_polar = polar_from_complex(state->primary);
        break;
    case 1:
        run_drive(cfg, state);
        watch_lock(cfg, state);
        break;
    default:
        run_secondary(cfg, state);
        break;
    }
}
