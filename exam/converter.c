#include "exam/generator.h"

/* x = cos(lag) x - sin(lag) x'/w is the place a lag earlier; a time error moves along the speed. */
static double displacement(const struct exam *exam, int mode)
{
    const double *s = &exam->state[2 * mode];
    double place = exam->lag[mode][0] * s[0] - exam->lag[mode][1] * s[1];
    return place + exam->time_error_s * exam->carrier_rad_s * s[1];
}

static int32_t to_code(struct exam *exam, double value, uint32_t quantum)
{
    double steps = value * exam->code_limit;
    if (steps > exam->code_limit - 1.0 || steps < -exam->code_limit) {
        exam->clipped++;
        steps = steps > 0.0 ? exam->code_limit - 1.0 : -exam->code_limit;
    }
    int32_t code = (int32_t)((int64_t)(steps + exam->code_limit + 0.5) - (int64_t)exam->code_limit); /* truncation of a positive number */
    int32_t last = (int32_t)(exam->code_limit - 1.0);
    code = code > last ? last : code;
    return quantum <= 1 ? code : code - ((code % (int32_t)quantum) + (int32_t)quantum) % (int32_t)quantum;
}

static void leaks(const struct exam *exam, const double *q, double seen[2])
{
    const double *now = exam_force(exam, 0), *before = exam_force(exam, 1);
    seen[0] += q[EXAM_DRIVE_LEAK_1] * now[0];
    seen[1] += q[EXAM_DRIVE_LEAK_2] * now[0] + q[EXAM_DRIVE_EDGE_2] * (now[0] - before[0]) + q[EXAM_REBALANCE_LEAK_2] * now[1];
}

static void additions(const struct exam *exam, const double *q, double seen[2])
{
    if (exam->has_third) {
        seen[0] += q[EXAM_THIRD_SEEN_1] * exam->third.state[0];
        seen[1] += q[EXAM_THIRD_SEEN_2] * exam->third.state[0];
    }
    if (exam->has_tones) {
        double both = exam_tones_at(exam, EXAM_AT_BOTH_ADC);
        seen[0] += both + exam_tones_at(exam, EXAM_AT_ADC_1);
        seen[1] += both + exam_tones_at(exam, EXAM_AT_ADC_2);
    }
}

/* One multiplexer, channel 1 before channel 2: each remembers a share of what was held before it. */
static void remember(struct exam *exam, const double *q, double seen[2])
{
    double second = seen[1];
    if (exam->has_memory) {
        seen[1] += q[EXAM_MEMORY_2] * seen[0];
        seen[0] += q[EXAM_MEMORY_1] * exam->other_before;
    }
    exam->other_before = second;
}

void exam_convert(struct exam *exam, const double *q)
{
    double x1 = displacement(exam, 0), x2 = displacement(exam, 1);
    double seen[2] = {q[EXAM_GAIN_1] * x1 + q[EXAM_SEES_SECONDARY] * x2 + q[EXAM_OFFSET_1],
                      q[EXAM_GAIN_2] * x2 + q[EXAM_SEES_PRIMARY] * x1 + q[EXAM_OFFSET_2]};
    if (exam->has_leaks) {
        leaks(exam, q, seen);
    }
    additions(exam, q, seen);
    remember(exam, q, seen);
    for (int channel = 0; channel < 2; channel++) {
        double size = q[EXAM_NOISE_1 + channel];
        double noise = size > 0.0 ? size * exam_normal(&exam->noise[channel], &exam->ziggurat) : 0.0;
        exam->codes[channel] = to_code(exam, exam_curve_apply(&exam->adc[channel], seen[channel] + noise), exam->cfg.quantum[channel]);
    }
}
