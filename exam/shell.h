/* The two modes over one sampling period, forces held: the transition matrix of the whole coupled system, Coriolis, cross damping and cross
 * stiffness included, by a Magnus step (exponential of the matrix at the middle, summed as a series).
 *
 *   x1'' + c11 x1' + c12 x2' + (k11 - W^2) x1 + k12 x2 = f1 - g W x2' - (g/2) W' x2
 *   x2'' + c22 x2' + c21 x1' + (k22 - W^2) x2 + k21 x1 = f2 + g W x1' + (g/2) W' x1
 *
 * State: x1, x1'/w, x2, x2'/w with one constant w near the carrier, so that all four are displacements in FS. */
#ifndef EXAM_SHELL_H
#define EXAM_SHELL_H

#include <stddef.h>
#include <string.h>

struct exam_shell {
    double stiffness[2][2];    /* k [rad^2/s^2] */
    double damping[2][2];      /* c [1/s] */
    double rate_rad_s;         /* W */
    double rate_slope_rad_s2;  /* W' */
    double angular_gain;       /* g */
    double force[2][2];        /* [mode][DAC channel], FS/s^2 at the DAC's full scale */
    double force_delay_s[2];   /* by which each DAC channel's force comes late; 0 .. one period */
};

/* One period: state' = transition state + now u + before u_before. Columns first: transition[column][row]. */
struct exam_step {
    double transition[4][4];
    double now[2][4];
    double before[2][4];
};

enum { EXAM_STEP_NUMBERS = sizeof(struct exam_step) / sizeof(double), EXAM_PROMPT_NUMBERS = EXAM_STEP_NUMBERS - 8 };

void exam_step_make(const struct exam_shell *shell, double carrier_rad_s, double period_s, struct exam_step *step);

/* A force that comes late acts with the code before it, too. */
static inline int exam_step_is_prompt(const struct exam_step *step)
{
    return step->before[0][1] == 0.0 && step->before[1][3] == 0.0;
}

/* For a walk from a to b in `count` steps: the first one (half a stride from a) and the stride. The walk must go on in every single period: numbers
 * held over several periods would rise in steps whose harmonics fall on twice the carrier, and mix the carrier with itself. */
void exam_step_walk(const struct exam_step *a, const struct exam_step *b, double count, struct exam_step *first, struct exam_step *stride);

/* Two rows of a column at a time. Each row is still summed in the same order, so that the bits are those of plain numbers. */
typedef double exam_pair __attribute__((vector_size(2 * sizeof(double))));

static inline exam_pair exam_pair_at(const double *numbers)
{
    exam_pair pair;
    memcpy(&pair, numbers, sizeof pair);
    return pair;
}

/* prompt: without the part of late forces. */
static inline void exam_step_stride(struct exam_step *step, const struct exam_step *stride, int prompt)
{
    int count = prompt ? EXAM_PROMPT_NUMBERS : EXAM_STEP_NUMBERS;
    double *numbers = (double *)step;
    const double *strides = (const double *)stride;
    for (int i = 0; i < count; i += 2) {
        exam_pair sum = exam_pair_at(&numbers[i]) + exam_pair_at(&strides[i]);
        memcpy(&numbers[i], &sum, sizeof sum);
    }
}

/* before: NULL for a prompt step. The state is read number by number: what was written so is slow to read back as vectors. */
static inline void exam_step_apply(const struct exam_step *step, const double now[2], const double *before, double state[4])
{
    double x1 = state[0], v1 = state[1], x2 = state[2], v2 = state[3], drive = now[0], rebalance = now[1];
    for (int row = 0; row < 4; row += 2) {
        exam_pair next = exam_pair_at(&step->transition[0][row]) * x1 + exam_pair_at(&step->transition[1][row]) * v1 +
                         exam_pair_at(&step->transition[2][row]) * x2 + exam_pair_at(&step->transition[3][row]) * v2 +
                         exam_pair_at(&step->now[0][row]) * drive + exam_pair_at(&step->now[1][row]) * rebalance;
        if (before != NULL) {
            next += exam_pair_at(&step->before[0][row]) * before[0] + exam_pair_at(&step->before[1][row]) * before[1];
        }
        memcpy(&state[row], &next, sizeof next);
    }
}

#endif
