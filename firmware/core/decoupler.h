/* Decoupling filter G2 (paper eq 13): what cross damping puts on the secondary pickoff, computed from the primary pickoff
 * sample by sample, before demodulation.
 *
 *   G2(s) = g w_b s / (s^2 + 2 z2 k2 s + k2^2),   g w_b = 2 z12 k1,   w_b(T) the bias polynomial in rad/s
 *
 * Discretised with exact poles r exp(+-j w), r = exp(-d), d = z2 k2 T, w = k2 T, and a numerator fitted to the complex gain
 * at resonance, which has the closed form
 *
 *   H(z) = gain ((1+r)/2 - (a1/2) z^-1) / (1 - a1 z^-1 + r^2 z^-2),   a1 = 2 r cos w,   gain = g w_b T (1 - r)/d
 *
 * With eps = 1 - r^2 this is   y = u + a1 (y1 - u1/2) - y2 + eps (y2 - u/4),   u = gain x,
 * so one 64-bit by 32-bit product and two small ones per sample. The gain stands at the input: when it changes, the
 * filter has the plant's own transient. docs/DESIGN.md compares the discretisations. */
#ifndef WINEGLASS_CORE_DECOUPLER_H
#define WINEGLASS_CORE_DECOUPLER_H

#include <stdbool.h>
#include <stdint.h>

struct decoupler_coefs {
    int32_t gain_q48;   /* |gain| < 2^-17: bias rates up to 0.19 rad/s at 50 kSa/s and g = 2 */
    int32_t a1_q30;     /* 2 r cos w, upper part; w between 0.02 and 3.1 rad */
    int32_t a1_low_q36; /* what rounding to Q30 left of a1, |.| <= 2^5 */
    int32_t eps_q36;    /* 1 - r^2, 0 < eps < 2^-5 */
};

struct decoupler_state {
    int64_t y1_q61, y2_q61; /* last two outputs; |y| <= 2 by clamping, so sums stay below 2^63 */
    int64_t u1_q61;         /* last scaled input, |u| < 2^-17 */
};

/* Constants of the retuning, from the calibration block. */
struct decoupler_tuning {
    uint64_t center_freq_u64;   /* expansion point of the cosine, turns per sample; validity +-0.0156 rad a sample around it */
    int64_t center_2cos_q40;    /* 2 cos w0 */
    int32_t center_cos_q31;     /* cos w0 */
    int32_t center_sin_q31;     /* sin w0 */
    int32_t sample_period_q46;  /* s */
    int32_t coupling_gain_q44;  /* g T (secondary over primary pickoff gain), s */
};

void decoupler_reset(struct decoupler_state *state);

/* New coefficients for the drive's total frequency, the decay rate z2 k2 (1/s) and the bias polynomial's value.
 * Returns false, leaving *coefs alone, when the frequency or the decay rate is outside the tuning's validity. */
bool decoupler_retune(const struct decoupler_tuning *tuning, uint64_t freq_u64, int32_t decay_per_s_q22,
                      int32_t bias_rad_s_q31, struct decoupler_coefs *coefs);

/* 2 cos of the angle per sample, Q30; false, leaving *two_cos_q30 alone, when the frequency is outside the tuning's validity. */
bool decoupler_two_cosine(const struct decoupler_tuning *tuning, uint64_t freq_u64, int32_t *two_cos_q30);

/* Only the input gain, for updates between two retunings. */
int32_t decoupler_gain_q48(const struct decoupler_tuning *tuning, int32_t decay_per_s_q22, int32_t bias_rad_s_q31);

/* One sample: primary pickoff in, what to subtract from the secondary pickoff out, both Q31. */
int32_t decoupler_step(const struct decoupler_coefs *coefs, struct decoupler_state *state, int32_t primary_q31, bool *overflow);

#endif
