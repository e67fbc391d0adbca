/* Decoupling filter G2 (paper eq 13): what cross damping puts on the secondary pickoff, computed from the primary pickoff
 * sample by sample, before demodulation.
 *
 *   G2(s) = g w_b s / (s^2 + 2 z2 k2 s + k2^2),   g w_b = 2 z12 k1,   w_b(T) the bias polynomial in rad/s
 *
 * Discretised with exact poles r exp(+-j w), r = exp(-d), d = z2 k2 T, w = k2 T, and a numerator fitted to the complex gain
 * at resonance. At z = exp(jw) the denominator is (1 - r)(1 - r z^-2), so the numerator's closed form is
 *
 *   H(z) = gain (1 - r z^-2) / (1 - a1 z^-1 + r^2 z^-2),   a1 = 2 r cos w,   gain = g w_b T / 2 (1 - r)/d
 *
 * With eps = 1 - r^2, 1 - r = eps/2 + O(d^2):   y = a1 y1 - y2 + eps y2 + (u - u2 + eps u2/2),   u = gain x.
 * The gain stands at the input: when it changes, the filter has the plant's own transient. docs/DESIGN.md compares the
 * discretisations. */
#ifndef WINEGLASS_CORE_DECOUPLER_H
#define WINEGLASS_CORE_DECOUPLER_H

#include <stdbool.h>
#include <stdint.h>

#include "core/fixed.h"

struct decoupler_coefs {
    int32_t gain_q48;   /* |gain| <= 2^-18: bias rates up to 0.19 rad/s at 50 kSa/s and g = 2 */
    int32_t a1_q30;     /* 2 r cos w, upper part; w between 0.02 and 3.1 rad */
    int32_t a1_low_q36; /* what rounding to Q30 left of a1, |.| <= 2^5 */
    int32_t eps_q36;    /* 1 - r^2, 0 < eps < 2^-6 */
};

struct decoupler_state {
    int64_t y1_q61, y2_q61; /* last two outputs; |y| <= 1 by clamping */
    int32_t u1_q47, u2_q47; /* last two scaled inputs, |u| <= 2^-18 */
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

#define DECOUPLER_LIMIT_Q61 ((INT64_C(1) << 61) - (INT64_C(1) << 32)) /* one, less two units of the output */

/* A 64-bit value as high 2^32 + low with a signed low word, so that both factors of every product are signed 32-bit words. */
struct decoupler_words {
    int32_t high, low;
};

static inline struct decoupler_words decoupler_words(int64_t value)
{
    int32_t low = (int32_t)(uint32_t)value;
    struct decoupler_words words = {fixed_high_word(value) - (low >> 31), low};
    return words;
}

/* u - u2 + eps u2 / 2. Range: |u| <= 2^30 2^31 >> 32 = 2^29 in Q47, so |.| <= 2^30 + 2^29 2^30 2^-37 < 2^31. */
static inline int32_t decoupler_drive_q47(const struct decoupler_coefs *coefs, const struct decoupler_state *state, int32_t u_q47)
{
    return u_q47 - state->u2_q47 + (fixed_mul_high_floor(coefs->eps_q36, state->u2_q47) >> 5);
}

/* a1 y1 + eps y2, in two sums of products of words: Q30 x Q29 = Q59 and Q36 x Q29 = Q65.
 * Range: |y| <= 2^61, so |high| <= 2^29 and |low| <= 2^31; |a1| < 2 in Q30.
 *   low words:   (2^31 2^31 >> 32) + (2^30 2^31 >> 38) <= 2^30 + 2^23 in Q59
 *   Q59:         2^31 2^29 + 2^30 + 2^23 < 2^60 + 2^31, and times 4 < 2^62 + 2^33
 *   Q65:         2^5 2^29 + 2^30 2^29 < 2^60, shifted to Q61 < 2^56
 * Floors: two units of 2^-59 and one of 2^-61. */
static inline int64_t decoupler_memory_q61(const struct decoupler_coefs *coefs, const struct decoupler_state *state, int32_t drive_q47)
{
    struct decoupler_words y1 = decoupler_words(state->y1_q61);
    struct decoupler_words y2 = decoupler_words(state->y2_q61);
    int32_t low_q59 = fixed_mul_high_floor(coefs->a1_q30, y1.low) + (fixed_mul_high_floor(coefs->eps_q36, y2.low) >> 6);
    int64_t fine_q65 = (int64_t)coefs->a1_low_q36 * y1.high + (int64_t)coefs->eps_q36 * y2.high;
    int64_t sum_q59 = (int64_t)coefs->a1_q30 * y1.high + low_q59;
    sum_q59 += (int64_t)drive_q47 * 4096;
    return sum_q59 * 4 + (fine_q65 >> 4);
}

/* One sample: primary pickoff in, what to subtract from the secondary pickoff out, both Q31.
 * Range: 2^62 + 2^33 + 2^31 2^14 + 2^56 from above, and y2 <= 2^61: the sum stays below 2^63. It is clamped unless its upper word
 * lies in [-2^29, 2^29 - 2], so that the rounded output fits 32 bit. docs/NUMBERS.md has what rounding does at the output. */
static inline int32_t decoupler_step(const struct decoupler_coefs *coefs, struct decoupler_state *state, int32_t primary_q31, bool *overflow)
{
    int32_t u_q47 = fixed_mul_high_floor(coefs->gain_q48, primary_q31);
    int64_t y_q61 = decoupler_memory_q61(coefs, state, decoupler_drive_q47(coefs, state, u_q47)) - state->y2_q61;
    if ((uint32_t)fixed_high_word(y_q61) + UINT32_C(0x20000000) >= UINT32_C(0x3FFFFFFF)) {
        y_q61 = y_q61 < 0 ? -DECOUPLER_LIMIT_Q61 : DECOUPLER_LIMIT_Q61;
        *overflow = true;
    }
    state->y2_q61 = state->y1_q61;
    state->y1_q61 = y_q61;
    state->u2_q47 = state->u1_q47;
    state->u1_q47 = u_q47;
    return (int32_t)fixed_round_shift(y_q61, 30);
}

#endif
