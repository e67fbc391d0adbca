/* Elementary functions against the C library's long double versions. */
#include <math.h>

#include "sim/elementary.h"
#include "unity.h"

void setUp(void) {}
void tearDown(void) {}

static void exponential_is_within_two_units(void)
{
    for (double x = -700.0; x <= 700.0; x += 0.37) {
        double expected = (double)expl((long double)x);
        TEST_ASSERT_DOUBLE_WITHIN(4.5e-16 * expected, expected, elementary_exp(x));
    }
    TEST_ASSERT_EQUAL_DOUBLE(1.0, elementary_exp(0.0));
}

static void logarithm_is_within_two_units(void)
{
    for (double x = 1e-300; x < 1e300; x *= 1.7) {
        double expected = (double)logl((long double)x);
        TEST_ASSERT_DOUBLE_WITHIN(4.5e-16 * fabs(expected), expected, elementary_log(x));
    }
    for (double x = 0.6; x < 1.6; x += 0.0007) {
        double expected = (double)logl((long double)x);
        TEST_ASSERT_DOUBLE_WITHIN(4.5e-16 * fabs(expected) + 1e-18, expected, elementary_log(x));
    }
    TEST_ASSERT_EQUAL_DOUBLE(0.0, elementary_log(1.0));
}

static void cosine_and_sine_over_several_turns(void)
{
    const long double two_pi = 6.283185307179586476925286766559L;
    for (double turns = -3.0; turns <= 3.0; turns += 0.00037) {
        struct elementary_pair p = elementary_cos_sin_turns(turns);
        TEST_ASSERT_DOUBLE_WITHIN(3e-16, (double)cosl(two_pi * (long double)turns), p.cosine);
        TEST_ASSERT_DOUBLE_WITHIN(3e-16, (double)sinl(two_pi * (long double)turns), p.sine);
    }
}

static void quarter_turns_are_exact(void)
{
    for (int quarter = -8; quarter <= 8; quarter++) {
        struct elementary_pair p = elementary_cos_sin_turns(0.25 * quarter);
        TEST_ASSERT_EQUAL_DOUBLE(quarter % 2 != 0 ? 0.0 : quarter % 4 == 0 ? 1.0 : -1.0, p.cosine);
        TEST_ASSERT_EQUAL_DOUBLE(quarter % 2 == 0 ? 0.0 : (quarter % 4 + 4) % 4 == 1 ? 1.0 : -1.0, p.sine);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(exponential_is_within_two_units);
    RUN_TEST(logarithm_is_within_two_units);
    RUN_TEST(cosine_and_sine_over_several_turns);
    RUN_TEST(quarter_turns_are_exact);
    return UNITY_END();
}
