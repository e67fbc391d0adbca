/* PLL and AGC against the same loops in long double, and at the ends of every range. */
#include "unity.h"

#include <math.h>

#include "core/drive_loop.h"
#include "support/gyro_fixture.h"
#include "support/random.h"

static struct drive_loop_cfg cfg;

void setUp(void)
{
    struct fixture_device device = fixture_default();
    cfg = fixture_cfg(&device).drive;
}

void tearDown(void)
{
}

static struct polar reading(int32_t magnitude_q30, int32_t angle_i32)
{
    return (struct polar){magnitude_q30, angle_i32};
}

static uint64_t middle(void)
{
    return cfg.freq_min_u64 + (cfg.freq_max_u64 - cfg.freq_min_u64) / 2;
}

static void test_reset_keeps_frequency_and_force(void)
{
    struct drive_loop_state state;
    drive_loop_reset(&state, middle(), 123456789);
    TEST_ASSERT_EQUAL_UINT64(middle(), state.freq_u64);
    drive_loop_step(&cfg, &state, reading(cfg.amplitude_q30, 0));
    TEST_ASSERT_EQUAL_UINT64(middle(), state.freq_u64);
    TEST_ASSERT_EQUAL_INT32(123456789, state.drive_q31);
    TEST_ASSERT_FALSE(state.saturated);
}

static void test_frequency_follows_the_error_as_proportional_and_integral(void)
{
    struct drive_loop_state state;
    struct random_state random = random_begin(__func__, 1);
    long double integral = 0.0L;
    drive_loop_reset(&state, middle(), 0);
    for (int n = 0; n < 1000; n++) {
        int32_t error = random_i32(&random) >> 12;
        integral += (long double)error * cfg.pll_integral_q32;
        drive_loop_step(&cfg, &state, reading(cfg.amplitude_q30, error));
        long double expected = integral + (long double)error * cfg.pll_proportional_q32;
        TEST_ASSERT_EQUAL_INT64((int64_t)expected, (int64_t)(state.freq_u64 - middle()));
        TEST_ASSERT_EQUAL_INT32(error, state.phase_error_i32);
    }
}

static void test_positive_phase_raises_the_frequency(void)
{
    struct drive_loop_state state;
    drive_loop_reset(&state, middle(), 0);
    drive_loop_step(&cfg, &state, reading(cfg.amplitude_q30, 1 << 20));
    TEST_ASSERT_TRUE(state.freq_u64 > middle());
}

static void test_frequency_stays_within_its_limits(void)
{
    const int32_t errors[] = {INT32_MIN, INT32_MAX};
    cfg.pll_integral_q32 = UINT32_MAX;
    cfg.pll_proportional_q32 = UINT32_MAX;
    for (int k = 0; k < 2; k++) {
        struct drive_loop_state state;
        drive_loop_reset(&state, middle(), 0);
        for (int n = 0; n < 100; n++) {
            drive_loop_step(&cfg, &state, reading(cfg.amplitude_q30, errors[k]));
            TEST_ASSERT_EQUAL_UINT64(k == 0 ? cfg.freq_min_u64 : cfg.freq_max_u64, state.freq_u64);
        }
        drive_loop_step(&cfg, &state, reading(cfg.amplitude_q30, errors[1 - k])); /* and leaves them at once */
        TEST_ASSERT_EQUAL_UINT64(k == 0 ? cfg.freq_max_u64 : cfg.freq_min_u64, state.freq_u64);
    }
}

/* A configuration may be exchanged while the frequency is outside the new limits. */
static void test_frequency_outside_new_limits_moves_to_them(void)
{
    struct drive_loop_state state;
    drive_loop_reset(&state, cfg.freq_max_u64 + (UINT64_C(1) << 50), 0);
    drive_loop_step(&cfg, &state, reading(cfg.amplitude_q30, 0));
    TEST_ASSERT_EQUAL_UINT64(cfg.freq_max_u64, state.freq_u64);
    drive_loop_reset(&state, cfg.freq_min_u64 - (UINT64_C(1) << 50), 0);
    drive_loop_step(&cfg, &state, reading(cfg.amplitude_q30, 0));
    TEST_ASSERT_EQUAL_UINT64(cfg.freq_min_u64, state.freq_u64);
}

static void test_force_follows_the_error_as_proportional_and_integral(void)
{
    struct drive_loop_state state;
    struct random_state random = random_begin(__func__, 2);
    long double integral = 0.5L;
    drive_loop_reset(&state, middle(), INT32_C(1) << 30);
    for (int n = 0; n < 1000; n++) {
        int32_t amplitude = cfg.amplitude_q30 + (random_i32(&random) >> 12);
        long double error = ldexpl((long double)cfg.amplitude_q30 - amplitude, -30);
        long double wanted = integral + error * ldexpl(cfg.agc_proportional_q16, -16);
        integral += error * ldexpl(cfg.agc_integral_q24, -24);
        drive_loop_step(&cfg, &state, reading(amplitude, 0));
        TEST_ASSERT_DOUBLE_WITHIN(2e-9, (double)wanted, ldexp(state.drive_q31, -31));
        TEST_ASSERT_EQUAL_INT32(amplitude, state.amplitude_q30);
    }
}

static void test_force_stays_between_zero_and_its_limit(void)
{
    struct drive_loop_state state;
    drive_loop_reset(&state, middle(), 0);
    for (int n = 0; n < 100000; n++) {
        drive_loop_step(&cfg, &state, reading(0, 0));
        TEST_ASSERT_TRUE(state.drive_q31 >= 0 && state.drive_q31 <= cfg.drive_max_q31);
    }
    TEST_ASSERT_EQUAL_INT32(cfg.drive_max_q31, state.drive_q31);
    TEST_ASSERT_TRUE(state.saturated);
    for (int n = 0; n < 100000; n++) {
        drive_loop_step(&cfg, &state, reading(INT32_MAX, 0));
        TEST_ASSERT_TRUE(state.drive_q31 >= 0 && state.drive_q31 <= cfg.drive_max_q31);
    }
    TEST_ASSERT_EQUAL_INT32(0, state.drive_q31);
    TEST_ASSERT_FALSE(state.saturated);
}

/* An hour at the limit must not delay the way back. */
static void test_integral_does_not_wind_up(void)
{
    struct drive_loop_state state;
    drive_loop_reset(&state, middle(), 0);
    for (int n = 0; n < 1000000; n++) {
        drive_loop_step(&cfg, &state, reading(0, 0));
    }
    int64_t before = state.drive_integral_q54;
    TEST_ASSERT_TRUE(before <= (int64_t)cfg.drive_max_q31 << 23);
    drive_loop_step(&cfg, &state, reading(cfg.amplitude_q30 + (1 << 20), 0));
    TEST_ASSERT_TRUE(state.drive_integral_q54 <= before);
    TEST_ASSERT_TRUE(state.drive_q31 < cfg.drive_max_q31);
}

/* Any gains, any reading: the sanitizer build watches for overflow. */
static void test_any_words(void)
{
    struct random_state random = random_begin(__func__, 3);
    for (int run = 0; run < 2000; run++) {
        struct drive_loop_state state;
        struct drive_loop_cfg any = {
            .pll_proportional_q32 = (uint32_t)random_u64(&random) >> (random_u64(&random) & 31),
            .pll_integral_q32 = (uint32_t)random_u64(&random) >> (random_u64(&random) & 31),
            .freq_min_u64 = random_u64(&random) >> 3,
            .amplitude_q30 = random_wide_i32(&random) & INT32_MAX,
            .agc_proportional_q16 = random_wide_i32(&random) & INT32_MAX,
            .agc_integral_q24 = random_wide_i32(&random) & INT32_MAX,
            .drive_max_q31 = random_wide_i32(&random) & INT32_MAX,
            .off = (random_u64(&random) & 3) == 0,
        };
        any.freq_max_u64 = any.freq_min_u64 + (random_u64(&random) >> 2);
        drive_loop_reset(&state, any.freq_min_u64, any.drive_max_q31 / 2);
        for (int n = 0; n < 200; n++) {
            drive_loop_step(&any, &state, reading(random_wide_i32(&random) & INT32_MAX, random_wide_i32(&random)));
            TEST_ASSERT_TRUE(state.freq_u64 >= any.freq_min_u64 && state.freq_u64 <= any.freq_max_u64);
            TEST_ASSERT_TRUE(state.drive_q31 >= 0 && state.drive_q31 <= any.drive_max_q31);
        }
    }
}

static void test_off_takes_the_force_away_and_keeps_both_integrals(void)
{
    struct drive_loop_state state;
    drive_loop_reset(&state, middle(), 1 << 30);
    cfg.off = true;
    for (int n = 0; n < 100; n++) {
        drive_loop_step(&cfg, &state, reading(cfg.amplitude_q30 / 2 - n, 0));
        TEST_ASSERT_EQUAL_INT32(0, state.drive_q31);
        TEST_ASSERT_EQUAL_INT32(cfg.amplitude_q30 / 2 - n, state.amplitude_q30);
        TEST_ASSERT_FALSE(state.saturated);
    }
    TEST_ASSERT_EQUAL_INT64((int64_t)1 << 53, state.drive_integral_q54);
    cfg.off = false;
    drive_loop_step(&cfg, &state, reading(cfg.amplitude_q30, 0));
    TEST_ASSERT_EQUAL_INT32(1 << 30, state.drive_q31);
}

static void test_off_the_frequency_still_follows(void)
{
    struct drive_loop_state off, on;
    drive_loop_reset(&off, middle(), 0);
    drive_loop_reset(&on, middle(), 0);
    for (int n = 0; n < 100; n++) {
        cfg.off = false;
        drive_loop_step(&cfg, &on, reading(cfg.amplitude_q30, 1000 * n));
        cfg.off = true;
        drive_loop_step(&cfg, &off, reading(cfg.amplitude_q30, 1000 * n));
        TEST_ASSERT_EQUAL_UINT64(on.freq_u64, off.freq_u64);
    }
}

static void test_hold_keeps_the_integral_s_frequency(void)
{
    struct drive_loop_state state;
    drive_loop_reset(&state, middle(), 1 << 30);
    drive_loop_step(&cfg, &state, reading(cfg.amplitude_q30, 1 << 20));
    uint64_t integral = state.freq_integral_u64;
    TEST_ASSERT_TRUE(state.freq_u64 != integral);
    drive_loop_hold(&state, 77);
    TEST_ASSERT_EQUAL_UINT64(integral, state.freq_u64);
    TEST_ASSERT_EQUAL_UINT64(integral, state.freq_integral_u64);
    TEST_ASSERT_EQUAL_INT32(0, state.drive_q31);
    TEST_ASSERT_EQUAL_INT32(77, state.amplitude_q30);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_reset_keeps_frequency_and_force);
    RUN_TEST(test_frequency_follows_the_error_as_proportional_and_integral);
    RUN_TEST(test_positive_phase_raises_the_frequency);
    RUN_TEST(test_frequency_stays_within_its_limits);
    RUN_TEST(test_frequency_outside_new_limits_moves_to_them);
    RUN_TEST(test_force_follows_the_error_as_proportional_and_integral);
    RUN_TEST(test_force_stays_between_zero_and_its_limit);
    RUN_TEST(test_integral_does_not_wind_up);
    RUN_TEST(test_off_takes_the_force_away_and_keeps_both_integrals);
    RUN_TEST(test_off_the_frequency_still_follows);
    RUN_TEST(test_hold_keeps_the_integral_s_frequency);
    RUN_TEST(test_any_words);
    return UNITY_END();
}
