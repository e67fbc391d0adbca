/* I/Q lock-in: mixes a pickoff with the oscillator and decimates by N with a triangle of 2 N - 1 weights (two running means of N).
 *
 * With x = Re(A exp(j phase)) the output is A = amplitude_i + j amplitude_q: positive in-phase is displacement in step with the
 * oscillator, positive quadrature leads it by 90 degrees. Nulls at every multiple of fs/N; with fs/N = f the ADC offset and the
 * doubled carrier fall into double nulls. Group delay N - 1 samples.
 *
 * Every sample lies on the falling side of one triangle and on the rising side of the next. Summing the running sum weighs it N - p at
 * place p of its window; the other weight, p, is what N times the plain sum has more. The plain sums keep every bit; the running sums take their
 * upper words, modulo 2^32, and what that floors in the mean is given back at the output. */
#ifndef WINEGLASS_CORE_LOCKIN_H
#define WINEGLASS_CORE_LOCKIN_H

#include <stdint.h>

#include "core/oscillator.h"

#define LOCKIN_MAX_DECIMATION 32

struct lockin_cfg {
    uint32_t decimation;      /* N, 2 .. LOCKIN_MAX_DECIMATION */
    int32_t normalise_q31;    /* 4 / N^2 */
    uint32_t reference_shift; /* lockin_reference_shift(N) */
};

struct complex_q30 {
    int32_t i_q30;
    int32_t q_q30;
};

/* What both pickoffs are multiplied by: Q(30 - reference_shift). */
struct lockin_reference {
    int32_t cosine, sine;
};

/* Sums of one real channel, s for reference_shift. Range: N products of 2^31 2^(30-s) (1 + 5e-6) stay below 2^61.1; their upper word counts
 * 2^(29-s), and the weights of a triangle sum to N^2 < 0.95 2^(s+2), so what the ramp has reached at the output is below 0.95 2^31. */
struct lockin_channel {
    int64_t sum;     /* of this window's products */
    uint32_t ramp;   /* of the output to come: the last window's rising side and the sums so far */
    uint32_t rising; /* the last window's rising side */
};

struct lockin_state {
    struct lockin_channel in_phase, quadrature;
};

void lockin_reset(struct lockin_state *state);

/* Least s >= 1 with N^2 < 2^(s+2): 5 for N = 8 to 11, 9 for 32. */
static inline uint32_t lockin_reference_shift(uint32_t decimation)
{
    uint32_t shift = 1;
    while (decimation * decimation >= UINT32_C(4) << shift) {
        shift++;
    }
    return shift;
}

/* Floored by less than 3e-8 (N = 10): common to both pickoffs, and the half unit that it is off in the mean meets their offset only. */
static inline struct lockin_reference lockin_reference(uint32_t shift, struct phasor_q30 phasor)
{
    return (struct lockin_reference){phasor.cosine_q30 >> shift, phasor.sine_q30 >> shift};
}

static inline void lockin_add(struct lockin_channel *channel, int32_t pickoff_q31, int32_t reference)
{
    int64_t sum = channel->sum + (int64_t)pickoff_q31 * reference;
    channel->sum = sum;
    channel->ramp += (uint32_t)fixed_high_word(sum);
}

/* One pickoff sample in Q31. */
static inline void lockin_step(struct lockin_state *state, int32_t pickoff_q31, struct lockin_reference reference)
{
    lockin_add(&state->in_phase, pickoff_q31, reference.cosine);
    lockin_add(&state->quadrature, pickoff_q31, reference.sine);
}

/* Every N samples. For |pickoff| <= 1 beside a turning oscillator each part is within +-4/pi = 1.28. */
struct complex_q30 lockin_output(const struct lockin_cfg *cfg, struct lockin_state *state);

#endif
