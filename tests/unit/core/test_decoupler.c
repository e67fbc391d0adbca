/* The decoupling filter against the analogue G2(s) and against the same recursion in long double.
 * Promises `decoupler-*` of docs/NUMBERS.md; the noise near the carrier is measured in tests/python/test_core_decoupler.py. */
#include "unity.h"

#include <complex.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "core/decoupler.h"
#include "support/gyro_fixture.h"
#include "support/random.h"

typedef long double real;
typedef long double complex cplx;

#define SAMPLE_RATE_HZ 50e3L
#define TURN_U64 18446744073709551616.0L

static real two_pi;

void setUp(void)
{
    two_pi = 8.0L * atanl(1.0L);
}

void tearDown(void)
{
}

struct setting {
    double freq_hz, center_hz, quality, bias_rad_s;
};

/* The numbers that the tuning is given, exactly. */
struct target {
    uint64_t freq_u64;
    int32_t decay_q22, bias_q31;
    real w, decay_per_s, bias_rad_s; /* w in rad per sample */
};

static struct target target_of(struct setting setting)
{
    struct target target = {.freq_u64 = (uint64_t)(setting.freq_hz / (double)SAMPLE_RATE_HZ * (double)TURN_U64)};
    target.w = two_pi * (real)target.freq_u64 / TURN_U64;
    target.decay_q22 = (int32_t)llrintl(target.w * SAMPLE_RATE_HZ / (2.0L * setting.quality) * 0x1p22L);
    target.bias_q31 = (int32_t)llrint(ldexp(setting.bias_rad_s, 31));
    target.decay_per_s = target.w * SAMPLE_RATE_HZ / (2.0L * setting.quality);
    target.bias_rad_s = setting.bias_rad_s;
    return target;
}

static bool tuned(struct setting setting, struct decoupler_coefs *coefs)
{
    struct decoupler_tuning tuning = fixture_tuning((double)SAMPLE_RATE_HZ, setting.center_hz, 2.0);
    struct target target = target_of(setting);
    return decoupler_retune(&tuning, target.freq_u64, target.decay_q22, target.bias_q31, coefs);
}

struct filter {
    real gain, a1, eps;
};

static struct filter filter_of(const struct decoupler_coefs *coefs)
{
    return (struct filter){-coefs->minus_gain_q48 * 0x1p-48L, coefs->a1_q30 * 0x1p-30L + coefs->a1_low_q36 * 0x1p-36L,
                           1.0L + coefs->minus_r2_q30 * 0x1p-30L + coefs->minus_r2_low_q36 * 0x1p-36L};
}

static cplx response(struct filter filter, real w)
{
    cplx back = cexpl(-I * w);
    return filter.gain * (1.0L - back * back) / (1.0L - filter.a1 * back + (1.0L - filter.eps) * back * back);
}

/* g w_b s / (s^2 + 2 decay s + k^2), g = 2. */
static cplx analogue(const struct target *target, real omega)
{
    real k = target->w * SAMPLE_RATE_HZ;
    return 2.0L * target->bias_rad_s * I * omega / (k * k - omega * omega + 2.0L * target->decay_per_s * I * omega);
}

struct deviation {
    real gain, complex_gain, quality, near, freq_hz;
};

static struct deviation deviation_of(struct setting setting)
{
    struct decoupler_coefs coefs;
    TEST_ASSERT_TRUE_MESSAGE(tuned(setting, &coefs), "refused");
    struct filter filter = filter_of(&coefs);
    struct target target = target_of(setting);
    real omega = target.w * SAMPLE_RATE_HZ;
    cplx ratio = response(filter, target.w) / analogue(&target, omega);
    struct deviation deviation = {
        .gain = fabsl(cabsl(ratio) - 1.0L),
        .complex_gain = cabsl(ratio - 1.0L),
        .quality = fabsl(-0.5L * log1pl(-filter.eps) * SAMPLE_RATE_HZ / target.decay_per_s - 1.0L),
        .freq_hz = fabsl(acosl(filter.a1 / (2.0L - filter.eps)) - target.w) / two_pi * SAMPLE_RATE_HZ,
    };
    for (int step = -100; step <= 100; step++) {
        real away = omega + two_pi * 0.05L * step;
        real error = cabsl(response(filter, away / SAMPLE_RATE_HZ) / analogue(&target, away) - 1.0L);
        deviation.near = fmaxl(deviation.near, error);
    }
    return deviation;
}

static void raise_to(struct deviation *worst, struct deviation other)
{
    worst->gain = fmaxl(worst->gain, other.gain);
    worst->complex_gain = fmaxl(worst->complex_gain, other.complex_gain);
    worst->quality = fmaxl(worst->quality, other.quality);
    worst->near = fmaxl(worst->near, other.near);
    worst->freq_hz = fmaxl(worst->freq_hz, other.freq_hz);
}

static void print_deviation(const char *what, struct deviation worst)
{
    printf("%s: gain %.2g, complex %.2g, Q %.2g, frequency %.2g Hz, within 5 Hz %.2g\n", what, (double)worst.gain,
           (double)worst.complex_gain, (double)worst.quality, (double)worst.freq_hz, (double)worst.near);
}

static void test_gain_and_quality_from_4_to_8_kHz(void)
{
    struct deviation worst = {0};
    for (double freq = 4000.0; freq <= 8000.0; freq += 12.5) {
        raise_to(&worst, deviation_of((struct setting){freq, freq, 1e4, 1.08e-3}));
    }
    print_deviation("4 to 8 kHz, Q 1e4", worst);
    TEST_ASSERT_TRUE(worst.gain <= 10e-6L);
    TEST_ASSERT_TRUE(worst.complex_gain <= 10e-6L);
    TEST_ASSERT_TRUE(worst.quality <= 100e-6L);
    TEST_ASSERT_TRUE(worst.near <= 2e-4L);
}

static void test_retuning_over_its_whole_validity(void)
{
    const double span = (double)(SAMPLE_RATE_HZ / 512.0L); /* 2^-9 turn a sample */
    struct deviation worst = {0};
    for (double center = 4000.0; center <= 8000.0; center += 1000.0) {
        for (int step = -200; step <= 200; step++) {
            double freq = center + 0.9999 * span * step / 200.0;
            raise_to(&worst, deviation_of((struct setting){freq, center, 1e4, 1.08e-3}));
        }
    }
    print_deviation("+-97 Hz around 4, 5 .. 8 kHz", worst);
    TEST_ASSERT_TRUE(worst.gain <= 10e-6L);
    TEST_ASSERT_TRUE(worst.complex_gain <= 10e-6L);
    TEST_ASSERT_TRUE(worst.quality <= 100e-6L);
    TEST_ASSERT_TRUE(worst.freq_hz <= 1e-6L);
}

static void test_high_and_low_quality(void)
{
    struct deviation silica = {0}, poor = {0};
    for (double freq = 4003.0; freq <= 8000.0; freq += 333.0) {
        raise_to(&silica, deviation_of((struct setting){freq, freq - 4.0, 7.3e5, 1.08e-4}));
        raise_to(&poor, deviation_of((struct setting){freq, freq - 4.0, 200.0, 1.08e-3}));
        raise_to(&poor, deviation_of((struct setting){freq, freq - 4.0, 90.0, 1.08e-3}));
    }
    raise_to(&poor, deviation_of((struct setting){5000.3, 5000.0, 50.0, 1.08e-3}));
    print_deviation("Q 7.3e5", silica);
    print_deviation("Q 50 to 200", poor);
    TEST_ASSERT_TRUE(silica.gain <= 20e-6L); /* the decay rate itself has steps of 11 ppm here */
    TEST_ASSERT_TRUE(silica.quality <= 100e-6L);
    TEST_ASSERT_TRUE(poor.gain <= 10e-6L);
    TEST_ASSERT_TRUE(poor.quality <= 100e-6L);
}

/* Q as a bench would measure it: excite, stop, fit the decay of the output's envelope. */
static void test_quality_from_the_ring_down(void)
{
    struct decoupler_coefs coefs;
    struct setting setting = {5000.3, 5000.0, 1e4, 0.1};
    struct target target = target_of(setting);
    struct decoupler_state state;
    bool overflow = false;
    real power[2] = {0.0L, 0.0L};
    TEST_ASSERT_TRUE(tuned(setting, &coefs));
    decoupler_reset(&state);
    for (long n = 0; n < 100000; n++) {
        (void)decoupler_step(&coefs, &state, (int32_t)llrintl(0.9L * 0x1p31L * cosl(target.w * n)), &overflow);
    }
    for (long n = 0; n < 60000; n++) {
        real y = decoupler_step(&coefs, &state, 0, &overflow);
        power[n / 30000] += y * y;
    }
    real decay = 0.5L * logl(power[0] / power[1]) / 30000.0L * SAMPLE_RATE_HZ;
    printf("ring-down: Q off by %.2g\n", (double)(target.decay_per_s / decay - 1.0L));
    TEST_ASSERT_TRUE(fabsl(target.decay_per_s / decay - 1.0L) < 100e-6L);
    TEST_ASSERT_FALSE(overflow);
}

static void test_nothing_is_left_after_excitation(void)
{
    const double qualities[] = {90.0, 1e3, 1e4};
    for (int k = 0; k < 3; k++) {
        for (double freq = 4000.0; freq <= 8000.0; freq += 500.0) { /* some repeat every few samples */
            struct decoupler_coefs coefs;
            struct decoupler_state state;
            struct target target = target_of((struct setting){freq, freq, qualities[k], 0.01});
            bool overflow = false;
            int32_t residue = 0;
            TEST_ASSERT_TRUE(tuned((struct setting){freq, freq, qualities[k], 0.01}, &coefs));
            decoupler_reset(&state);
            long decay_samples = (long)(SAMPLE_RATE_HZ / target.decay_per_s);
            for (long n = 0; n < 2 * decay_samples; n++) {
                (void)decoupler_step(&coefs, &state, (n / 5) % 2 == 0 ? INT32_MAX : INT32_MIN, &overflow);
            }
            for (long n = 0; n < 25 * decay_samples + 2000; n++) { /* e^-25 = 2^-36 */
                int32_t y = decoupler_step(&coefs, &state, 0, &overflow);
                if (n >= 25 * decay_samples && abs(y) > residue) {
                    residue = abs(y);
                }
            }
            TEST_ASSERT_TRUE(residue <= 1);
            TEST_ASSERT_FALSE(overflow);
        }
    }
}

/* Fixed point against the same recursion in long double, noisy and clean input. */
static void test_output_against_long_double(void)
{
    struct random_state random = random_begin(__func__, 1);
    real worst = 0.0L;
    for (int run = 0; run < 8; run++) {
        struct setting setting = {run % 2 == 0 ? 5000.0 : 6543.2, 0.0, run % 4 < 2 ? 1e4 : 100.0, run < 4 ? 6e-3 : -1e-4};
        setting.center_hz = setting.freq_hz;
        struct decoupler_coefs coefs;
        TEST_ASSERT_TRUE(tuned(setting, &coefs));
        struct filter filter = filter_of(&coefs);
        struct decoupler_state state;
        real q1 = 0.0L, q2 = 0.0L;
        bool overflow = false;
        decoupler_reset(&state);
        for (long n = 0; n < 200000; n++) {
            real angle = target_of(setting).w * n;
            int32_t x = (int32_t)llrintl((0.9L * cosl(angle) + 2e-5L * random_gauss(&random)) * 32768.0L) * 65536;
            int32_t y = decoupler_step(&coefs, &state, x, &overflow);
            real q = filter.gain * x * 0x1p-31L + filter.a1 * q1 - (1.0L - filter.eps) * q2;
            worst = fmaxl(worst, fabsl(y * 0x1p-31L - (q - q2)));
            q2 = q1;
            q1 = q;
        }
        TEST_ASSERT_FALSE(overflow);
    }
    printf("worst difference %.3f units of the output\n", (double)(worst * 0x1p31L));
    TEST_ASSERT_TRUE(worst * 0x1p31L <= 2.0L); /* half a unit and its feedback, (1 + a1 + 1) / 2 */
}

static void test_refuses_what_is_outside_its_validity(void)
{
    struct decoupler_coefs before = {1, 2, 3, 4, 5}, coefs = before;
    struct decoupler_tuning tuning = fixture_tuning((double)SAMPLE_RATE_HZ, 5000.0, 2.0);
    uint64_t center = tuning.center_freq_u64, span = UINT64_C(1) << 55;
    int32_t decay = 3 << 22, bias = 1 << 21;
    TEST_ASSERT_FALSE(decoupler_retune(&tuning, center + span + 1, decay, bias, &coefs));
    TEST_ASSERT_FALSE(decoupler_retune(&tuning, center - span - 1, decay, bias, &coefs));
    TEST_ASSERT_FALSE(decoupler_retune(&tuning, 0, decay, bias, &coefs));
    TEST_ASSERT_FALSE(decoupler_retune(&tuning, UINT64_MAX, decay, bias, &coefs));
    TEST_ASSERT_FALSE(decoupler_retune(&tuning, center, 0, bias, &coefs));
    TEST_ASSERT_FALSE(decoupler_retune(&tuning, center, -1, bias, &coefs));
    TEST_ASSERT_FALSE(decoupler_retune(&tuning, center, INT32_MIN, bias, &coefs));
    TEST_ASSERT_FALSE(decoupler_retune(&tuning, center, INT32_MAX, bias, &coefs)); /* 512 per second: 2^-6.6 a sample */
    TEST_ASSERT_FALSE(decoupler_retune(&tuning, center, decay, INT32_MAX, &coefs));
    TEST_ASSERT_FALSE(decoupler_retune(&tuning, center, decay, INT32_MIN, &coefs));
    TEST_ASSERT_EQUAL_MEMORY(&before, &coefs, sizeof coefs);
    TEST_ASSERT_TRUE(decoupler_retune(&tuning, center + span, decay, bias, &coefs));
    TEST_ASSERT_TRUE(decoupler_retune(&tuning, center - span, decay, bias, &coefs));
}

static void test_gain_between_retunings_is_the_same_gain(void)
{
    struct random_state random = random_begin(__func__, 2);
    struct decoupler_tuning tuning = fixture_tuning((double)SAMPLE_RATE_HZ, 5000.0, 2.0);
    for (int n = 0; n < 100000; n++) {
        struct decoupler_coefs coefs;
        int32_t decay = random_wide_i32(&random), bias = random_wide_i32(&random);
        bool overflow = false;
        int32_t gain = decoupler_gain_q48(&tuning, decay, bias, &overflow);
        TEST_ASSERT_TRUE(abs(gain) <= INT32_C(1) << 30);
        if (decoupler_retune(&tuning, tuning.center_freq_u64, decay, bias, &coefs)) {
            TEST_ASSERT_EQUAL_INT32(-coefs.minus_gain_q48, gain);
            TEST_ASSERT_FALSE(overflow);
        }
    }
}

/* The same recursion in long double, without a limit. */
struct plain {
    struct filter filter;
    real u1, u2, y1, y2;
};

static real plain_step(struct plain *plain, int32_t x)
{
    real u = plain->filter.gain * x * 0x1p-31L;
    real y = u - plain->u2 + plain->filter.a1 * plain->y1 - (1.0L - plain->filter.eps) * plain->y2;
    plain->u2 = plain->u1;
    plain->u1 = u;
    plain->y2 = plain->y1;
    plain->y1 = y;
    return y;
}

/* Largest gain, highest Q, a full-scale square wave in step with the resonance: it must clamp and say so, never wrap, and recover. */
static void test_driven_beyond_its_range_it_clamps_flags_and_recovers(void)
{
    const double freqs[] = {170.0, 4000.0, 5000.0, 8000.0, 12500.0, 20000.0, 24600.0};
    for (int k = 0; k < 7; k++) {
        struct setting setting = {freqs[k], freqs[k], 1e6, 0.185};
        struct target target = target_of(setting);
        struct decoupler_coefs coefs;
        struct decoupler_state state;
        struct plain plain = {.y1 = 0.0L};
        bool overflow = false, again = false;
        TEST_ASSERT_TRUE(tuned(setting, &coefs));
        plain.filter = filter_of(&coefs);
        decoupler_reset(&state);
        for (long n = 0; n < 400000; n++) {
            int32_t x = cosl(target.w * n) < 0.0L ? INT32_MIN : INT32_MAX;
            real y = decoupler_step(&coefs, &state, x, &overflow) * 0x1p-31L;
            TEST_ASSERT_TRUE(fabsl(y) <= 0.5L + 0x1p-29L);
            TEST_ASSERT_TRUE(overflow || fabsl(y - plain_step(&plain, x)) < 0x1p-29L);
        }
        TEST_ASSERT_TRUE(overflow);
        for (long n = 0; n < 1000; n++) {
            (void)decoupler_step(&coefs, &state, 0, &again);
        }
        again = false;
        (void)decoupler_step(&coefs, &state, 0, &again);
        TEST_ASSERT_FALSE(again);
    }
}

static int32_t a1_within_2(int32_t word)
{
    const int32_t limit = (int32_t)(0x1p31 - 0x1p18);
    return word > limit ? limit : word < -limit ? -limit : word;
}

/* Any coefficients and any state that the bounds in decoupler.h allow, any input: the sanitizer build watches for overflow. */
static void test_any_words(void)
{
    struct random_state random = random_begin(__func__, 3);
    const int64_t after_limit = (int64_t)(0.51 * 0x1p61), next_limit = (int64_t)(1.51 * 0x1p61);
    for (int n = 0; n < 2000000; n++) {
        struct decoupler_state state = {(int64_t)random_u64(&random) % next_limit, (int64_t)random_u64(&random) % after_limit,
                                        random_wide_i32(&random), random_wide_i32(&random)};
        struct decoupler_coefs coefs = {random_wide_i32(&random) / 2, a1_within_2(random_wide_i32(&random)), random_wide_i32(&random) >> 26,
                                        -(random_wide_i32(&random) & 0x3FFFFFFF), random_wide_i32(&random) >> 26};
        bool overflow = false;
        (void)decoupler_step(&coefs, &state, random_wide_i32(&random), &overflow);
        TEST_ASSERT_TRUE(llabs(state.next_q61) <= next_limit);
        TEST_ASSERT_TRUE(llabs(state.after_q61) <= after_limit);
    }
}

static void test_gain_jump_has_the_plants_transient(void)
{
    struct setting before = {5000.0, 5000.0, 1e4, 0.0}, after = {5000.0, 5000.0, 1e4, 5e-3};
    struct decoupler_coefs coefs;
    struct decoupler_state state;
    struct target target = target_of(after);
    bool overflow = false;
    real tau = SAMPLE_RATE_HZ / target.decay_per_s, worst = 0.0L;
    real full = 2.0L * target.bias_rad_s / (2.0L * target.decay_per_s) * 0.9L;
    decoupler_reset(&state);
    TEST_ASSERT_TRUE(tuned(before, &coefs));
    for (long n = -1000; n < 60000; n++) {
        if (n == 0) {
            TEST_ASSERT_TRUE(tuned(after, &coefs));
        }
        real y = 0x1p-31L * decoupler_step(&coefs, &state, (int32_t)llrintl(0.9L * 0x1p31L * cosl(target.w * n)), &overflow);
        real envelope = n < 0 ? 0.0L : full * (1.0L - expl(-n / tau));
        worst = fmaxl(worst, fabsl(y - envelope * cosl(target.w * n)));
    }
    printf("gain jump: %.2g of the final amplitude away from the plant's envelope\n", (double)(worst / full));
    TEST_ASSERT_TRUE(worst / full < 2e-4L);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_gain_and_quality_from_4_to_8_kHz);
    RUN_TEST(test_retuning_over_its_whole_validity);
    RUN_TEST(test_high_and_low_quality);
    RUN_TEST(test_quality_from_the_ring_down);
    RUN_TEST(test_nothing_is_left_after_excitation);
    RUN_TEST(test_output_against_long_double);
    RUN_TEST(test_refuses_what_is_outside_its_validity);
    RUN_TEST(test_gain_between_retunings_is_the_same_gain);
    RUN_TEST(test_driven_beyond_its_range_it_clamps_flags_and_recovers);
    RUN_TEST(test_any_words);
    RUN_TEST(test_gain_jump_has_the_plants_transient);
    return UNITY_END();
}
