/* Rate from two complex amplitudes, against exact rational arithmetic in long double and 128 bit. */
#include "unity.h"

#include <math.h>
#include <stdio.h>

#include "core/rate.h"
#include "support/random.h"

void setUp(void)
{
}

void tearDown(void)
{
}

static double two_pi(void)
{
    return 8.0 * atan(1.0);
}

static struct complex_q30 polar(double length, double angle)
{
    return (struct complex_q30){(int32_t)lrint(ldexp(length * cos(angle), 30)), (int32_t)lrint(ldexp(length * sin(angle), 30))};
}

static long double exact_ratio(struct complex_q30 primary, struct complex_q30 secondary)
{
    __int128 number = (__int128)secondary.i_q30 * primary.i_q30 + (__int128)secondary.q_q30 * primary.q_q30;
    __int128 power = (__int128)primary.i_q30 * primary.i_q30 + (__int128)primary.q_q30 * primary.q_q30;
    return (long double)number / (long double)power;
}

/* The same vector 90 degrees behind: its in-phase part is the quadrature of the other. */
static struct complex_q30 behind(struct complex_q30 a)
{
    return (struct complex_q30){a.q_q30, -a.i_q30};
}

static double allowance(int32_t ratio_q29, double exact)
{
    return fabs(ldexp(ratio_q29, -29) - exact) / (ldexp(1.0, -29) + fabs(exact) * ldexp(1.0, -26));
}

/* Error allowed: a unit of the result, and 2^-26 of it from the reciprocal. */
static double worst_ratio_error(double least_primary, double largest_primary, double largest_ratio)
{
    struct random_state random = random_begin(__func__, 1);
    double worst = 0.0;
    for (int n = 0; n < 300000; n++) {
        double length = random_uniform(&random, least_primary, largest_primary);
        struct complex_q30 primary = polar(length, random_uniform(&random, 0.0, two_pi()));
        double ratio = largest_ratio * ldexp(1.0, -(int)(random_u64(&random) % 24));
        struct complex_q30 secondary = polar(fmin(length * ratio, 1.9), random_uniform(&random, 0.0, two_pi()));
        bool overflow = false;
        struct rate_ratio ratio_q29 = rate_ratio_q29(primary, secondary, &overflow);
        double exact = (double)exact_ratio(primary, secondary), exact_quadrature = (double)exact_ratio(primary, behind(secondary));
        TEST_ASSERT_TRUE(ratio_q29.valid);
        TEST_ASSERT_FALSE(overflow);
        worst = fmax(worst, allowance(ratio_q29.in_phase_q29, exact));
        worst = fmax(worst, allowance(ratio_q29.quadrature_q29, exact_quadrature));
    }
    return worst;
}

static void test_ratio_at_working_amplitudes(void)
{
    double worst = worst_ratio_error(0.3, 1.28, 2.0);
    printf("working amplitudes: %.3f of the allowance\n", worst);
    TEST_ASSERT_TRUE(worst <= 1.0);
}

static void test_ratio_at_faint_primaries(void)
{
    double worst = worst_ratio_error(0.01563, 0.3, 3.9);
    printf("faint primaries: %.3f of the allowance\n", worst);
    TEST_ASSERT_TRUE(worst <= 1.0);
}

static void test_ratio_at_corners(void)
{
    const int32_t values[] = {-1374389535, -1073741824, -1, 0, 1, 16777216, 1073741824, 1374389535}; /* up to 1.28 */
    for (int k = 0; k < 8 * 8 * 8 * 8; k++) {
        struct complex_q30 primary = {values[k & 7], values[(k >> 3) & 7]};
        struct complex_q30 secondary = {values[(k >> 6) & 7], values[k >> 9]};
        long double power = (long double)primary.i_q30 * primary.i_q30 + (long double)primary.q_q30 * primary.q_q30;
        bool overflow = false;
        struct rate_ratio both = rate_ratio_q29(primary, secondary, &overflow);
        int32_t ratio = both.in_phase_q29;
        TEST_ASSERT_EQUAL(power >= ldexpl(1.0L, 48), both.valid);
        if (!both.valid) {
            TEST_ASSERT_EQUAL_INT32(0, ratio);
            continue;
        }
        long double expected = exact_ratio(primary, secondary) * 0x1p29L;
        if (fabsl(expected) < 2147483600.0L) {
            TEST_ASSERT_TRUE(fabsl(ratio - expected) <= 1.0L + fabsl(expected) * 0x1p-26L);
            TEST_ASSERT_TRUE(!overflow || fabsl(exact_ratio(primary, behind(secondary))) * 0x1p29L > 2147483600.0L);
        } else {
            TEST_ASSERT_TRUE(overflow || fabsl(ratio - expected) <= 64.0L);
            TEST_ASSERT_TRUE(ratio == (expected < 0 ? INT32_MIN : INT32_MAX) || fabsl(ratio - expected) <= 64.0L);
        }
    }
}

static void test_common_phase_and_gain_drop_out(void)
{
    struct random_state random = random_begin(__func__, 2);
    for (int n = 0; n < 10000; n++) {
        double length = random_uniform(&random, 0.5, 1.2), turn = random_uniform(&random, 0.0, two_pi());
        struct complex_q30 primary = polar(length, turn);
        struct complex_q30 secondary = polar(0.25 * length, turn + 1.0); /* in-phase part 0.25 cos 1 */
        bool overflow = false;
        double ratio = ldexp(rate_ratio_q29(primary, secondary, &overflow).in_phase_q29, -29);
        TEST_ASSERT_DOUBLE_WITHIN(5e-9, 0.25 * cos(1.0), ratio);
    }
}

static void test_scale(void)
{
    struct random_state random = random_begin(__func__, 3);
    for (int n = 0; n < 300000; n++) {
        int32_t ratio = random_wide_i32(&random), scale = random_wide_i32(&random);
        __int128 exact = ((__int128)ratio * scale + (1 << 28)) >> 29;
        bool overflow = false;
        int32_t rate = rate_scale_q28(ratio, scale, &overflow);
        bool fits = exact >= INT32_MIN && exact <= INT32_MAX;
        TEST_ASSERT_EQUAL(!fits, overflow);
        TEST_ASSERT_EQUAL_INT32(fits ? (int32_t)exact : exact < 0 ? INT32_MIN : INT32_MAX, rate);
    }
}

/* The one-pole image against its closed form after a step of the bias. */
static void test_removed_follows_the_bias_with_the_shells_own_lag(void)
{
    const double decay = 2e-4, bias = 1.08e-3;
    struct rate_state state = {0};
    double worst = 0.0;
    for (int n = 1; n <= 50000; n++) {
        int32_t removed = rate_removed_step_q28(&state, (int32_t)lrint(ldexp(bias, 31)), (int32_t)lrint(ldexp(decay, 31)));
        worst = fmax(worst, fabs(ldexp(removed, -28) - bias * (1.0 - exp(-decay * n))));
    }
    printf("one-pole image: worst %.3g rad/s\n", worst);
    TEST_ASSERT_TRUE(worst < 4e-9); /* a unit of the rate */
}

static void test_removed_at_extremes_stays_within_the_bias(void)
{
    struct random_state random = random_begin(__func__, 4);
    struct rate_state state = {0};
    const int64_t limit = INT64_C(1) << 46;
    for (int n = 0; n < 300000; n++) {
        int32_t decay = random_wide_i32(&random) & INT32_MAX; /* zero to one */
        (void)rate_removed_step_q28(&state, random_wide_i32(&random), decay);
        TEST_ASSERT_TRUE(state.removed_rad_s_q46 <= limit && state.removed_rad_s_q46 >= -limit);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_ratio_at_working_amplitudes);
    RUN_TEST(test_ratio_at_faint_primaries);
    RUN_TEST(test_ratio_at_corners);
    RUN_TEST(test_common_phase_and_gain_drop_out);
    RUN_TEST(test_scale);
    RUN_TEST(test_removed_follows_the_bias_with_the_shells_own_lag);
    RUN_TEST(test_removed_at_extremes_stays_within_the_bias);
    return UNITY_END();
}
