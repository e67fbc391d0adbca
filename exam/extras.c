#include <math.h>

#include "exam/generator.h"

static void tone_prepare(struct exam_tone *tone, double turn_rad)
{
    tone->turn_cosine = cos(turn_rad);
    tone->turn_sine = sin(turn_rad);
    double size = hypot(tone->cosine, tone->sine); /* rounding must not let it grow */
    tone->cosine /= size;
    tone->sine /= size;
}

static void tone_turn(struct exam_tone *tone)
{
    double cosine = tone->cosine * tone->turn_cosine - tone->sine * tone->turn_sine;
    tone->sine = tone->sine * tone->turn_cosine + tone->cosine * tone->turn_sine;
    tone->cosine = cosine;
}

static void third_prepare(struct exam_third *third, const double *q)
{
    double period = q[EXAM_SAMPLE_PERIOD], turn = 2.0 * M_PI * q[EXAM_THIRD_HZ] * period;
    third->decay = exp(-q[EXAM_THIRD_DECAY] * period);
    third->cosine = cos(turn);
    third->sine = sin(turn);
}

void exam_extras_prepare(struct exam *exam, const double *q)
{
    double turn = 2.0 * M_PI * q[EXAM_SAMPLE_PERIOD];
    exam->has_tones = exam->has_kicks = false;
    for (int i = 0; i < EXAM_TONES; i++) {
        bool on = exam->cfg.tone_place[i] != EXAM_NOWHERE && q[EXAM_TONE_A + 2 * i] != 0.0;
        exam->has_tones = exam->has_tones || on;
        tone_prepare(&exam->tone[i], turn * q[EXAM_TONE_A_HZ + 2 * i]);
    }
    tone_prepare(&exam->pump, turn * q[EXAM_PUMP_HZ]);
    third_prepare(&exam->third, q);
    exam->has_third = q[EXAM_THIRD_SEEN_1] != 0.0 || q[EXAM_THIRD_SEEN_2] != 0.0;
    exam->has_leaks = q[EXAM_DRIVE_LEAK_1] != 0.0 || q[EXAM_DRIVE_LEAK_2] != 0.0 || q[EXAM_DRIVE_EDGE_2] != 0.0 || q[EXAM_REBALANCE_LEAK_2] != 0.0;
    exam->has_memory = q[EXAM_MEMORY_1] != 0.0 || q[EXAM_MEMORY_2] != 0.0;
    exam->has_kicks = exam->has_tones || q[EXAM_PUMP] != 0.0 || q[EXAM_CUBIC_CROSS] != 0.0;
}

double exam_tones_at(const struct exam *exam, uint32_t place)
{
    double sum = 0.0;
    for (int i = 0; i < EXAM_TONES; i++) {
        sum += exam->cfg.tone_place[i] == place ? exam->tone_value[i] : 0.0;
    }
    return sum;
}

/* Free turn, then half of the period's impulse before and after would be the same to first order in 1/Q. */
static void third_advance(struct exam *exam, const double *q)
{
    struct exam_third *third = &exam->third;
    const double *force = exam_force(exam, 0);
    double push = (q[EXAM_THIRD_DRIVE] * force[0] + q[EXAM_THIRD_REBALANCE] * force[1]) * q[EXAM_SAMPLE_PERIOD] / exam->carrier_rad_s;
    double place = third->state[0], speed = third->state[1] + push;
    third->state[0] = third->decay * (third->cosine * place + third->sine * speed);
    third->state[1] = third->decay * (third->cosine * speed - third->sine * place);
}

/* Forces that change within a period, as one impulse per sample; around the carrier that is the same as the force. */
static void kick(struct exam *exam, const double *q)
{
    double *s = exam->state, w = exam->carrier_rad_s, by_time = q[EXAM_SAMPLE_PERIOD] / w;
    double stiffer = q[EXAM_PUMP] * exam->pump.cosine, cubic = q[EXAM_CUBIC_CROSS];
    double rate = exam->has_tones ? exam_tones_at(exam, EXAM_AT_RATE) * q[EXAM_ANGULAR_GAIN] : 0.0;
    double force_1 = -(stiffer * q[EXAM_STIFFNESS_11] + cubic * s[2] * s[2]) * s[0] - rate * w * s[3];
    double force_2 = -(stiffer * q[EXAM_STIFFNESS_22] + cubic * s[0] * s[0]) * s[2] + rate * w * s[1];
    if (exam->has_tones) {
        force_1 += exam_tones_at(exam, EXAM_AT_FORCE_1);
        force_2 += exam_tones_at(exam, EXAM_AT_FORCE_2);
    }
    s[1] += by_time * force_1;
    s[3] += by_time * force_2;
}

static void tones_advance(struct exam *exam, const double *q)
{
    for (int i = 0; i < EXAM_TONES; i++) {
        tone_turn(&exam->tone[i]);
        exam->tone_value[i] = q[EXAM_TONE_A + 2 * i] * exam->tone[i].cosine;
    }
}

void exam_extras_advance(struct exam *exam, const double *q)
{
    if (exam->has_tones) {
        tones_advance(exam, q);
    }
    if (exam->has_third) {
        third_advance(exam, q);
    }
    if (exam->has_kicks) {
        kick(exam, q);
        tone_turn(&exam->pump);
    }
    exam->time_error_s = exam->has_tones ? exam_tones_at(exam, EXAM_AT_SAMPLE_TIME) : 0.0;
    if (q[EXAM_JITTER] > 0.0) {
        double r = exam->cfg.jitter_memory;
        exam->jitter_now = r * exam->jitter_now + sqrt(1.0 - r * r) * exam_normal(&exam->jitter, &exam->ziggurat);
        exam->time_error_s += q[EXAM_JITTER] * exam->jitter_now;
    }
}
