/* Test force on the secondary axis: constant, tone, off. */
#include "unity.h"

#include <math.h>

#include "core/test_signal.h"

void setUp(void)
{
}

void tearDown(void)
{
}

static void test_off_is_silent(void)
{
    struct test_signal_cfg cfg = {0, 0, 12345678};
    struct test_signal_state state = {0};
    for (int n = 0; n < 100; n++) {
        struct test_signal_force force = test_signal_step(&cfg, &state);
        TEST_ASSERT_EQUAL_INT32(0, force.in_phase_q31);
        TEST_ASSERT_EQUAL_INT32(0, force.quadrature_q31);
    }
}

static void test_constant(void)
{
    struct test_signal_cfg cfg = {123456, -654321, 0};
    struct test_signal_state state = {99};
    struct test_signal_force force = test_signal_step(&cfg, &state);
    TEST_ASSERT_EQUAL_INT32(123456, force.in_phase_q31);
    TEST_ASSERT_EQUAL_INT32(-654321, force.quadrature_q31);
}

static void test_tone_begins_at_its_crest_and_has_its_frequency(void)
{
    const double two_pi = 8.0 * atan(1.0), level = 0.9999;
    struct test_signal_cfg cfg = {(int32_t)lrint(ldexp(level, 31)), -(int32_t)lrint(ldexp(level, 31)), 42949673};
    struct test_signal_state state = {0};
    for (int n = 0; n < 10000; n++) {
        struct test_signal_force force = test_signal_step(&cfg, &state);
        double expected = level * cos(two_pi * ldexp((double)cfg.freq_u32 * n, -32));
        TEST_ASSERT_DOUBLE_WITHIN(5e-6, expected, ldexp(force.in_phase_q31, -31));
        TEST_ASSERT_DOUBLE_WITHIN(5e-6, -expected, ldexp(force.quadrature_q31, -31));
    }
}

static void test_constant_resets_the_tone(void)
{
    struct test_signal_cfg tone = {1 << 30, 0, 1 << 28}, constant = {1 << 30, 0, 0};
    struct test_signal_state state = {0};
    for (int n = 0; n < 5; n++) {
        (void)test_signal_step(&tone, &state);
    }
    (void)test_signal_step(&constant, &state);
    TEST_ASSERT_EQUAL_INT32(1 << 30, test_signal_step(&tone, &state).in_phase_q31);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_off_is_silent);
    RUN_TEST(test_constant);
    RUN_TEST(test_tone_begins_at_its_crest_and_has_its_frequency);
    RUN_TEST(test_constant_resets_the_tone);
    return UNITY_END();
}
