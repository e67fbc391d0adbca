/* I/Q lock-in: mixes a pickoff with the oscillator and decimates by N with a triangle of 2 N - 1 weights (two running means of N).
 *
 * With x = Re(A exp(j phase)) the output is A = amplitude_i + j amplitude_q: positive in-phase is displacement in step with the
 * oscillator, positive quadrature leads it by 90 degrees. Nulls at every multiple of fs/N; with fs/N = f the ADC offset and the
 * doubled carrier fall into double nulls. Group delay N - 1 samples.
 *
 * Every sample lies on the falling side of one triangle and on the rising side of the next, so it goes into two sums. */
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

/* The oscillator times the two weights of one sample, for both pickoffs. Q21; range: 2^21 (1 + 5e-8) 32 < 2^27. */
struct lockin_reference {
    int32_t falling_cosine_q21, rising_cosine_q21, falling_minus_sine_q21, rising_minus_sine_q21;
};

/* Sums of one real channel. Range: |product| <= 2^31 2^21 weight, and the weights of a triangle sum to N^2 <= 2^10: 2^62 (1 + 5e-8). */
struct lockin_channel {
    int64_t falling_q52; /* of the output to come; holds that triangle's rising side already */
    int64_t rising_q52;  /* of the one after */
};

struct lockin_state {
    struct lockin_channel in_phase, quadrature;
};

void lockin_reset(struct lockin_state *state);

/* Sample number `position` (0 .. N - 1) after the last output. The reference is rounded to Q21: 2.4e-7, common to both
 * pickoffs. */
static inline struct lockin_reference lockin_weigh(uint32_t decimation, uint32_t position, struct phasor_q30 phasor)
{
    int32_t falling = (int32_t)(decimation - position), rising = (int32_t)position;
    int32_t cosine_q21 = (phasor.cosine_q30 + 256) >> 9, minus_sine_q21 = -((phasor.sine_q30 + 256) >> 9);
    return (struct lockin_reference){cosine_q21 * falling, cosine_q21 * rising, minus_sine_q21 * falling, minus_sine_q21 * rising};
}

/* One pickoff sample in Q31. */
void lockin_step(struct lockin_state *state, int32_t pickoff_q31, const struct lockin_reference *reference);

/* Every N samples. For |pickoff| <= 1 beside a turning oscillator each part is within +-4/pi = 1.28. */
struct complex_q30 lockin_output(const struct lockin_cfg *cfg, struct lockin_state *state);

#endif
