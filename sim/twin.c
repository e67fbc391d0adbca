#include "sim/twin.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/twin_internal.h"

/* ---- creation ---------------------------------------------------------------------------------------------------------- */

/* now: the instant of the reading. */
static void read_thermometer(struct twin *twin, const struct effect_context *now)
{
    double noise_degc = 0.0;
    double sensed_degc = effect_set_thermometer(&twin->effects, now, twin->temperature.thermometer_degc);
    if (twin->cfg.thermal.thermometer_noise_degc > 0.0) {
        noise_gaussian(&twin->noise_table, &twin->stream[TWIN_STREAM_THERMOMETER], 1, &noise_degc);
        noise_degc *= twin->cfg.thermal.thermometer_noise_degc;
    }
    double reading_degc = effect_set_reading(&twin->effects, now, sensed_degc + noise_degc, 0.0, 0.0);
    twin->thermometer_code = thermometer_code(&twin->cfg.thermal, reading_degc);
    wg_device_set_thermometer(twin->device, twin->thermometer_code);
}

void twin_parameters_at(const struct twin *twin, const struct effect_context *now, double rate_rad_s, double rate_dot_rad_s2,
                        struct plant_parameters *parameters)
{
    resonator_coefs_at(&twin->resonator, now->shell_degc, rate_rad_s, rate_dot_rad_s2, &parameters->resonator);
    parameters->path = path_nominal();
    effect_set_parameters(&twin->effects, now, parameters);
}

static double amplitude_of(const struct twin *twin, int mode)
{
    pair motion = twin->motion.mode[mode];
    return sqrt(motion[0] * motion[0] + motion[1] * motion[1]);
}

struct effect_context twin_context(const struct twin *twin, double blocks)
{
    double block_s = twin->cfg.block_samples / twin->cfg.sample_rate_hz;
    return (struct effect_context){
        .time_s = (double)twin->sample / twin->cfg.sample_rate_hz + blocks * block_s,
        .duration_s = block_s,
        .amplitude_fs = twin->effects.count > 0 ? amplitude_of(twin, 0) : 0.0,
        .secondary_fs = twin->effects.count > 0 ? amplitude_of(twin, 1) : 0.0,
        .pickoff_noise_fs = {twin->cfg.electronics.adc_noise_rms_fs[0], twin->cfg.electronics.adc_noise_rms_fs[1]},
        .reference_degc = twin->cfg.resonator.reference_degc,
        .velocity_scale_rad_s = twin->resonator.velocity_scale_rad_s,
        .sample_rate_hz = twin->cfg.sample_rate_hz,
        .seed = twin->cfg.seed,
    };
}

static void set_path(struct twin *twin, const struct path_parameters *path)
{
    const struct electronics_cfg *electronics = &twin->cfg.electronics;
    double period_s = path->clock_ratio / twin->cfg.sample_rate_hz;
    struct sampling_delays delays = {
        .latency_samples = electronics->dac_latency_samples + path->force_delay_s / period_s,
        .pickoff_samples = {electronics->adc_delay_samples + path->pickoff_delay_s[0] / period_s,
                            electronics->adc_delay_samples + electronics->adc_secondary_delay_samples + path->pickoff_delay_s[1] / period_s},
        .drive_feedthrough = path->drive_feedthrough,
        .drive_edge_feedthrough = path->drive_edge_feedthrough,
    };
    sampling_plan_init(period_s, &delays, &twin->sampling_plan);
    adc_set_gain(&twin->adc, path->pickoff_gain);
}

/* Parameters of the block's middle; plan and maps only when one of them changed. */
static void set_parameters(struct twin *twin, const struct effect_context *now, double rate_rad_s, double rate_dot_rad_s2)
{
    struct plant_parameters parameters;
    twin_parameters_at(twin, now, rate_rad_s, rate_dot_rad_s2, &parameters);
    if (memcmp(&parameters.path, &twin->parameters.path, sizeof parameters.path) != 0) {
        set_path(twin, &parameters.path);
    }
    if (memcmp(&parameters, &twin->parameters, sizeof parameters) != 0) {
        twin->parameters = parameters;
        sampling_map_at(&twin->sampling_plan, &parameters.resonator, twin->resonator.velocity_scale_rad_s, &twin->map);
    }
}

/* At rest, at power-up. */
static void set_first_parameters(struct twin *twin)
{
    struct effect_context now = twin_context(twin, 0.0);
    now.duration_s = 0.0;
    now.shell_degc = twin->temperature.shell_degc;
    set_parameters(twin, &now, 0.0, 0.0);
    read_thermometer(twin, &now);
}

static void init_parts(struct twin *twin)
{
    const struct twin_cfg *cfg = &twin->cfg;
    resonator_init(&cfg->resonator, &twin->resonator);
    thermal_init(&cfg->thermal, 1.0 / cfg->sample_rate_hz * cfg->block_samples, &twin->thermal_plan, &twin->temperature);
    noise_table_init(&twin->noise_table);
    dac_init(&cfg->electronics, &twin->dac);
    adc_init(&cfg->electronics, &twin->adc);
    for (uint32_t stream = 0; stream < TWIN_STREAM_COUNT; stream++) {
        noise_init(&twin->stream[stream], cfg->seed, stream);
    }
}

static struct wg_device *create_device(const struct twin_cfg *cfg, const uint8_t *block, size_t size)
{
    struct wg_device_cfg device = {
        .sample_rate_millihz = (uint32_t)(cfg->sample_rate_hz * 1000.0 + 0.5),
        .adc_bits = cfg->electronics.adc_bits,
        .dac_bits = cfg->electronics.dac_bits,
        .serial = cfg->serial,
    };
    return wg_device_create(&device, block, size);
}

/* Everything that can fail. */
static int32_t acquire_parts(struct twin *twin, const uint8_t *block, size_t size)
{
    for (int channel = 0; channel < 2; channel++) {
        twin->noise[channel] = calloc(twin->cfg.block_samples, sizeof(double));
        if (!twin->noise[channel]) {
            return TWIN_ERROR_MEMORY;
        }
    }
    twin->device = create_device(&twin->cfg, block, size);
    return twin->device ? TWIN_OK : TWIN_ERROR_DEVICE;
}

static int32_t create(const struct twin_cfg *cfg, const uint8_t *block, size_t size, struct twin **result)
{
    int32_t error = twin_check_cfg(cfg);
    if (error != TWIN_OK) {
        return error;
    }
    struct twin *twin = calloc(1, sizeof *twin);
    if (!twin) {
        return TWIN_ERROR_MEMORY;
    }
    twin->cfg = *cfg;
    init_parts(twin);
    error = acquire_parts(twin, block, size);
    if (error != TWIN_OK) {
        twin_destroy(twin);
        return error;
    }
    set_first_parameters(twin);
    *result = twin;
    return TWIN_OK;
}

struct twin *twin_create(const struct twin_cfg *cfg, const uint8_t *calibration_block, size_t calibration_bytes, int32_t *error)
{
    struct twin *twin = NULL;
    int32_t result = create(cfg, calibration_block, calibration_bytes, &twin);
    if (error) {
        *error = result;
    }
    return twin;
}

void twin_destroy(struct twin *twin)
{
    if (!twin) {
        return;
    }
    if (twin->device) {
        wg_device_destroy(twin->device);
    }
    free(twin->noise[0]);
    free(twin->noise[1]);
    free(twin);
}

int32_t twin_set_effects(struct twin *twin, const struct effect_setting *effects, uint32_t n_effects)
{
    int32_t result = effect_set_init(&twin->effects, effects, n_effects) ? TWIN_OK : TWIN_ERROR_EFFECT;
    struct application *app = &twin->device->board.app;
    effect_set_firmware(&twin->effects, &app->calibration.gyro);
    app->cfgs[0] = app->cfgs[1] = app->calibration.gyro;
    gyro_reset(app->cfg, &app->gyro);
    noise_init(&twin->stream[TWIN_STREAM_THERMOMETER], twin->cfg.seed, TWIN_STREAM_THERMOMETER);
    set_first_parameters(twin);
    return result;
}

struct wg_device *twin_device(struct twin *twin)
{
    return twin->device;
}

/* ---- one block --------------------------------------------------------------------------------------------------------- */

static void draw_noise(struct twin *twin)
{
    for (int channel = 0; channel < 2; channel++) {
        if (twin->adc.noise_codes[channel] > 0.0) {
            noise_gaussian(&twin->noise_table, &twin->stream[TWIN_STREAM_ADC_PRIMARY + channel], twin->cfg.block_samples,
                           twin->noise[channel]);
        }
    }
}

static pair through_effects(const struct twin *twin, uint64_t sample, const struct resonator_state *motion, pair seen)
{
    double scale = twin->resonator.velocity_scale_rad_s;
    double velocity[2] = {motion->mode[0][1] * scale, motion->mode[1][1] * scale};
    double values[2] = {seen[0], seen[1]};
    effect_set_pickoff(&twin->effects, &twin->now, sample, velocity, values);
    return (pair){values[0], values[1]};
}

/* The device, unless an effect loses the sample: the forces then stay as they are. Or gives it twice. */
static void call_device(struct twin *twin, uint64_t sample, const int32_t adc[2], int32_t dac[2])
{
    int32_t lost = effect_set_lost(&twin->effects, sample, sample);
    for (int32_t times = 1 - lost; times > 0; times--) {
        wg_device_sample(twin->device, adc, twin->dac_codes);
    }
    memcpy(dac, twin->dac_codes, sizeof twin->dac_codes);
}

/* Samples first .. end - 1 of the present block. codes: 4 per sample of the block, or NULL. What the loop uses all the time is held in
 * local variables, so that a compiler need not fear that the device changes it. hooked, ramp: constants of the caller. A rate that moves within
 * the block moves within the interval's map: held for whole carrier periods it would mix with the carrier (1/(2 w) of its slope). */
static inline void run_samples_as(struct twin *twin, uint32_t first, uint32_t end, int32_t *codes, bool hooked, bool ramp)
{
    struct wg_device *device = twin->device;
    const struct sampling_plan plan = twin->sampling_plan;
    const double *noise[2] = {twin->noise[0], twin->noise[1]};
    const double rate_step_rad_s = twin->parameters.resonator.rate_dot_rad_s2 * plan.period_s;
    const double middle = 0.5 * (twin->cfg.block_samples - 1);
    struct resonator_state motion = twin->motion;
    uint64_t sample = twin->sample;
    uint64_t adc_saturations = 0;
    uint64_t dac_saturations = 0;
    for (uint32_t i = first; i < end; i++) {
        int32_t adc[2], dac[2];
        sample++;
        double rate_rad_s = ramp ? rate_step_rad_s * (i - middle) : 0.0;
        pair seen = sampling_step(&plan, &twin->map, &twin->history, sample, rate_rad_s, &motion);
        seen = hooked ? through_effects(twin, sample, &motion, seen) : seen;
        adc_convert(&twin->adc, seen, (pair){noise[0][i], noise[1][i]}, adc, &adc_saturations);
        if (hooked) {
            call_device(twin, sample, adc, dac);
        } else {
            wg_device_sample(device, adc, dac);
        }
        sampling_push_force(&twin->history, sample, dac_convert(&twin->dac, dac, &dac_saturations));
        if (codes) {
            memcpy(codes + 4 * i, adc, sizeof adc);
            memcpy(codes + 4 * i + 2, dac, sizeof dac);
        }
    }
    twin->motion = motion;
    twin->sample = sample;
    twin->adc_saturations += adc_saturations;
    twin->dac_saturations += dac_saturations;
}

/* Out of line, so that the plainest loop stays as it is where it is. */
static void __attribute__((noinline)) run_samples_with_effects(struct twin *twin, uint32_t first, uint32_t end, int32_t *codes)
{
    run_samples_as(twin, first, end, codes, true, true);
}

static void __attribute__((noinline)) run_samples_with_ramp(struct twin *twin, uint32_t first, uint32_t end, int32_t *codes)
{
    run_samples_as(twin, first, end, codes, false, true);
}

static void run_samples(struct twin *twin, uint32_t first, uint32_t end, int32_t *codes)
{
    if (twin->effects.pickoff || twin->effects.lost) {
        run_samples_with_effects(twin, first, end, codes);
    } else if (twin->parameters.resonator.rate_dot_rad_s2 != 0.0) {
        run_samples_with_ramp(twin, first, end, codes);
    } else {
        run_samples_as(twin, first, end, codes, false, false);
    }
}

static void run_block(struct twin *twin, double rate_rad_s, double rate_dot_rad_s2, double chamber_end_degc, int32_t *codes)
{
    struct thermal_point middle;
    uint32_t last = twin->cfg.block_samples - 1;
    double shell_start_degc = twin->temperature.shell_degc;
    struct effect_context now = twin_context(twin, 0.5);
    thermal_step(&twin->thermal_plan, &twin->temperature, chamber_end_degc, &middle);
    now.shell_degc = middle.shell_degc;
    now.rate_rad_s = rate_rad_s;
    now.shell_slope_degc_s = (twin->temperature.shell_degc - shell_start_degc) / now.duration_s;
    set_parameters(twin, &now, rate_rad_s, rate_dot_rad_s2);
    twin->now = now;
    draw_noise(twin);
    run_samples(twin, 0, last, codes);
    now.time_s += 0.5 * now.duration_s;
    now.shell_degc = twin->temperature.shell_degc;
    effect_set_advance(&twin->effects, &now);
    read_thermometer(twin, &now);
    run_samples(twin, last, last + 1, codes);
}

/* ---- a run ------------------------------------------------------------------------------------------------------------- */

static double value_or(const double *values, uint64_t i, double otherwise)
{
    return values ? values[i] : otherwise;
}

static void put(double *values, uint64_t i, double value)
{
    if (values) {
        values[i] = value;
    }
}

static void put_phasor(const struct twin *twin, int mode, double *in_phase, double *quadrature, uint64_t i)
{
    if (in_phase || quadrature) {
        struct twin_phasor phasor = twin_phasor(twin, mode);
        put(in_phase, i, phasor.i);
        put(quadrature, i, phasor.q);
    }
}

static void write_record(const struct twin *twin, const struct twin_record *record, uint64_t i)
{
    put(record->shell_degc, i, twin->temperature.shell_degc);
    put(record->thermometer_degc, i, thermometer_degc(&twin->cfg.thermal, twin->thermometer_code));
    put_phasor(twin, 0, record->primary_i, record->primary_q, i);
    put_phasor(twin, 1, record->secondary_i, record->secondary_q, i);
}

int32_t twin_run(struct twin *twin, const struct twin_profile *profile, const struct twin_record *record)
{
    static const struct twin_record nothing = {0};
    const struct twin_record *wanted = record ? record : &nothing;
    int32_t error = twin_check_profile(twin, profile);
    if (error != TWIN_OK) {
        return error;
    }
    for (uint64_t i = 0; i < profile->n_blocks; i++) {
        int32_t *codes = wanted->codes ? wanted->codes + 4 * i * twin->cfg.block_samples : NULL;
        run_block(twin, value_or(profile->rate_rad_s, i, 0.0), value_or(profile->rate_dot_rad_s2, i, 0.0),
                  value_or(profile->chamber_degc, i, twin->temperature.chamber_degc), codes);
        write_record(twin, wanted, i);
    }
    return TWIN_OK;
}
