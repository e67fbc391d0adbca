/* Inside of the examiner's plant. */
#ifndef EXAM_GENERATOR_H
#define EXAM_GENERATOR_H

#include <stdbool.h>

#include "exam/curve.h"
#include "exam/exam.h"
#include "exam/random.h"
#include "exam/shell.h"

enum { EXAM_FORCES = 128, EXAM_LATENCY_MAX = EXAM_FORCES - 2, EXAM_TONES = 3 };

/* A tone's phasor, turned once a sample. */
struct exam_tone {
    double cosine, sine;
    double turn_cosine, turn_sine;
};

/* A third vibration: place and speed over w, as the shell's state. */
struct exam_third {
    double state[2];
    double cosine, sine, decay; /* one period of it */
};

struct exam {
    struct wg_device *device;
    struct exam_cfg cfg;
    struct exam_curve adc[2], dac[2];
    struct exam_event *events;
    uint32_t next_event, held_codes, skip_motion;
    double carrier_rad_s;
    double state[4];
    double force[EXAM_FORCES][2]; /* DAC outputs in FS, a ring by sample number */
    struct exam_step end; /* of the block before, and the slope of its rate */
    double end_slope_rad_s2;
    struct exam_third third;
    struct exam_tone tone[EXAM_TONES], pump;
    double tone_value[EXAM_TONES];
    double lag[2][2]; /* cosine and sine of each pickoff's lag */
    double time_error_s, jitter_now;
    double other_before; /* what the second channel held when the first was converted */
    struct exam_random noise[2], jitter;
    struct exam_ziggurat ziggurat;
    int32_t codes[2];
    double code_limit, dac_scale;
    uint64_t samples, clipped, forces_given;
    bool has_end, has_tones, has_third, has_kicks, has_leaks, has_memory, prompt;
};

/* Slow numbers of one block at its middle, EXAM_QUANTITIES of them. */
typedef double exam_numbers[EXAM_QUANTITIES];

/* DAC outputs that act now (back = 0) or acted a period before (1). */
static inline const double *exam_force(const struct exam *exam, uint64_t back)
{
    return exam->force[(exam->forces_given - 1 - exam->cfg.dac_latency_samples - back) % EXAM_FORCES];
}

/* converter.c: the pickoffs and their converters, from the present state to two codes. */
void exam_convert(struct exam *exam, const double *q);

/* extras.c: what a plain gyro does not have. */
void exam_extras_prepare(struct exam *exam, const double *q);
void exam_extras_advance(struct exam *exam, const double *q);
double exam_tones_at(const struct exam *exam, uint32_t place);

#endif
