/* The two rebalance controllers against the same controllers in long double, and at the ends of every range. */
#include "unity.h"

#include <math.h>

#include "core/rebalance.h"
#include "support/random.h"

static struct rebalance_cfg cfg;
static struct rebalance_state state;

void setUp(void)
{
    cfg = (struct rebalance_cfg){.proportional_q16 = 20 << 16,
                                 .integral_q24 = 1 << 20,
                                 .in_phase_limit_q31 = 1500000000,
                                 .quadrature_limit_q31 = 700000000};
    rebalance_reset(&state);
}

void tearDown(void)
{
}

static void test_signs(void)
{
    rebalance_step(&cfg, &state, (struct complex_q30){1 << 20, 0}); /* a positive rate moves the secondary in phase */
    TEST_ASSERT_TRUE(state.in_phase.force_q31 < 0);
    TEST_ASSERT_EQUAL_INT32(0, state.quadrature.force_q31);
    rebalance_reset(&state);
    rebalance_step(&cfg, &state, (struct complex_q30){0, 1 << 20});
    TEST_ASSERT_TRUE(state.quadrature.force_q31 > 0);
    TEST_ASSERT_EQUAL_INT32(0, state.in_phase.force_q31);
}

static void test_forces_are_proportional_and_integral(void)
{
    struct random_state random = random_begin(__func__, 1);
    long double integral[2] = {0.0L, 0.0L};
    for (int n = 0; n < 2000; n++) {
        struct complex_q30 secondary = {random_i32(&random) >> 12, random_i32(&random) >> 12};
        long double error[2] = {ldexpl(-(long double)secondary.i_q30, -30), ldexpl(secondary.q_q30, -30)};
        double wanted[2];
        for (int k = 0; k < 2; k++) {
            wanted[k] = (double)(integral[k] + error[k] * ldexpl(cfg.proportional_q16, -16));
            integral[k] += error[k] * ldexpl(cfg.integral_q24, -24);
        }
        rebalance_step(&cfg, &state, secondary);
        TEST_ASSERT_DOUBLE_WITHIN(2e-9, wanted[0], ldexp(state.in_phase.force_q31, -31));
        TEST_ASSERT_DOUBLE_WITHIN(2e-9, wanted[1], ldexp(state.quadrature.force_q31, -31));
    }
}

static void test_limits_hold_flag_and_do_not_wind_up(void)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        rebalance_reset(&state);
        for (int n = 0; n < 1000000; n++) {
            rebalance_step(&cfg, &state, (struct complex_q30){-sign * (1 << 29), sign * (1 << 29)});
        }
        TEST_ASSERT_EQUAL_INT32(sign * cfg.in_phase_limit_q31, state.in_phase.force_q31);
        TEST_ASSERT_EQUAL_INT32(sign * cfg.quadrature_limit_q31, state.quadrature.force_q31);
        TEST_ASSERT_TRUE(state.in_phase.saturated && state.quadrature.saturated);
        rebalance_step(&cfg, &state, (struct complex_q30){sign * (1 << 20), -sign * (1 << 20)});
        TEST_ASSERT_FALSE(state.in_phase.saturated || state.quadrature.saturated);
    }
}

/* Any gains, limits and readings: the sanitizer build watches for overflow. */
static void test_any_words(void)
{
    struct random_state random = random_begin(__func__, 2);
    for (int run = 0; run < 2000; run++) {
        cfg = (struct rebalance_cfg){random_wide_i32(&random), random_wide_i32(&random), random_wide_i32(&random) & INT32_MAX,
                                     random_wide_i32(&random) & INT32_MAX};
        rebalance_reset(&state);
        for (int n = 0; n < 200; n++) {
            rebalance_step(&cfg, &state, (struct complex_q30){random_wide_i32(&random), random_wide_i32(&random)});
            TEST_ASSERT_TRUE(fabs((double)state.in_phase.force_q31) <= cfg.in_phase_limit_q31);
            TEST_ASSERT_TRUE(fabs((double)state.quadrature.force_q31) <= cfg.quadrature_limit_q31);
        }
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_signs);
    RUN_TEST(test_forces_are_proportional_and_integral);
    RUN_TEST(test_limits_hold_flag_and_do_not_wind_up);
    RUN_TEST(test_any_words);
    return UNITY_END();
}
