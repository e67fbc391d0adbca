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
 * angle is w - d^2/2 cot w, as near to the plant's own, w - d^2 / (2 w), as w is. Transposed, so that no sample is moved, only sums:
 *
 *   y = u + next,   next <- after + a1 y,   after <- -u - r^2 y,   u = gain x
 *
 * The gain stands at the input: when it changes, the filter has the plant's own transient. docs/DESIGN.md compares the
 * discretisations. The output is rounded to Q31 with its error fed back, zero at the carrier: where the carrier repeats every few
 * samples, plain rounding would leave a fixed error there. */
#ifndef WINEGLASS_CORE_DECOUPLER_H
#define WINEGLASS_CORE_DECOUPLER_H

#include <stdbool.h>
#include <stdint.h>

#include "core/fixed.h"

#define DECOUPLER_GAIN_MAX_Q48 (INT32_C(1) << 30) /* 2^-18: bias rates up to 0.19 rad/s at 50 kSa/s and g = 2 */

struct decoupler_coefs {
    int32_t minus_gain_q48;   /* |gain| <= DECOUPLER_GAIN_MAX_Q48 */
    int32_t a1_q30;           /* (1 + r^2) cos w, upper part; w between 0.02 and 3.1 rad, so |a1| < 2 - 2^-12 */
    int32_t a1_low_q36;       /* what rounding to Q30 left of a1, |.| <= 2^5 */
    int32_t minus_r2_q30;     /* -r^2, upper part; 1 - r^2 < 2^-6 */
    int32_t minus_r2_low_q36; /* the rest, |.| <= 2^5 */
};

struct decoupler_state {
    int64_t next_q61;               /* what the next output owes to the past; |.| < 1.51, as |y| <= 1/2 by clamping */
    int64_t after_q61;              /* what the one behind it will owe already; |.| < 0.51 */
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

/* 2 cos of the angle per sample; false, leaving *two_cos_q40 alone, when the frequency is outside the tuning's validity. */
bool decoupler_two_cosine(const struct decoupler_tuning *tuning, uint64_t freq_u64, int64_t *two_cos_q40);

/* decoupler_retune() for a frequency of which 2 cos is known. */
bool decoupler_tune(const struct decoupler_tuning *tuning, int64_t two_cos_q40, int32_t decay_per_s_q22, int32_t bias_rad_s_q31,
                    struct decoupler_coefs *coefs);

/* Only the input gain, for updates between two retunings. *overflow is set when it had to be clamped. */
int32_t decoupler_gain_q48(const struct decoupler_tuning *tuning, int32_t decay_per_s_q22, int32_t bias_rad_s_q31,
                           bool *overflow);

#define DECOUPLER_LIMIT_HIGH INT32_C(0x10000000) /* upper word of y at the clamp: 1/2 in Q29 */

/* One sample: primary pickoff in, what to subtract from the secondary pickoff out, both Q31.
 * The output word and the rest of y, both signed, are what the recursion multiplies: Q30 x Q31, Q30 x Q61 and Q36 x Q23 (what rounding left of a
 * coefficient meets the upper bits only). Range:
 *   input:     2^30 2^31 >> 18 = 2^43
 *   y:         |next| < 1.51 2^61 and the input fit 2^62; clamped to 2^60 = 1/2
 *   fed back:  |errors| <= 2^29 in Q61, so 2^30 (1 - 2^-13) + 2^29, and half a unit, 2^29: below 2^31
 *   out, rest: |out| <= 2^30 + 2; rest = error - fed back, within 4 2^29 = 2^31
 *   low words: 2^31 2^31 >> 32 = 2^30 and 2^5 2^22 in Q59, times 4 below 2^33 in Q61
 *   next:      |after| + 2^31 2^30 + 2^33 < 0.51 2^61 + 1.0001 2^61
 * Floors: two units of 2^-59, and 2^-23 of what rounding left of the coefficients, 2^-54. */
static inline int32_t decoupler_step(const struct decoupler_coefs *coefs, struct decoupler_state *state, int32_t primary_q31,
                                     bool *overflow)
{
    int32_t a1_q30 = coefs->a1_q30;
    int64_t minus_input_q61 = ((int64_t)coefs->minus_gain_q48 * primary_q31) >> 18;
    int64_t y_q61 = state->next_q61 - minus_input_q61;
    int32_t high = fixed_high_word(y_q61), limited = high;
    limited = limited < -DECOUPLER_LIMIT_HIGH ? -DECOUPLER_LIMIT_HIGH : limited;
    limited = limited > DECOUPLER_LIMIT_HIGH - 1 ? DECOUPLER_LIMIT_HIGH - 1 : limited;
    if (limited != high) {
        *overflow = true;
    }
    y_q61 = (int64_t)(((uint64_t)(uint32_t)limited << 32) | (uint32_t)y_q61);
    int32_t last_q63 = state->error1_q63;
    int32_t fed_back_q61 = fixed_mul_high_floor(a1_q30, last_q63) - (state->error2_q63 >> 2) + (INT32_C(1) << 29);
    int64_t wanted_q61 = y_q61 + fed_back_q61;
    int32_t out_q31 = fixed_middle_word(wanted_q61, 30);
    int32_t rest_q61 = (int32_t)((uint32_t)y_q61 - ((uint32_t)out_q31 << 30));
    state->error1_q63 = (int32_t)(((uint32_t)wanted_q61 << 2) ^ UINT32_C(0x80000000));
    state->error2_q63 = last_q63;
    int32_t coarse_q23 = out_q31 >> 8;
    int32_t low_q59 = fixed_mul_high_floor(a1_q30, rest_q61) + coefs->a1_low_q36 * coarse_q23;
    state->next_q61 = state->after_q61 + fixed_times_4(low_q59) + (int64_t)a1_q30 * out_q31;
    int32_t minus_r2_q30 = coefs->minus_r2_q30;
    low_q59 = fixed_mul_high_floor(minus_r2_q30, rest_q61) + coefs->minus_r2_low_q36 * coarse_q23;
    state->after_q61 = minus_input_q61 + fixed_times_4(low_q59) + (int64_t)minus_r2_q30 * out_q31;
    return out_q31;
}

#endif
