/* Decoupling filter G2 (paper eq 13): what cross damping puts on the secondary pickoff, computed from the primary pickoff
 * sample by sample, before demodulation.
 *
 *   G2(s) = g w_b s / (s^2 + 2 z2 k2 s + k2^2),   g w_b = 2 z12 k1,   w_b(T) the bias polynomial in rad/s
 *
 * Discretised with the exact decay and the exact complex gain at resonance:
 *
 *   H(z) = gain (1 - z^-2) / (1 - a1 z^-1 + r^2 z^-2),   r = exp(-d), d = z2 k2 T, eps = 1 - r^2
 *   a1 = (2 - eps) cos w, w = k2 T,   gain = g w_b T / 2 . eps / (2 d)
 *
 * At z = exp(jw) numerator and denominator are both 2j sin w, times gain and eps/2: real, so phase and gain are exact there. The pole's
 * angle is w - d^2/2 cot w, as near to the plant's own, w - d^2 / (2 w), as w is. One recursion, two outputs back:
 *
 *   q = u + a1 q1 - q2 + eps q2,   y = q - q2,   u = gain x
 *
 * The gain stands at the input: when it changes, the filter has the plant's own transient. docs/DESIGN.md compares the
 * discretisations. The output is rounded to Q31 with its error fed back, zero at the carrier: where the carrier repeats every few
 * samples, plain rounding would leave a fixed error there. */
#ifndef WINEGLASS_CORE_DECOUPLER_H
#define WINEGLASS_CORE_DECOUPLER_H

#include <stdbool.h>
#include <stdint.h>

#include "core/fixed.h"

struct decoupler_coefs {
    int32_t gain_q48;   /* |gain| <= 2^-18: bias rates up to 0.19 rad/s at 50 kSa/s and g = 2 */
    int32_t a1_q30;     /* (1 + r^2) cos w, upper part; w between 0.02 and 3.1 rad */
    int32_t a1_low_q36; /* what rounding to Q30 left of a1, |.| <= 2^5 */
    int32_t eps_q36;    /* 1 - r^2, 0 < eps < 2^-6 */
};

struct decoupler_state {
    int64_t q1_q61, q2_q61;       /* last two of the recursion; |q| <= 1/2 by clamping */
    int32_t error1_q63, error2_q63; /* last two rounding errors of the output */
};

/* Constants of the retuning, from the calibration block. */
struct decoupler_tuning {
    uint64_t center_freq_u64;   /* expansion point of the cosine, turns per sample; validity +-0.0123 rad a sample around it */
    int64_t center_2cos_q40;    /* 2 cos w0 */
    int32_t center_cos_q31;     /* cos w0 */
    int32_t center_sin_q31;     /* sin w0 */
    int32_t sample_period_q46;  /* s */
    int32_t coupling_gain_q44;  /* g T (secondary over primary pickoff gain), s */
};

void decoupler_reset(struct decoupler_state *state);

/* New coefficients for the drive's total frequency, the decay rate z2 k2 (1/s) and the bias polynomial's value.
 * Returns false, leaving *coefs alone, when the frequency, the decay rate or the bias is outside the tuning's validity. */
bool decoupler_retune(const struct decoupler_tuning *tuning, uint64_t freq_u64, int32_t decay_per_s_q22,
                      int32_t bias_rad_s_q31, struct decoupler_coefs *coefs);

/* 2 cos of the angle per sample, Q30; false, leaving *two_cos_q30 alone, when the frequency is outside the tuning's validity. */
bool decoupler_two_cosine(const struct decoupler_tuning *tuning, uint64_t freq_u64, int32_t *two_cos_q30);

/* Only the input gain, for updates between two retunings. *overflow is set when it had to be clamped. */
int32_t decoupler_gain_q48(const struct decoupler_tuning *tuning, int32_t decay_per_s_q22, int32_t bias_rad_s_q31,
                           bool *overflow);

#define DECOUPLER_LIMIT_HIGH INT32_C(0x0FF00000) /* upper word of |q| at the clamp: 1/2 - 2^-9 in Q29 */

/* u + a1 q1 + eps q2, in sums of products of words: Q30 x Q29 = Q59 and Q36 x Q29 = Q65.
 * Range: |q| <= 2^60, so |high| <= 2^28 and |low| <= 2^31; |a1| < 2 in Q30.
 *   low words:  (2^31 2^31 >> 32) + (2^30 2^31 >> 38) <= 2^30 + 2^23 in Q59
 *   Q59:        2^31 2^28 + 2^30 + 2^23, and u <= 2^30 2^31 >> 20 = 2^41; together < 2^60, and times 4 < 2^62
 *   Q65:        2^5 2^28 + 2^30 2^28 < 2^59, shifted to Q61 < 2^55
 * Floors: three units of 2^-59, one of 2^-61. */
static inline int64_t decoupler_sum_q61(const struct decoupler_coefs *coefs, const struct decoupler_state *state, int32_t primary_q31)
{
    struct fixed_words q1 = fixed_words(state->q1_q61);
    struct fixed_words q2 = fixed_words(state->q2_q61);
    int32_t low_q59 = fixed_mul_high_floor(coefs->a1_q30, q1.low) + (fixed_mul_high_floor(coefs->eps_q36, q2.low) >> 6);
    int64_t fine_q65 = (int64_t)coefs->a1_low_q36 * q1.high + (int64_t)coefs->eps_q36 * q2.high;
    int64_t sum_q59 = (((int64_t)coefs->gain_q48 * primary_q31) >> 20) + low_q59;
    sum_q59 += (int64_t)coefs->a1_q30 * q1.high;
    return sum_q59 * 4 + (fine_q65 >> 4);
}

/* Rounds to Q31. Range: |value| <= 2 (1/2 - 2^-9) in Q61, |fed back| <= 2^30 + 2^29, so the result is below 2^31 (1 - 2^-8) + 2. */
static inline int32_t decoupler_round(int32_t a1_q30, struct decoupler_state *state, int64_t value_q61)
{
    int32_t fed_back_q61 = fixed_mul_high_floor(a1_q30, state->error1_q63) - (state->error2_q63 >> 2);
    int64_t wanted_q61 = value_q61 + fed_back_q61;
    state->error2_q63 = state->error1_q63;
    state->error1_q63 = (int32_t)((uint32_t)wanted_q61 << 2); /* what lies below the rounded Q31, signed */
    return (int32_t)fixed_round_shift(wanted_q61, 30);
}

/* One sample: primary pickoff in, what to subtract from the secondary pickoff out, both Q31.
 * Range: sum < 2^62 + 2^55, q2 <= 2^60, so q stays below 2^63 before it is clamped. */
static inline int32_t decoupler_step(const struct decoupler_coefs *coefs, struct decoupler_state *state, int32_t primary_q31,
                                     bool *overflow)
{
    int64_t q2_q61 = state->q2_q61;
    int64_t q_q61 = decoupler_sum_q61(coefs, state, primary_q31) - q2_q61;
    if ((uint32_t)fixed_high_word(q_q61) + (uint32_t)DECOUPLER_LIMIT_HIGH >= 2 * (uint32_t)DECOUPLER_LIMIT_HIGH) {
        q_q61 = (q_q61 < 0 ? -INT64_C(1) : INT64_C(1)) * DECOUPLER_LIMIT_HIGH * (INT64_C(1) << 32);
        *overflow = true;
    }
    state->q2_q61 = state->q1_q61;
    state->q1_q61 = q_q61;
    return decoupler_round(coefs->a1_q30, state, q_q61 - q2_q61);
}

#endif
