#include "sim/envelope.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/elementary.h"
#include "sim/envelope_internal.h"
#include "sim/twin_internal.h"

#define PUBLISH_SAMPLES   6    /* samples of a slow period before its signals are published: slot 5, counted from one */
#define LONGEST_STEP      1000 /* slow ticks */
#define CAREFUL_TICKS     40   /* single ticks after a command */
#define FARTHEST_TURN_RAD 0.7  /* of the secondary against the primary, or of the test tone, in one step */
#define MOST_AMPLITUDE_FS 100.0 /* of either mode; no shell rings so far, and what is measured of it says nothing any more */

/* ---- creation ---------------------------------------------------------------------------------------------------------- */

/* Delays follow from the schedule of the firmware (core/gyro.h): amplitudes are measured N - 1 samples back at slot 0 of a loop tick,
 * forces computed in slots 2 and 3 act from the next sample and are held for N samples. Means that are published at slot 5 of a slow period
 * therefore belong to a window that lies a little off the one that ends there. */
static void take_delays(struct envelope *e)
{
    const struct electronics_cfg *electronics = &e->plant.electronics;
    double n = e->firmware.decimation;
    double sample_s = e->firmware.sample_s;
    double seen = n - 1.0 + electronics->adc_delay_samples;
    double held = 0.5 * n + electronics->dac_latency_samples;
    e->drive_delay_s = sample_s * (seen + 3.0 + held);
    e->rebalance_delay_s = sample_s * (seen + 4.0 + held);
    e->pll_delay_s = sample_s * (seen + 2.0 + 0.5 * n);
    e->command_delay_s = sample_s * (n - 2.0 + electronics->dac_latency_samples);
    e->amplitude_late_s = sample_s * (seen + 5.0 - 0.5 * n);
    e->force_late_s = sample_s * (1.0 - n - electronics->dac_latency_samples);
    e->sampled_late_s = -0.5 * e->firmware.slow_s;
    e->temperature_late_s = sample_s * (0.5 * e->firmware.slow_samples + PUBLISH_SAMPLES);
}

static void build_maps(struct envelope *e, uint32_t ticks, struct envelope_maps *maps)
{
    struct thermal_point unused;
    memset(maps, 0, sizeof *maps);
    maps->ticks = ticks;
    maps->step_s = ticks * e->firmware.slow_s;
    maps->drive_for.decay = maps->drive_for.proportional = NAN;
    maps->rebalance_for.proportional.re = NAN;
    thermal_init(&e->plant.thermal, maps->step_s, &maps->thermal, &unused);
    envelope_pll_build(&e->firmware, e->pll_delay_s, maps);
    envelope_filter_build(e->firmware.output_filter, ticks, &maps->filter);
}

static void build_all_maps(struct envelope *e)
{
    build_maps(e, e->cfg.step_ticks, &e->coarse);
    build_maps(e, 1, &e->single);
}

/* Effects first: they may change what the device computes with. */
static int32_t take_calibration(struct envelope *e, const uint8_t *block, size_t size)
{
    struct calibration calibration;
    if (!effect_set_init(&e->effects, e->cfg.effects, e->cfg.n_effects)) {
        return TWIN_ERROR_EFFECT;
    }
    e->cfg.effects = NULL;
    const struct hal_properties board = {
        .sample_rate_millihz = (uint32_t)(e->plant.sample_rate_hz * 1000.0 + 0.5),
        .dac_bits = e->plant.electronics.dac_bits,
    };
    const uint8_t *bytes = block ? block : calibration_default_block;
    if (calibration_parse(bytes, block ? size : CALIBRATION_BYTES, &board, &calibration) != REASON_OK) {
        return TWIN_ERROR_DEVICE;
    }
    effect_set_firmware(&e->effects, &calibration.gyro);
    envelope_firmware_init(&calibration, &e->as_calibrated);
    return TWIN_OK;
}

static int32_t check_cfg(const struct twin_cfg *plant, const struct envelope_cfg *cfg)
{
    int32_t error = twin_check_cfg(plant);
    bool lengths = cfg->step_ticks >= 1 && cfg->step_ticks <= LONGEST_STEP && cfg->frame_steps >= 1;
    return error != TWIN_OK ? error : lengths ? TWIN_OK : TWIN_ERROR_SAMPLE_RATE;
}

static int32_t init(struct envelope *e, const uint8_t *block, size_t size)
{
    int32_t error = take_calibration(e, block, size);
    if (error != TWIN_OK) {
        return error;
    }
    resonator_init(&e->plant.resonator, &e->resonator);
    double half_angle = 0.5 * e->resonator.velocity_scale_rad_s * e->as_calibrated.sample_s;
    e->carrier_gain = sin(half_angle) / half_angle;
    e->firmware = e->as_calibrated;
    take_delays(e);
    build_all_maps(e);
    envelope_reset(e);
    return TWIN_OK;
}

struct envelope *envelope_create(const struct twin_cfg *plant, const struct envelope_cfg *cfg, const uint8_t *calibration_block,
                                 size_t calibration_bytes, int32_t *error)
{
    int32_t result = check_cfg(plant, cfg);
    struct envelope *e = result == TWIN_OK ? calloc(1, sizeof *e) : NULL;
    if (e) {
        e->plant = *plant;
        e->cfg = *cfg;
        result = init(e, calibration_block, calibration_bytes);
    } else if (result == TWIN_OK) {
        result = TWIN_ERROR_MEMORY;
    }
    if (result != TWIN_OK) {
        envelope_destroy(e);
        e = NULL;
    }
    if (error) {
        *error = result;
    }
    return e;
}

void envelope_destroy(struct envelope *envelope)
{
    free(envelope);
}

/* ---- time -------------------------------------------------------------------------------------------------------------- */

static double time_at(const struct envelope *e, double tick)
{
    return (tick - 1.0) * e->firmware.slow_s + PUBLISH_SAMPLES * e->firmware.sample_s;
}

int64_t envelope_end_sample(const struct envelope *envelope, uint64_t step)
{
    uint64_t ticks = (step + 1) * envelope->cfg.step_ticks;
    return (int64_t)((ticks - 1) * envelope->firmware.slow_samples + PUBLISH_SAMPLES);
}

uint64_t envelope_single_ticks(const struct envelope *envelope)
{
    return envelope->single_ticks;
}

/* What the background has executed is taken over at the next publication. */
static uint64_t tick_of(const struct envelope *e, double time_s)
{
    double tick = ceil((time_s - PUBLISH_SAMPLES * e->firmware.sample_s) / e->firmware.slow_s - 1e-6) + 1.0;
    return tick > 0.0 ? (uint64_t)tick : 0;
}

static struct effect_context context_at(const struct envelope *e, double tick, double duration_s)
{
    return (struct effect_context){
        .time_s = time_at(e, tick),
        .duration_s = duration_s,
        .amplitude_fs = e->motion.amplitude,
        .secondary_fs = e->effects.count > 0 ? phasor_size(e->motion.secondary) : 0.0,
        .pickoff_noise_fs = {e->plant.electronics.adc_noise_rms_fs[0], e->plant.electronics.adc_noise_rms_fs[1]},
        .reference_degc = e->plant.resonator.reference_degc,
        .velocity_scale_rad_s = e->resonator.velocity_scale_rad_s,
        .sample_rate_hz = e->plant.sample_rate_hz,
        .seed = e->plant.seed,
    };
}

/* ---- start ------------------------------------------------------------------------------------------------------------- */

/* Shift from T0 as the firmware computes it, without rounding. */
static double shift_of(const struct envelope *e, double degc)
{
    double code = (degc - e->plant.thermal.thermometer_offset_degc) / e->plant.thermal.thermometer_lsb_degc;
    return (code - e->firmware.shift_offset_raw) * e->firmware.shift_per_code_degc;
}

static double reading_of(const struct envelope *e, const struct effect_context *now, double sensed_degc, double spread_degc)
{
    return shift_of(e, effect_set_reading(&e->effects, now, sensed_degc, spread_degc, e->plant.thermal.thermometer_noise_degc));
}

/* Of an element that goes through three temperatures. Without an effect on readings that is a parabola, with one the mean of a line. */
static struct span readings_of(const struct envelope *e, const struct effect_context *now, double start, double middle, double end)
{
    double last = reading_of(e, now, end, 0.0);
    if (!e->effects.reading) {
        return span_through(shift_of(e, start), shift_of(e, middle), last);
    }
    return (struct span){reading_of(e, now, start, 0.0), reading_of(e, now, 0.5 * (start + end), end - start), last};
}

static void take_point(struct envelope *e, double rate_rad_s)
{
    struct envelope_motion *motion = &e->motion;
    struct effect_context now = context_at(e, 0.0, 0.0);
    now.shell_degc = motion->temperature.shell_degc;
    now.amplitude_fs = e->firmware.amplitude_fs;
    motion->rate_rad_s = rate_rad_s;
    motion->sensed_degc = effect_set_thermometer(&e->effects, &now, motion->temperature.thermometer_degc);
    motion->last.temperature = reading_of(e, &now, motion->sensed_degc, 0.0);
    motion->tables = envelope_tables_at(e, motion->last.temperature);
    envelope_physics_at(e, &now, rate_rad_s, 0.0, &motion->physics);
}

void envelope_reset(struct envelope *envelope)
{
    bool changed = memcmp(&envelope->firmware, &envelope->as_calibrated, sizeof envelope->firmware) != 0;
    memset(&envelope->motion, 0, sizeof envelope->motion);
    envelope->motion.amplitude_command = UINT64_MAX;
    envelope->firmware = envelope->as_calibrated;
    envelope->single_ticks = 0;
    effect_set_reset(&envelope->effects);
    if (changed) {
        build_all_maps(envelope);
    }
    struct thermal_plan unused;
    thermal_init(&envelope->plant.thermal, envelope->firmware.slow_s, &unused, &envelope->motion.temperature);
}

/* The chirp leaves push sqrt(2 pi / slope), which then decays; the loops begin with half the largest force. */
static void begin_control(struct envelope *e)
{
    struct envelope_motion *motion = &e->motion;
    const struct envelope_firmware *firmware = &e->firmware;
    double ringing_s = firmware->acquisition_s - firmware->chirp_center_s;
    motion->amplitude = motion->physics.push[0][0] * firmware->drive_max_fs * sqrt(ELEMENTARY_TWO_PI / firmware->chirp_rad_s2)
                        * exp(-motion->physics.decay[0] * ringing_s);
    motion->drive_integral = 0.5 * firmware->drive_max_fs;
    motion->found = true;
    motion->careful_until = motion->tick + CAREFUL_TICKS;
}

/* ---- commands ---------------------------------------------------------------------------------------------------------- */

static void select_mode(struct envelope *e, uint32_t loop, uint32_t compensation)
{
    if (loop != e->firmware.loop || compensation != e->firmware.compensation) {
        e->motion.decoupled = 0.0;
        e->motion.removed_rad_s = 0.0;
        e->firmware.loop = loop;
        e->firmware.compensation = compensation;
        e->motion.tables = envelope_tables_at(e, e->motion.last.temperature);
    }
}

static void select_filter(struct envelope *e, uint32_t choice)
{
    if (e->firmware.output_filter == OUTPUT_FILTER_NONE) {
        envelope_filter_settle(choice, e->motion.last.rate, &e->motion.filter[0]);
        envelope_filter_settle(choice, e->motion.last.uncompensated, &e->motion.filter[1]);
    }
    e->firmware.output_filter = choice;
    envelope_filter_build(choice, e->coarse.ticks, &e->coarse.filter);
    envelope_filter_build(choice, 1, &e->single.filter);
}

static void select_pll(struct envelope *e, const double value[4])
{
    e->firmware.pll_kp = value[0];
    e->firmware.pll_ki = value[1];
    envelope_pll_build(&e->firmware, e->pll_delay_s, &e->coarse);
    envelope_pll_build(&e->firmware, e->pll_delay_s, &e->single);
}

static void execute(struct envelope *e, const struct envelope_event *event)
{
    struct envelope_firmware *firmware = &e->firmware;
    const double *value = event->value;
    switch (event->command) {
    case ENVELOPE_AMPLITUDE:
        e->motion.amplitude_command = e->motion.tick;
        firmware->amplitude_fs = value[0];
        break;
    case ENVELOPE_COMPENSATION:
        select_mode(e, firmware->loop, (uint32_t)value[0]);
        break;
    case ENVELOPE_LOOP:
        select_mode(e, (uint32_t)value[0], firmware->compensation);
        break;
    case ENVELOPE_TEST_SIGNAL:
        firmware->test_in_phase_fs = value[0];
        firmware->test_quadrature_fs = value[1];
        firmware->test_hz = value[2];
        e->motion.tone_start = e->motion.tick;
        break;
    case ENVELOPE_PHASE_SET_POINT:
        firmware->phase_set_point_rad = value[0];
        break;
    case ENVELOPE_PLL_GAINS:
        select_pll(e, value);
        break;
    case ENVELOPE_AGC_GAINS:
        firmware->agc_kp = value[0];
        firmware->agc_ki = value[1];
        break;
    case ENVELOPE_REBALANCE:
        firmware->rebalance_kp = value[0];
        firmware->rebalance_ki = value[1];
        firmware->in_phase_limit_fs = value[2];
        firmware->quadrature_limit_fs = value[3];
        break;
    case ENVELOPE_DRIVE:
        e->motion.amplitude_command = e->motion.tick;
        firmware->drive_off = value[0] == 0.0;
        break;
    default:
        select_filter(e, (uint32_t)value[0]);
        break;
    }
}

static void execute_due(struct envelope *e)
{
    struct envelope_motion *motion = &e->motion;
    const struct envelope_profile *profile = e->profile;
    while (motion->next_event < profile->n_events && tick_of(e, profile->events[motion->next_event].time_s) <= motion->tick) {
        execute(e, &profile->events[motion->next_event++]);
        motion->careful_until = motion->tick + CAREFUL_TICKS;
    }
}

/* ---- one step ---------------------------------------------------------------------------------------------------------- */

static void take_temperature(struct envelope *e, struct envelope_step *step, const struct thermal_point *middle,
                             const struct effect_context *now)
{
    struct envelope_motion *motion = &e->motion;
    double start = motion->sensed_degc;
    double end = effect_set_thermometer(&e->effects, now, motion->temperature.thermometer_degc);
    double between = e->effects.thermometer ? 0.5 * (start + end) : middle->thermometer_degc;
    struct span sensed = readings_of(e, now, start, between, end);
    motion->sensed_degc = end;
    step->temperature = span_late(sensed, e->temperature_late_s / step->step_s);
    step->temperature.start = motion->last.temperature;
    motion->last.temperature = step->temperature.end;
    bool decouples = e->firmware.compensation == GYRO_COMPENSATION_G2 && e->firmware.loop == GYRO_LOOP_OPEN;
    struct span of_bias = decouples ? sensed : step->temperature;
    step->tables = envelope_tables_at(e, step->temperature.end);
    if (decouples) {
        step->tables.bias_rad_s = envelope_polynomial(&e->firmware.bias_rad_s, sensed.end);
    }
    step->bias = (struct span){motion->tables.bias_rad_s, envelope_polynomial(&e->firmware.bias_rad_s, of_bias.mean),
                               step->tables.bias_rad_s};
    step->scale_mean = envelope_polynomial(envelope_scale(&e->firmware), step->temperature.mean);
    step->decay_mean = 0.5 * (motion->tables.decay_per_s + step->tables.decay_per_s);
    step->demodulation_mean = 0.5 * (motion->tables.demodulation_rad + step->tables.demodulation_rad);
}

/* Temperatures, and the plant at the step's middle and end. */
static void take_environment(struct envelope *e, struct envelope_step *step)
{
    struct envelope_motion *motion = &e->motion;
    struct thermal_point middle;
    double shell_start = motion->temperature.shell_degc;
    double rate_dot = (step->rate.end - step->rate.start) / step->step_s;
    thermal_step(&step->maps->thermal, &motion->temperature, step->chamber_end_degc, &middle);
    struct effect_context now = context_at(e, (double)motion->tick + 0.5 * step->maps->ticks, step->step_s);
    now.rate_rad_s = step->rate.mean;
    now.shell_slope_degc_s = (motion->temperature.shell_degc - shell_start) / step->step_s;
    now.shell_degc = middle.shell_degc;
    envelope_physics_at(e, &now, span_middle(step->rate), rate_dot, &step->middle);
    now.shell_degc = motion->temperature.shell_degc;
    now.time_s = time_at(e, (double)(motion->tick + step->maps->ticks));
    effect_set_advance(&e->effects, &now);
    envelope_physics_at(e, &now, step->rate.end, rate_dot, &step->end);
    take_temperature(e, step, &middle, &now);
    step->shell_mean = (shell_start + 4.0 * middle.shell_degc + motion->temperature.shell_degc) / 6.0;
}

/* ---- what the firmware publishes --------------------------------------------------------------------------------------- */

struct rates {
    struct span compensated, uncompensated;
    double quadrature_mean;
};

/* Ratio to the primary amplitude, in its published window, times the scale factor. */
static struct rates rates_of(struct envelope *e, const struct envelope_step *step)
{
    struct envelope_last *last = &e->motion.last;
    bool closed = e->firmware.loop == GYRO_LOOP_REBALANCE;
    const struct phasor_span *read = closed ? &step->rebalance : &step->measured;
    double late = (closed ? e->force_late_s : e->amplitude_late_s) / step->step_s;
    double mean = 1.0 / (step->middle.pickoff[0] * step->amplitude.mean);
    double end = 1.0 / (step->end.pickoff[0] * step->amplitude.end);
    struct span ratio = {last->ratio_re, read->re.mean * mean, read->re.end * end};
    struct span ratio_q = {last->ratio_im, read->im.mean * mean, read->im.end * end};
    last->ratio_re = ratio.end;
    last->ratio_im = ratio_q.end;
    ratio = span_late(ratio, late);
    ratio_q = span_late(ratio_q, late);
    struct span rate = {last->uncompensated, ratio.mean * step->scale_mean, ratio.end * step->tables.scale_rad_s};
    struct rates rates = {rate, rate, ratio_q.mean * step->scale_mean};
    bool decouples = e->firmware.compensation == GYRO_COMPENSATION_G2 && !closed;
    if (decouples) {
        rates.uncompensated = span_add(rate, step->removed);
    } else if (e->firmware.compensation != GYRO_COMPENSATION_NONE) {
        rates.compensated = span_subtract(rate, step->bias);
    }
    rates.compensated.start = last->rate;
    rates.uncompensated.start = last->uncompensated;
    last->rate = rates.compensated.end;
    last->uncompensated = rates.uncompensated.end;
    return rates;
}

static struct rates no_rates(struct envelope *e)
{
    struct envelope_last *last = &e->motion.last;
    struct rates rates = {{last->rate, 0.0, 0.0}, {last->uncompensated, 0.0, 0.0}, 0.0};
    last->rate = last->uncompensated = last->ratio_re = last->ratio_im = 0.0;
    return rates;
}

static struct phasor late_mean(const struct phasor_span *x, double late, double *last_re, double *last_im)
{
    struct phasor mean = {x->re.mean - late * (x->re.end - *last_re), x->im.mean - late * (x->im.end - *last_im)};
    *last_re = x->re.end;
    *last_im = x->im.end;
    return mean;
}

/* Amplitudes as the oscillator sees them, turned by the phase loop's angle. */
static void publish_amplitudes(struct envelope *e, const struct envelope_step *step, double *sum)
{
    struct envelope_last *last = &e->motion.last;
    struct phasor phi = phasor_turn(step->phi_mean);
    double late = e->amplitude_late_s / step->step_s;
    double amplitude = step->amplitude.mean - late * (step->amplitude.end - step->amplitude.start);
    struct phasor primary = phasor_scale(phi, step->middle.pickoff[0] * amplitude);
    struct phasor secondary =
        late_mean(&step->measured, late, &last->secondary_re, &last->secondary_im);
    struct phasor rebalance =
        late_mean(&step->rebalance, e->force_late_s / step->step_s, &last->rebalance_re, &last->rebalance_im);
    secondary = phasor_product(secondary, phi);
    rebalance = phasor_product(rebalance, phi);
    double weight = step->maps->ticks;
    sum[ENVELOPE_PRIMARY_I] += weight * primary.re;
    sum[ENVELOPE_PRIMARY_Q] += weight * primary.im;
    sum[ENVELOPE_SECONDARY_I] += weight * secondary.re;
    sum[ENVELOPE_SECONDARY_Q] += weight * secondary.im;
    sum[ENVELOPE_REBALANCE_I] -= weight * rebalance.re;
    sum[ENVELOPE_REBALANCE_Q] += weight * rebalance.im;
}

static void publish(struct envelope *e, const struct envelope_step *step, double *sum)
{
    struct envelope_motion *motion = &e->motion;
    struct rates rates = motion->found && step->amplitude.mean > 0.0 ? rates_of(e, step) : no_rates(e);
    double weight = step->maps->ticks;
    double sampled = e->sampled_late_s / step->step_s;
    publish_amplitudes(e, step, sum);
    sum[ENVELOPE_FREQUENCY] += weight * step->frequency_mean * (1.0 / ELEMENTARY_TWO_PI);
    sum[ENVELOPE_LEVEL] += weight * (step->level.mean - sampled * (step->level.end - step->level.start));
    sum[ENVELOPE_TEMPERATURE] += weight * (e->firmware.reference_degc + step->temperature.mean);
    sum[ENVELOPE_RATE] += weight * envelope_filter_step(&step->maps->filter, &motion->filter[0], rates.compensated);
    sum[ENVELOPE_UNCOMPENSATED] += weight * envelope_filter_step(&step->maps->filter, &motion->filter[1], rates.uncompensated);
    sum[ENVELOPE_QUADRATURE] += weight * rates.quadrature_mean;
    sum[ENVELOPE_SET_POINT] += weight * e->firmware.amplitude_fs;
    sum[ENVELOPE_SHELL] += weight * step->shell_mean;
}

/* False, and then motion and effects must be put back unless the step is a single tick, when a limit was reached. */
static bool run_step(struct envelope *e, struct envelope_maps *maps, struct span rate, double chamber_end_degc, double *sum)
{
    struct envelope_motion *motion = &e->motion;
    struct envelope_step step; /* every part fills its own fields: clearing a kilobyte first would cost as much as a part */
    bool single = maps == &e->single;
    step.maps = maps;
    step.step_s = maps->step_s;
    step.rate = rate;
    step.chamber_end_degc = chamber_end_degc;
    take_environment(e, &step);
    bool free = envelope_primary(e, &step);
    if (!free && !single) {
        return false;
    }
    free = envelope_secondary(e, &step) && free;
    if (!free && !single) {
        return false;
    }
    publish(e, &step, sum);
    motion->rate_rad_s = rate.end;
    motion->physics = step.end;
    motion->tables = step.tables;
    motion->tick += maps->ticks;
    return true;
}

/* ---- a run ------------------------------------------------------------------------------------------------------------- */

/* Samples that the device misses in the next ticks. */
static int32_t lost_within(const struct envelope *e, uint32_t ticks)
{
    int64_t last = (int64_t)(e->motion.tick + ticks - 1) * (int64_t)e->firmware.slow_samples + PUBLISH_SAMPLES;
    int64_t first = last - (int64_t)ticks * (int64_t)e->firmware.slow_samples + 1;
    return e->effects.lost && last > 0 ? effect_set_lost(&e->effects, first > 0 ? (uint64_t)first : 0, (uint64_t)last) : 0;
}

/* The shell gets ahead of the oscillator, until the phase loop has caught up. Decoupler and rebalance loop live in the oscillator's frame
 * and come along with it. */
static void lose_samples(struct envelope *e, int32_t lost)
{
    struct envelope_motion *motion = &e->motion;
    double angle = lost * motion->physics.primary_rad_s * e->firmware.sample_s;
    motion->phi_rad += angle;
    motion->tone_rad += angle;
    motion->careful_until = motion->tick + CAREFUL_TICKS;
}

/* The step's inputs over one of its ticks: a part of the parabola, a part of the straight line. */
static struct span part_of(struct span whole, double from, double to)
{
    double p1 = 6.0 * whole.mean - 4.0 * whole.start - 2.0 * whole.end;
    double p2 = 3.0 * (whole.start + whole.end) - 6.0 * whole.mean;
    double middle = 0.5 * (from + to);
    return span_through(whole.start + from * (p1 + from * p2), whole.start + middle * (p1 + middle * p2),
                        whole.start + to * (p1 + to * p2));
}

static void run_ticks(struct envelope *e, struct span rate, double chamber_end_degc, double *sum)
{
    double chamber_start = e->motion.temperature.chamber_degc;
    uint32_t ticks = e->cfg.step_ticks;
    for (uint32_t i = 0; i < ticks; i++) {
        double from = (double)i / ticks;
        double to = (double)(i + 1) / ticks;
        execute_due(e);
        if (!e->motion.found && time_at(e, (double)e->motion.tick) >= e->firmware.acquisition_s) {
            begin_control(e);
        }
        int32_t lost = lost_within(e, 1);
        if (lost != 0) {
            lose_samples(e, lost);
        }
        (void)run_step(e, &e->single, part_of(rate, from, to), chamber_start + to * (chamber_end_degc - chamber_start), sum);
    }
    e->single_ticks += ticks;
}

static bool event_within(const struct envelope *e)
{
    const struct envelope_motion *motion = &e->motion;
    return motion->next_event < e->profile->n_events
           && tick_of(e, e->profile->events[motion->next_event].time_s) < motion->tick + e->cfg.step_ticks;
}

static bool turns_far(const struct envelope *e)
{
    const struct envelope_physics *physics = &e->motion.physics;
    double fastest = larger(fabs(physics->detuning_rad_s), ELEMENTARY_TWO_PI * e->firmware.test_hz * 2.0);
    if (physics->tone_fs != 0.0) {
        fastest = larger(fastest, 2.0 * fabs(physics->tone_rad_s - physics->primary_rad_s));
    }
    return fastest * e->coarse.step_s > FARTHEST_TURN_RAD;
}

static bool smooth(const struct envelope *e)
{
    return lost_within(e, e->cfg.step_ticks) == 0 && e->motion.found && e->motion.tick >= e->motion.careful_until && !event_within(e) && !turns_far(e);
}

static void save_effects(struct envelope *e)
{
    if (e->effects.count > 0) {
        memcpy(e->effects_saved.active, e->effects.active, e->effects.count * sizeof e->effects.active[0]);
    }
}

static void put_back(struct envelope *e, const struct envelope_motion *motion)
{
    e->motion = *motion;
    memcpy(e->effects.active, e->effects_saved.active, e->effects.count * sizeof e->effects.active[0]);
}

static void advance(struct envelope *e, uint64_t i, double *sum)
{
    const struct envelope_profile *profile = e->profile;
    double rate_end = profile->rate_end_rad_s ? profile->rate_end_rad_s[i] : 0.0;
    double rate_mean = profile->rate_mean_rad_s ? profile->rate_mean_rad_s[i] : 0.0;
    struct span rate = {e->motion.rate_rad_s, rate_mean, rate_end};
    double chamber = profile->chamber_degc ? profile->chamber_degc[i] : e->motion.temperature.chamber_degc;
    if (smooth(e)) {
        struct envelope_motion before;
        memcpy(&before, &e->motion, sizeof before);
        save_effects(e);
        if (run_step(e, &e->coarse, rate, chamber, sum)) {
            return;
        }
        put_back(e, &before);
    }
    run_ticks(e, rate, chamber, sum);
}

static void put(double *values, uint64_t i, double value)
{
    if (values) {
        values[i] = value;
    }
}

static void write_frame(const struct envelope_record *record, uint64_t i, const double *sum, double per_tick)
{
    put(record->primary_in_phase, i, sum[ENVELOPE_PRIMARY_I] * per_tick);
    put(record->primary_quadrature, i, sum[ENVELOPE_PRIMARY_Q] * per_tick);
    put(record->secondary_in_phase, i, sum[ENVELOPE_SECONDARY_I] * per_tick);
    put(record->secondary_quadrature, i, sum[ENVELOPE_SECONDARY_Q] * per_tick);
    put(record->drive_frequency, i, sum[ENVELOPE_FREQUENCY] * per_tick);
    put(record->drive_level, i, sum[ENVELOPE_LEVEL] * per_tick);
    put(record->rebalance_in_phase, i, sum[ENVELOPE_REBALANCE_I] * per_tick);
    put(record->rebalance_quadrature, i, sum[ENVELOPE_REBALANCE_Q] * per_tick);
    put(record->temperature_measured, i, sum[ENVELOPE_TEMPERATURE] * per_tick);
    put(record->rate, i, sum[ENVELOPE_RATE] * per_tick);
    put(record->rate_uncompensated, i, sum[ENVELOPE_UNCOMPENSATED] * per_tick);
    put(record->quadrature, i, sum[ENVELOPE_QUADRATURE] * per_tick);
    put(record->amplitude_set_point, i, sum[ENVELOPE_SET_POINT] * per_tick);
    put(record->shell_degc, i, sum[ENVELOPE_SHELL] * per_tick);
}

static bool all_within(const double *values, uint64_t n, double limit)
{
    bool good = true;
    for (uint64_t i = 0; values && i < n; i++) {
        good = good && fabs(values[i]) <= limit; /* false for what is not a number */
    }
    return good;
}

static bool events_sound(const struct envelope_profile *profile)
{
    double last = -INFINITY;
    for (uint64_t i = 0; i < profile->n_events; i++) {
        const struct envelope_event *event = &profile->events[i];
        if (!(event->time_s >= last) || event->command >= ENVELOPE_COMMAND_COUNT || !all_within(event->value, 4, 1e9)) {
            return false;
        }
        last = event->time_s;
    }
    return true;
}

/* Temperatures at which the damping would be negative are found at the ends only: what lies between two steps lies between them. */
static bool profile_sound(const struct envelope *e, const struct envelope_profile *profile)
{
    double fastest = 0.1 * e->resonator.velocity_scale_rad_s;
    uint64_t n = profile->n_steps;
    double low = e->motion.temperature.shell_degc, high = low;
    for (uint64_t i = 0; profile->chamber_degc && i < n; i++) {
        low = smaller(low, profile->chamber_degc[i]);
        high = larger(high, profile->chamber_degc[i]);
    }
    return n % e->cfg.frame_steps == 0 && all_within(profile->rate_mean_rad_s, n, fastest)
           && all_within(profile->rate_end_rad_s, n, fastest) && all_within(profile->chamber_degc, n, 1e4)
           && resonator_is_passive(&e->resonator, low) && resonator_is_passive(&e->resonator, high) && events_sound(profile);
}

static void begin(struct envelope *e, const struct envelope_profile *profile)
{
    e->profile = profile;
    e->motion.next_event = 0;
    if (e->motion.tick == 0) {
        take_point(e, profile->rate_mean_rad_s && profile->n_steps > 0 ? profile->rate_mean_rad_s[0] : 0.0);
        if (e->cfg.start == ENVELOPE_START_SETTLED) {
            execute_due(e);
            envelope_settle(e);
        }
    }
}

static int32_t state_of(const struct envelope *e)
{
    bool rings = e->motion.amplitude < MOST_AMPLITUDE_FS && phasor_size(e->motion.secondary) < MOST_AMPLITUDE_FS; /* false where either is not a number */
    bool within = e->cfg.most_single_ticks == 0 || e->single_ticks <= e->cfg.most_single_ticks;
    return !rings ? TWIN_ERROR_RUNAWAY : within ? TWIN_OK : TWIN_ERROR_LIMITED;
}

int32_t envelope_run(struct envelope *envelope, const struct envelope_profile *profile, const struct envelope_record *record)
{
    if (!profile_sound(envelope, profile)) {
        return TWIN_ERROR_PROFILE;
    }
    begin(envelope, profile);
    double per_tick = 1.0 / ((double)envelope->cfg.step_ticks * envelope->cfg.frame_steps);
    int32_t result = TWIN_OK;
    for (uint64_t first = 0; first < profile->n_steps && result == TWIN_OK; first += envelope->cfg.frame_steps) {
        double sum[ENVELOPE_CHANNELS] = {0.0};
        for (uint32_t i = 0; i < envelope->cfg.frame_steps; i++) {
            advance(envelope, first + i, sum);
        }
        write_frame(record, first / envelope->cfg.frame_steps, sum, per_tick);
        result = state_of(envelope);
    }
    envelope->profile = NULL;
    return result;
}
