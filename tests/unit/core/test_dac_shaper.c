/* Rounding to DAC codes with the error moved away from the carrier. */
#include "unity.h"

#include <complex.h>
#include <math.h>
#include <stdio.h>

#include "core/dac_shaper.h"
#include "support/random.h"

static double two_pi;

void setUp(void)
{
    two_pi = 8.0 * atan(1.0);
}

void tearDown(void)
{
}

static int32_t two_cos_q30(double turns)
{
    return (int32_t)lrint(ldexp(2.0 * cos(two_pi * turns), 30));
}

static uint32_t mask_of(unsigned shift)
{
    return (UINT32_C(1) << shift) - 1;
}

static void test_codes_have_the_low_bits_clear_and_stay_near(void)
{
    struct random_state random = random_begin(__func__, 1);
    for (unsigned shift = 0; shift <= 24; shift++) {
        struct dac_shaper_state state = {0, 0};
        bool saturated = false;
        for (int n = 0; n < 20000; n++) {
            int32_t force = random_wide_i32(&random) / 2;
            int32_t code = dac_shaper_step(&state, force, random_wide_i32(&random), mask_of(shift), &saturated);
            TEST_ASSERT_EQUAL_INT32(0, code & ((INT32_C(1) << shift) - 1));
            TEST_ASSERT_TRUE(fabs((double)code - force) <= ldexp(2.0, (int)shift)); /* half a code, and 1.5 fed back */
        }
        TEST_ASSERT_FALSE(saturated);
    }
}

static void test_without_rounding_nothing_changes(void)
{
    struct random_state random = random_begin(__func__, 2);
    struct dac_shaper_state state = {0, 0};
    bool saturated = false;
    for (int n = 0; n < 100000; n++) {
        int32_t force = random_wide_i32(&random);
        TEST_ASSERT_EQUAL_INT32(force, dac_shaper_step(&state, force, INT32_MAX, mask_of(0), &saturated));
    }
    TEST_ASSERT_FALSE(saturated);
}

/* What plain and shaped rounding leave at a carrier that repeats every ten samples, in codes. */
static void test_error_at_the_carrier_vanishes(void)
{
    const unsigned shift = 16;
    const double turns = 0.1, amplitude = 0.01234567;
    struct dac_shaper_state state = {0, 0};
    bool saturated = false;
    double complex plain = 0.0, shaped = 0.0;
    const int count = 100000;
    for (int n = 0; n < count; n++) {
        int32_t force = (int32_t)lrint(ldexp(amplitude * cos(two_pi * turns * n + 0.3), 31));
        double code = ldexp(dac_shaper_step(&state, force, two_cos_q30(turns), mask_of(shift), &saturated), -(int)shift);
        double complex back = cexp(-I * two_pi * turns * n);
        shaped += (code - ldexp(force, -(int)shift)) * back;
        plain += (rint(ldexp(force, -(int)shift)) - ldexp(force, -(int)shift)) * back;
    }
    printf("error at the carrier: plain %.3g codes, shaped %.3g\n", 2.0 * cabs(plain) / count, 2.0 * cabs(shaped) / count);
    TEST_ASSERT_TRUE(2.0 * cabs(shaped) / count < 1e-4);
    TEST_ASSERT_TRUE(cabs(plain) > 50.0 * cabs(shaped)); /* the test can tell them apart */
}

static void test_limits_saturate_flag_and_recover(void)
{
    const int32_t limits[] = {INT32_MIN, INT32_MAX};
    for (unsigned shift = 1; shift <= 24; shift++) {
        for (int k = 0; k < 2; k++) {
            struct dac_shaper_state state = {0, 0};
            bool saturated = false, again = false;
            for (int n = 0; n < 100; n++) {
                (void)dac_shaper_step(&state, limits[k], two_cos_q30(0.1), mask_of(shift), &saturated);
            }
            TEST_ASSERT_EQUAL(k == 1, saturated); /* -1 is a code, +1 is not */
            for (int n = 0; n < 4; n++) {
                (void)dac_shaper_step(&state, 0, two_cos_q30(0.1), mask_of(shift), &again);
            }
            TEST_ASSERT_FALSE(again);
        }
    }
}

/* Errors stay below half a code whatever comes: the sanitizer build watches the sums. */
static void test_any_words(void)
{
    struct random_state random = random_begin(__func__, 3);
    struct dac_shaper_state state = {0, 0};
    bool saturated = false;
    for (int n = 0; n < 2000000; n++) {
        unsigned shift = 24;
        (void)dac_shaper_step(&state, random_wide_i32(&random), random_wide_i32(&random), mask_of(shift), &saturated);
        TEST_ASSERT_TRUE(state.error1 >= -(1 << 23) && state.error1 <= 1 << 23);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_codes_have_the_low_bits_clear_and_stay_near);
    RUN_TEST(test_without_rounding_nothing_changes);
    RUN_TEST(test_error_at_the_carrier_vanishes);
    RUN_TEST(test_limits_saturate_flag_and_recover);
    RUN_TEST(test_any_words);
    return UNITY_END();
}
