/* I/Q lock-in: mixes a pickoff with the oscillator and decimates by N with a triangle of 2 N - 1 weights (two running means of N).
 *
 * With x = Re(A exp(j phase)) the output is A = amplitude_i + j amplitude_q: positive in-phase is displacement in step with the
 * oscillator, positive quadrature leads it by 90 degrees. Nulls at every multiple of fs/N; with fs/N = f the ADC offset and the
 * doubled carrier fall into double nulls. Group delay N - 1 samples.
 *
 * Every sample lies on the falling side of one triangle and on the rising side of the next. Summing the running sum weighs it N - p at
 * place p of its window; the other weight, p, is what N times the plain sum has more. */
#ifndef WINEGLASS_CORE_LOCKIN_H
#define WINEGLASS_CORE_LOCKIN_H

#include <stdint.h>

#include "core/oscillator.h"

#define LOCKIN_MAX_DECIMATION 32

struct lockin_cfg {
    uint32_t decimation;   /* N, 2 .. LOCKIN_MAX_DECIMATION */
    int32_t normalise_q31; /* 4 / N^2 */
};

struct complex_q30 {
    int32_t i_q30;
    int32_t q_q30;
};

/* What both pickoffs are multiplied by, Q21; range: 2^21 (1 + 5e-6). */
struct lockin_reference {
    int32_t cosine_q21, sine_q21;
};

/* Sums of one real channel. Range: |product| <= 2^52 (1 + 5e-6), and the weights of a triangle sum to N^2 <= 2^10: 2^62 (1 + 5e-6). */
struct lockin_channel {
    int64_t sum_q52;    /* of this window's products */
    int64_t ramp_q52;   /* of the output to come: the last window's rising side and the sums so far */
    int64_t rising_q52; /* the last window's rising side */
};

struct lockin_state {
    struct lockin_channel in_phase, quadrature;
};

void lockin_reset(struct lockin_state *state);

/* The phasor rounded to Q21: 2.4e-7, common to both pickoffs. */
static inline struct lockin_reference lockin_reference(struct phasor_q30 phasor)
{
    return (struct lockin_reference){(phasor.cosine_q30 + 256) >> 9, (phasor.sine_q30 + 256) >> 9};
}

static inline void lockin_add(struct lockin_channel *channel, int32_t pickoff_q31, int32_t reference_q21)
{
    int64_t sum_q52 = channel->sum_q52 + (int64_t)pickoff_q31 * reference_q21;
    channel->sum_q52 = sum_q52;
    channel->ramp_q52 += sum_q52;
}

/* One pickoff sample in Q31. */
static inline void lockin_step(struct lockin_state *state, int32_t pickoff_q31, struct lockin_reference reference)
{
    lockin_add(&state->in_phase, pickoff_q31, reference.cosine_q21);
    lockin_add(&state->quadrature, pickoff_q31, reference.sine_q21);
}

/* Every N samples. For |pickoff| <= 1 beside a turning oscillator each part is within +-4/pi = 1.28. */
struct complex_q30 lockin_output(const struct lockin_cfg *cfg, struct lockin_state *state);

#endif
