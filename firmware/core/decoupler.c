#include "core/decoupler.h"

#include "core/fixed.h"

#define TWO_PI_Q28 INT64_C(1686629713)
#define SIXTH_Q31 INT32_C(357913941)
#define DECAY_LIMIT_Q40 (INT64_C(1) << 33) /* 2^-7 a sample: eps < 2^-6, Q above 40 at 5 kHz and 50 kSa/s */
#define OFFSET_LIMIT (INT64_C(1) << 55)    /* 2^-9 turn a sample, 0.0123 rad */

void decoupler_reset(struct decoupler_state *state)
{
    *state = (struct decoupler_state){0, 0, 0, 0};
}

/* 2 cos(w0 + x) by series about w0, to 2^-38. Range: |offset| <= 2^55 units of 2^-64 turn, so |x| <= 2 pi 2^-9 < 2^-6.3:
 *   x in Q37 < 2^30.7, x^2 in Q42 < 2^29.4, and every product below stays under 2^62.
 * Left out: x^5 / 120 < 2.4e-12. */
static int64_t two_cosine_q40(const struct decoupler_tuning *tuning, int64_t offset_u64)
{
    int64_t x_q37 = ((offset_u64 >> 25) * TWO_PI_Q28) >> 30; /* Q39 turns x Q28 -> Q67 -> Q37 */
    int64_t x2_q42 = (x_q37 * x_q37) >> 32;
    int64_t x4_q42 = (x2_q42 * x2_q42) >> 42;
    int64_t x3_q37 = (x_q37 * x2_q42) >> 42;
    int64_t cosine_less_1_q42 = -(x2_q42 >> 1) + ((x4_q42 * SIXTH_Q31) >> 33); /* x^4 / 24 */
    int64_t sine_q37 = x_q37 - ((x3_q37 * SIXTH_Q31) >> 31);
    int64_t change_q40 = ((tuning->center_cos_q31 * cosine_less_1_q42) >> 33) - ((tuning->center_sin_q31 * sine_q37) >> 28);
    return tuning->center_2cos_q40 + 2 * change_q40;
}

static bool within_tuning(int64_t offset_u64)
{
    return offset_u64 <= OFFSET_LIMIT && offset_u64 >= -OFFSET_LIMIT;
}

bool decoupler_two_cosine(const struct decoupler_tuning *tuning, uint64_t freq_u64, int64_t *two_cos_q40)
{
    int64_t offset_u64 = (int64_t)(freq_u64 - tuning->center_freq_u64);
    if (!within_tuning(offset_u64)) {
        return false;
    }
    *two_cos_q40 = two_cosine_q40(tuning, offset_u64);
    return true;
}

/* d = decay rate x sample period. Range: 2^31 2^31 >> 28 fits; refused by the caller above 2^33. */
static int64_t decay_per_sample_q40(const struct decoupler_tuning *tuning, int32_t decay_per_s_q22)
{
    return ((int64_t)decay_per_s_q22 * tuning->sample_period_q46) >> 28;
}

/* g w_b T / 2 (1 - exp(-2 d)) / (2 d), with the last factor as 1 - d + 2 d^2 / 3; left out: d^3 / 3 < 2^-22.
 * Range: 2^31 2^31 >> 28 = 2^34, clamped to 2^30; d in Q36 <= 2^29, its square in Q40 <= 2^26. */
static int32_t input_gain_q48(const struct decoupler_tuning *tuning, int64_t d_q40, int32_t bias_rad_s_q31, bool *clamped)
{
    int64_t full_q48 = fixed_round_shift((int64_t)bias_rad_s_q31 * tuning->coupling_gain_q44, 28);
    int32_t gain_q48 = (int32_t)fixed_clamp_i64(full_q48, -DECOUPLER_GAIN_MAX_Q48, DECOUPLER_GAIN_MAX_Q48, clamped);
    int64_t d_q36 = d_q40 >> 4;
    int64_t loss_q40 = d_q40 - ((4 * ((d_q36 * d_q36) >> 32) * SIXTH_Q31) >> 31);
    int32_t loss_q31 = (int32_t)(loss_q40 >> 9);
    return gain_q48 - fixed_mul_q31(gain_q48, loss_q31);
}

/* Decay rates beyond the validity count as its limit, so that the series above keeps its range. */
int32_t decoupler_gain_q48(const struct decoupler_tuning *tuning, int32_t decay_per_s_q22, int32_t bias_rad_s_q31, bool *overflow)
{
    int64_t d_q40 = fixed_clamp_i64(decay_per_sample_q40(tuning, decay_per_s_q22), 0, DECAY_LIMIT_Q40, overflow);
    return input_gain_q48(tuning, d_q40, bias_rad_s_q31, overflow);
}

/* Range: d < 2^33 in Q40; d in Q36 < 2^29, squares in Q40 < 2^26, cubes < 2^19; a1 < 2 keeps Q30 within 32 bit. */
bool decoupler_tune(const struct decoupler_tuning *tuning, int64_t two_cos_q40, int32_t decay_per_s_q22, int32_t bias_rad_s_q31,
                    struct decoupler_coefs *coefs)
{
    int64_t d_q40 = decay_per_sample_q40(tuning, decay_per_s_q22);
    if (d_q40 <= 0 || d_q40 >= DECAY_LIMIT_Q40) {
        return false;
    }
    bool clamped = false;
    int32_t gain_q48 = input_gain_q48(tuning, d_q40, bias_rad_s_q31, &clamped);
    if (clamped) {
        return false;
    }
    int64_t d_q36 = d_q40 >> 4;
    int64_t d2_q40 = (d_q36 * d_q36) >> 32;
    int64_t d3_q40 = (d_q36 * d2_q40) >> 36;
    int64_t eps_q40 = 2 * (d_q40 - d2_q40) + ((8 * d3_q40 * SIXTH_Q31) >> 31);
    int64_t eps_q36 = fixed_round_shift(eps_q40, 4);
    int64_t a1_q40 = two_cos_q40 - (((two_cos_q40 >> 10) * eps_q36) >> 27); /* of the eps in force, so that the phase stays exact */
    int64_t a1_q30 = fixed_round_shift(a1_q40, 10);
    coefs->a1_q30 = (int32_t)a1_q30;
    coefs->a1_low_q36 = (int32_t)fixed_round_shift(a1_q40 - a1_q30 * 1024, 4);
    int64_t minus_r2_q36 = eps_q36 - (INT64_C(1) << 36);
    coefs->minus_r2_q30 = (int32_t)fixed_round_shift(minus_r2_q36, 6);
    coefs->minus_r2_low_q36 = (int32_t)(minus_r2_q36 - (int64_t)coefs->minus_r2_q30 * 64);
    coefs->minus_gain_q48 = -gain_q48;
    return true;
}

bool decoupler_retune(const struct decoupler_tuning *tuning, uint64_t freq_u64, int32_t decay_per_s_q22, int32_t bias_rad_s_q31,
                      struct decoupler_coefs *coefs)
{
    int64_t two_cos_q40;
    return decoupler_two_cosine(tuning, freq_u64, &two_cos_q40) &&
           decoupler_tune(tuning, two_cos_q40, decay_per_s_q22, bias_rad_s_q31, coefs);
}
