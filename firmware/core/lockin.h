/* I/Q lock-in: mixes a pickoff with the oscillator and decimates by N with a second-order CIC filter.
 *
 * With x = Re(A exp(j phase)) the output is A = amplitude_i + j amplitude_q: positive in-phase is displacement in step with the
 * oscillator, positive quadrature leads it by 90 degrees. Nulls at every multiple of fs/N; with fs/N = f the ADC offset and the
 * doubled carrier fall into double nulls. Group delay N - 1 samples. */
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

/* Two integrators and two combs of one real channel; modular in 2^64 by design.
 * Range: |product| <= 2^29 (Q29), the filter's gain is N^2 <= 2^10, so true outputs stay below 2^39 and are exact modulo 2^64. */
struct cic_state {
    uint64_t integral1, integral2, comb1, comb2;
};

struct lockin_state {
    struct cic_state in_phase, quadrature;
};

void lockin_reset(struct lockin_state *state);

static inline void cic_integrate(struct cic_state *state, int32_t value)
{
    state->integral1 += (uint64_t)(int64_t)value;
    state->integral2 += state->integral1;
}

/* One pickoff sample in Q31. */
static inline void lockin_step(struct lockin_state *state, int32_t pickoff_q31, struct phasor_q30 reference)
{
    cic_integrate(&state->in_phase, (int32_t)(((int64_t)pickoff_q31 * reference.cosine_q30 + INT64_C(0x80000000)) >> 32));
    cic_integrate(&state->quadrature, (int32_t)(((int64_t)pickoff_q31 * -reference.sine_q30 + INT64_C(0x80000000)) >> 32));
}

/* Every N samples. For |pickoff| <= 1 beside a turning oscillator each part is within +-4/pi = 1.28. */
struct complex_q30 lockin_output(const struct lockin_cfg *cfg, struct lockin_state *state);

#endif
