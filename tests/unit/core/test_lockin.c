/* Mixer and decimator against weighted sums in double precision. */
#include "unity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "core/lockin.h"
#include "support/random.h"

#define BLOCKS 40
#define LONGEST (BLOCKS * LOCKIN_MAX_DECIMATION)

static double two_pi;

void setUp(void)
{
    two_pi = 8.0 * atan(1.0);
}

void tearDown(void)
{
}

static struct lockin_cfg config(uint32_t decimation)
{
    double gain = 4.0 / ((double)decimation * decimation);
    return (struct lockin_cfg){decimation, (int32_t)llrint(fmin(ldexp(gain, 31), 2147483647.0)),
                               lockin_reference_shift(decimation)};
}

/* Triangle of 2 N - 1 samples: the response of two running sums of N. */
static double weighted(const double *newest, uint32_t decimation, uint32_t available)
{
    double sum = 0.0;
    for (uint32_t age = 0; age < 2 * decimation - 1 && age < available; age++) {
        double weight = age < decimation ? age + 1.0 : 2.0 * decimation - 1.0 - age;
        sum += weight * newest[-(long)age];
    }
    return 2.0 * sum / ((double)decimation * decimation);
}

static void step(const struct lockin_cfg *cfg, struct lockin_state *state, int32_t pickoff_q31, struct phasor_q30 phasor)
{
    lockin_step(state, pickoff_q31, lockin_reference(cfg->reference_shift, phasor));
}

struct signal {
    int32_t pickoff[LONGEST];
    double in_phase[LONGEST], quadrature[LONGEST];
};

/* Ideal sine and cosine of the same phase words. */
static double worst_difference(uint32_t decimation, uint64_t freq_u64, const struct signal *signal, double *largest)
{
    struct lockin_cfg cfg = config(decimation);
    struct oscillator_state oscillator = {UINT64_C(0x123456789ABCDEF), freq_u64};
    struct lockin_state state;
    static double in_phase[LONGEST], quadrature[LONGEST];
    double worst = 0.0;
    lockin_reset(&state);
    for (uint32_t n = 0; n < BLOCKS * decimation; n++) {
        uint32_t phase = oscillator_step(&oscillator);
        double angle = two_pi * ldexp(phase, -32);
        in_phase[n] = ldexp(signal->pickoff[n], -31) * cos(angle);
        quadrature[n] = -ldexp(signal->pickoff[n], -31) * sin(angle);
        step(&cfg, &state, signal->pickoff[n], oscillator_phasor(phase));
        if ((n + 1) % decimation == 0) {
            struct complex_q30 out = lockin_output(&cfg, &state);
            double i = ldexp(out.i_q30, -30), q = ldexp(out.q_q30, -30);
            worst = fmax(worst, fabs(i - weighted(&in_phase[n], decimation, n + 1)));
            worst = fmax(worst, fabs(q - weighted(&quadrature[n], decimation, n + 1)));
            *largest = fmax(*largest, fmax(fabs(i), fabs(q)));
        }
    }
    return worst;
}

static void test_every_decimation_against_double(void)
{
    struct random_state random = random_begin(__func__, 1);
    static struct signal signal;
    double worst = 0.0, largest = 0.0;
    for (uint32_t decimation = 2; decimation <= LOCKIN_MAX_DECIMATION; decimation++) {
        for (uint32_t n = 0; n < LONGEST; n++) {
            signal.pickoff[n] = random_wide_i32(&random);
        }
        worst = fmax(worst, worst_difference(decimation, random_u64(&random) >> 2, &signal, &largest));
    }
    printf("random samples: worst difference %.3g of full scale\n", worst);
    TEST_ASSERT_TRUE(worst < 1e-5); /* sine and cosine 2.5e-6 each, twice the mean */
}

/* Full-scale square wave in step with the carrier: the largest output there is, 4/pi, and it does not wrap. */
static void test_largest_output(void)
{
    static struct signal signal;
    uint64_t freq = UINT64_C(1) << 59; /* 32 samples a turn */
    struct oscillator_state oscillator = {UINT64_C(0x123456789ABCDEF), freq};
    double largest = 0.0;
    for (uint32_t n = 0; n < LONGEST; n++) {
        signal.pickoff[n] = oscillator_phasor(oscillator_step(&oscillator)).cosine_q30 < 0 ? INT32_MIN : INT32_MAX;
    }
    double worst = worst_difference(32, freq, &signal, &largest);
    printf("square wave: output %.4f (4/pi = %.4f)\n", largest, 8.0 / two_pi);
    TEST_ASSERT_TRUE(worst < 1e-5);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 8.0 / two_pi, largest);
}

static void test_sign_and_phase(void)
{
    struct lockin_cfg cfg = config(10);
    struct lockin_state state;
    struct oscillator_state oscillator = {0, UINT64_C(1844674407370955162)}; /* fs / 10 */
    struct complex_q30 out = {0, 0};
    lockin_reset(&state);
    for (int n = 1; n <= 40; n++) { /* displacement 60 degrees ahead of the oscillator, amplitude 0.5 */
        struct phasor_q30 reference = oscillator_phasor(oscillator_step(&oscillator));
        double x = 0.5 * cos(two_pi * (0.1 * n + 60.0 / 360.0));
        step(&cfg, &state, (int32_t)lrint(ldexp(x, 31)), reference);
        if (n % 10 == 0) {
            out = lockin_output(&cfg, &state);
        }
    }
    TEST_ASSERT_DOUBLE_WITHIN(5e-6, 0.5 * cos(two_pi / 6.0), ldexp(out.i_q30, -30));
    TEST_ASSERT_DOUBLE_WITHIN(5e-6, 0.5 * sin(two_pi / 6.0), ldexp(out.q_q30, -30));
}

/* The longest window full of the largest products: the sanitizer build watches the sums. */
static void test_largest_sums_fit(void)
{
    struct lockin_cfg cfg = config(LOCKIN_MAX_DECIMATION);
    const int32_t extremes[] = {INT32_MIN, INT32_MAX};
    for (uint32_t phase = 0; phase < 8; phase++) {
        for (int k = 0; k < 2; k++) {
            struct lockin_state state;
            struct phasor_q30 reference = oscillator_phasor(phase << 29);
            struct complex_q30 out = {0, 0};
            lockin_reset(&state);
            for (uint32_t n = 0; n < 4 * LOCKIN_MAX_DECIMATION; n++) {
                step(&cfg, &state, extremes[k], reference);
                if ((n + 1) % LOCKIN_MAX_DECIMATION == 0) {
                    out = lockin_output(&cfg, &state);
                }
            }
            double x = ldexp(extremes[k], -31);
            TEST_ASSERT_DOUBLE_WITHIN(1e-6, 2.0 * x * ldexp(reference.cosine_q30, -30), ldexp(out.i_q30, -30));
            TEST_ASSERT_DOUBLE_WITHIN(1e-6, -2.0 * x * ldexp(reference.sine_q30, -30), ldexp(out.q_q30, -30));
        }
    }
}

static void test_standing_oscillator_saturates(void)
{
    struct lockin_cfg cfg = config(8);
    for (uint32_t quarter = 0; quarter < 4; quarter++) {
        struct lockin_state state;
        struct complex_q30 out = {0, 0};
        lockin_reset(&state);
        for (int n = 1; n <= 32; n++) {
            step(&cfg, &state, INT32_MIN, oscillator_phasor(quarter << 30));
            if (n % 8 == 0) {
                out = lockin_output(&cfg, &state);
            }
        }
        const double expected[4][2] = {{-2.0, 0.0}, {0.0, 2.0}, {2.0, 0.0}, {0.0, -2.0}};
        TEST_ASSERT_DOUBLE_WITHIN(1e-8, expected[quarter][0], ldexp(out.i_q30, -30));
        TEST_ASSERT_DOUBLE_WITHIN(1e-8, expected[quarter][1], ldexp(out.q_q30, -30));
    }
}

static void test_nulls_at_multiples_of_the_tick_rate(void)
{
    struct lockin_cfg cfg = config(10);
    struct lockin_state state;
    struct oscillator_state oscillator = {0, UINT64_C(1844674407370955162)};
    struct complex_q30 out = {0, 0};
    lockin_reset(&state);
    for (int n = 1; n <= 100; n++) { /* an offset of the converter stands at the carrier after mixing */
        step(&cfg, &state, INT32_MAX / 3, oscillator_phasor(oscillator_step(&oscillator)));
        if (n % 10 == 0) {
            out = lockin_output(&cfg, &state);
        }
    }
    TEST_ASSERT_INT32_WITHIN(16, 0, out.i_q30);
    TEST_ASSERT_INT32_WITHIN(16, 0, out.q_q30);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_every_decimation_against_double);
    RUN_TEST(test_largest_output);
    RUN_TEST(test_sign_and_phase);
    RUN_TEST(test_largest_sums_fit);
    RUN_TEST(test_standing_oscillator_saturates);
    RUN_TEST(test_nulls_at_multiples_of_the_tick_rate);
    return UNITY_END();
}
