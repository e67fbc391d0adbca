#include "exam/generator.h"

#include <stdlib.h>
#include <string.h>

enum { NO_PLACE = EXAM_AT_SAMPLE_TIME + 1 };

/* ---- life -------------------------------------------------------------------------------------------------------------- */

static bool is_possible(const struct exam_cfg *cfg)
{
    bool places = true;
    for (int i = 0; i < EXAM_TONES; i++) {
        places = places && cfg->tone_place[i] < NO_PLACE;
    }
    return places && cfg->sample_rate_hz > 0.0 && cfg->carrier_hz > 0.0 && cfg->carrier_hz <= 0.4 * cfg->sample_rate_hz &&
           cfg->block_samples >= 1 && cfg->block_samples <= 4096 &&
           cfg->dac_latency_samples <= EXAM_LATENCY_MAX && cfg->jitter_memory >= 0.0 && cfg->jitter_memory < 1.0 &&
           (cfg->curve_count == 0 || cfg->curve_count >= 2);
}

/* A copy, or NULL with *sound = false when there is no memory. */
static void *copy_of(const void *from, size_t bytes, bool *sound)
{
    if (from == NULL || bytes == 0) {
        return NULL;
    }
    void *to = malloc(bytes);
    *sound = *sound && to != NULL;
    return to == NULL ? NULL : memcpy(to, from, bytes);
}

static struct exam_curve curve_of(const double *error, uint32_t count, bool *sound)
{
    const double *copy = copy_of(error, count * sizeof *error, sound);
    return (struct exam_curve){copy == NULL ? 0 : count, copy};
}

static bool copy_arrays(struct exam *exam, const struct exam_cfg *cfg)
{
    bool sound = true;
    for (int i = 0; i < 2; i++) {
        exam->adc[i] = curve_of(cfg->adc_error[i], cfg->curve_count, &sound);
        exam->dac[i] = curve_of(cfg->dac_error[i], cfg->curve_count, &sound);
    }
    exam->events = copy_of(cfg->events, cfg->event_count * sizeof *cfg->events, &sound);
    return sound;
}

static void start_noise(struct exam *exam)
{
    exam_ziggurat_init(&exam->ziggurat);
    for (uint32_t i = 0; i < 2; i++) {
        exam_random_init(&exam->noise[i], exam->cfg.seed, i + 1);
    }
    exam_random_init(&exam->jitter, exam->cfg.seed, 3);
    exam->pump = (struct exam_tone){1.0, 0.0, 1.0, 0.0};
    for (int i = 0; i < EXAM_TONES; i++) {
        exam->tone[i] = (struct exam_tone){cos(exam->cfg.tone_phase_rad[i]), sin(exam->cfg.tone_phase_rad[i]), 1.0, 0.0};
    }
}

struct exam *exam_create(const struct exam_cfg *cfg, const uint8_t *block, size_t size)
{
    struct exam *exam = is_possible(cfg) ? calloc(1, sizeof *exam) : NULL;
    if (exam == NULL) {
        return NULL;
    }
    exam->cfg = *cfg;
    exam->carrier_rad_s = 2.0 * M_PI * cfg->carrier_hz;
    exam->code_limit = (double)(UINT32_C(1) << (cfg->adc_bits - 1));
    exam->dac_scale = 1.0 / (double)(UINT32_C(1) << (cfg->dac_bits - 1));
    start_noise(exam);
    struct wg_device_cfg device = {.sample_rate_millihz = (uint32_t)(cfg->sample_rate_hz * 1000.0 + 0.5),
                                   .adc_bits = cfg->adc_bits, .dac_bits = cfg->dac_bits, .serial = cfg->serial};
    exam->device = wg_device_create(&device, block, size);
    if (!copy_arrays(exam, cfg) || exam->device == NULL) {
        exam_destroy(exam);
        return NULL;
    }
    return exam;
}

void exam_destroy(struct exam *exam)
{
    if (exam == NULL) {
        return;
    }
    for (int i = 0; i < 2; i++) {
        free((void *)(uintptr_t)exam->adc[i].error);
        free((void *)(uintptr_t)exam->dac[i].error);
    }
    free(exam->events);
    wg_device_destroy(exam->device);
    free(exam);
}

uint64_t exam_layout(void)
{
    return (uint64_t)EXAM_QUANTITIES << 32 | sizeof(struct exam_cfg);
}

struct wg_device *exam_device(struct exam *exam)
{
    return exam->device;
}

uint64_t exam_clipped(const struct exam *exam)
{
    return exam->clipped;
}

void exam_set_state(struct exam *exam, const double state[4])
{
    memcpy(exam->state, state, sizeof exam->state);
}

void exam_normals(uint64_t seed, uint64_t stream, size_t n, double *out)
{
    struct exam_random random;
    struct exam_ziggurat ziggurat = {{0.0}, {0.0}};
    exam_random_init(&random, seed, stream);
    exam_ziggurat_init(&ziggurat);
    for (size_t i = 0; i < n; i++) {
        out[i] = exam_normal(&random, &ziggurat);
    }
}

/* ---- slow numbers ------------------------------------------------------------------------------------------------------ */

static void numbers_at(const struct exam_column *columns, size_t edge, double *q)
{
    for (int i = 0; i < EXAM_QUANTITIES; i++) {
        q[i] = columns[i].values[(int64_t)edge * columns[i].stride];
    }
}

/* Amplitude of mode 1 to the wanted power. */
static double amplitude_power(const struct exam *exam)
{
    double square = exam->state[0] * exam->state[0] + exam->state[1] * exam->state[1];
    uint32_t power = exam->cfg.amplitude_power;
    return power == 1 ? sqrt(square) : power == 4 ? square * square : square;
}

static struct exam_shell shell_of(const double *q, double slope_rad_s2, double amplitude)
{
    const double *f = &q[EXAM_DRIVE_FORCE_1];
    return (struct exam_shell){
        .stiffness = {{q[EXAM_STIFFNESS_11] * (1.0 + q[EXAM_STIFFENING_1] * amplitude), q[EXAM_STIFFNESS_12]},
                      {q[EXAM_STIFFNESS_21], q[EXAM_STIFFNESS_22] * (1.0 + q[EXAM_STIFFENING_2] * amplitude)}},
        .damping = {{q[EXAM_DAMPING_11] * (1.0 + q[EXAM_THICKENING_1] * amplitude), q[EXAM_DAMPING_12]},
                    {q[EXAM_DAMPING_21], q[EXAM_DAMPING_22] * (1.0 + q[EXAM_THICKENING_2] * amplitude)}},
        .rate_rad_s = q[EXAM_RATE],
        .rate_slope_rad_s2 = slope_rad_s2,
        .angular_gain = q[EXAM_ANGULAR_GAIN],
        .force = {{f[0], f[2]}, {f[1], f[3]}},
        .force_delay_s = {q[EXAM_DRIVE_DELAY], q[EXAM_REBALANCE_DELAY]},
    };
}

static void step_of(const struct exam *exam, const double *q, double slope_rad_s2, struct exam_step *step)
{
    struct exam_shell shell = shell_of(q, slope_rad_s2, amplitude_power(exam));
    exam_step_make(&shell, exam->carrier_rad_s, q[EXAM_SAMPLE_PERIOD], step);
}

static bool depends_on_amplitude(const double *q)
{
    return q[EXAM_STIFFENING_1] != 0.0 || q[EXAM_STIFFENING_2] != 0.0 || q[EXAM_THICKENING_1] != 0.0 || q[EXAM_THICKENING_2] != 0.0;
}

/* Steps at both ends of a block. Where the rate goes on as it did, a block begins with the step that the one before ended with. */
static void steps_of(struct exam *exam, const double *from, const double *to, struct exam_step ends[2])
{
    double seconds = from[EXAM_SAMPLE_PERIOD] * exam->cfg.block_samples;
    double slope = (to[EXAM_RATE] - from[EXAM_RATE]) / seconds;
    if (exam->has_end && exam->end_slope_rad_s2 == slope && !depends_on_amplitude(from)) {
        ends[0] = exam->end;
    } else {
        step_of(exam, from, slope, &ends[0]);
    }
    step_of(exam, to, slope, &ends[1]);
    exam->end = ends[1];
    exam->end_slope_rad_s2 = slope;
    exam->has_end = true;
}

/* ---- samples ----------------------------------------------------------------------------------------------------------- */

static void move(struct exam *exam, const struct exam_step *step, const double *q)
{
    exam_step_apply(step, exam_force(exam, 0), exam->prompt ? NULL : exam_force(exam, 1), exam->state);
    exam_extras_advance(exam, q);
}

static void give_forces(struct exam *exam, const int32_t dac[2])
{
    double *force = exam->force[exam->forces_given++ % EXAM_FORCES];
    double scale = exam->dac_scale;
    for (int i = 0; i < 2; i++) {
        force[i] = exam_curve_apply(&exam->dac[i], scale * dac[i]);
    }
}

/* What the events ask for before this sample is converted. */
static void meet_events(struct exam *exam, const struct exam_step *step, const double *q)
{
    while (exam->next_event < exam->cfg.event_count && exam->events[exam->next_event].sample <= exam->samples) {
        struct exam_event event = exam->events[exam->next_event++];
        for (uint32_t i = 0; event.kind == EXAM_LOST && i < event.count; i++) {
            move(exam, step, q);
        }
        exam->held_codes += event.kind != EXAM_LOST ? event.count : 0;
        exam->skip_motion += event.kind == EXAM_DOUBLED ? event.count : 0;
    }
}

static void sample(struct exam *exam, const struct exam_step *step, const double *q, int32_t *codes)
{
    int32_t dac[2];
    meet_events(exam, step, q);
    if (exam->held_codes > 0) {
        exam->held_codes--;
    } else {
        exam_convert(exam, q);
    }
    wg_device_sample(exam->device, exam->codes, dac);
    give_forces(exam, dac);
    if (codes != NULL) {
        memcpy(codes, (int32_t[4]){exam->codes[0], exam->codes[1], dac[0], dac[1]}, 4 * sizeof *codes);
    }
    if (exam->skip_motion > 0) {
        exam->skip_motion--;
    } else {
        move(exam, step, q);
    }
    exam->samples++;
}

static void middle_of(const double *from, const double *to, exam_numbers q)
{
    for (int i = 0; i < EXAM_QUANTITIES; i++) {
        q[i] = 0.5 * (from[i] + to[i]);
    }
}

static void block(struct exam *exam, const double *from, const double *to, int32_t *codes)
{
    struct exam_step ends[2], step, stride;
    exam_numbers q;
    steps_of(exam, from, to, ends);
    middle_of(from, to, q);
    exam_extras_prepare(exam, q);
    for (int mode = 0; mode < 2; mode++) {
        exam->lag[mode][0] = cos(q[EXAM_LAG_1 + mode]);
        exam->lag[mode][1] = sin(q[EXAM_LAG_1 + mode]);
    }
    exam->prompt = exam_step_is_prompt(&ends[0]) && exam_step_is_prompt(&ends[1]);
    exam_step_walk(&ends[0], &ends[1], exam->cfg.block_samples, &step, &stride);
    for (uint32_t i = 0; i < exam->cfg.block_samples; i++) {
        sample(exam, &step, q, codes == NULL ? NULL : &codes[4 * i]);
        exam_step_stride(&step, &stride, exam->prompt);
    }
}

void exam_run(struct exam *exam, size_t n, const struct exam_column *columns, const int32_t *thermometer, const struct exam_record *record)
{
    exam_numbers from, to;
    numbers_at(columns, 0, from);
    for (size_t i = 0; i < n; i++) {
        numbers_at(columns, i + 1, to);
        wg_device_set_thermometer(exam->device, thermometer[i]);
        block(exam, from, to, record->codes == NULL ? NULL : &record->codes[4 * i * exam->cfg.block_samples]);
        if (record->state != NULL) {
            memcpy(&record->state[4 * i], exam->state, sizeof exam->state);
        }
        memcpy(from, to, sizeof from);
    }
}

void exam_shell_run(struct exam *exam, const double *quantities, size_t n, const double *dac, double *state)
{
    struct exam_step ends[2];
    steps_of(exam, quantities, quantities, ends);
    double before[2] = {0.0, 0.0};
    for (size_t i = 0; i < n; i++) {
        const double *now = &dac[2 * i];
        exam_step_apply(&ends[0], now, before, exam->state);
        memcpy(before, now, sizeof before);
        memcpy(&state[4 * i], exam->state, sizeof exam->state);
    }
}
