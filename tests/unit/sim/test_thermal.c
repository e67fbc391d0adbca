/* Shell and thermometer against the closed forms of one and two lags. */
#include <math.h>

#include "sim/thermal.h"
#include "unity.h"

static const double block_s = 1e-3;

void setUp(void) {}
void tearDown(void) {}

static struct thermal_cfg lags(double shell_s, double thermometer_s)
{
    return (struct thermal_cfg){.initial_degc = 25.0, .shell_time_constant_s = shell_s, .thermometer_lag_s = thermometer_s,
                                .thermometer_lsb_degc = 1.0 / 65536};
}

struct rig {
    struct thermal_plan plan;
    struct thermal_point now, middle;
};

static struct rig rig_of(const struct thermal_cfg *cfg)
{
    struct rig rig;
    thermal_init(cfg, block_s, &rig.plan, &rig.now);
    return rig;
}

/* A ramp of 1 degC/s: the shell follows tau behind, shell = t - tau (1 - e^(-t/tau)). */
static void shell_follows_a_ramp(void)
{
    const double tau = 0.4;
    struct thermal_cfg cfg = lags(tau, 0.0);
    struct rig rig = rig_of(&cfg);
    for (int i = 0; i < 2000; i++) {
        thermal_step(&rig.plan, &rig.now, 25.0 + (i + 1) * block_s, &rig.middle);
        double t = (i + 0.5) * block_s;
        TEST_ASSERT_DOUBLE_WITHIN(1e-11, 25.0 + t - tau * (1.0 - exp(-t / tau)), rig.middle.shell_degc);
        t = (i + 1) * block_s;
        TEST_ASSERT_DOUBLE_WITHIN(1e-11, 25.0 + t - tau * (1.0 - exp(-t / tau)), rig.now.shell_degc);
        TEST_ASSERT_EQUAL_DOUBLE(rig.now.shell_degc, rig.now.thermometer_degc);
    }
}

/* A jump that takes one block, so that from its end on both lags answer to a known state. */
static void two_lags_answer_a_jump(double shell_s, double thermometer_s)
{
    struct thermal_cfg cfg = lags(shell_s, thermometer_s);
    struct rig rig = rig_of(&cfg);
    thermal_step(&rig.plan, &rig.now, 35.0, &rig.middle);
    double shell0 = rig.now.shell_degc - 35.0;
    double thermometer0 = rig.now.thermometer_degc - 35.0;
    for (int i = 0; i < 3000; i++) {
        thermal_step(&rig.plan, &rig.now, 35.0, &rig.middle);
        double t = (i + 1) * block_s;
        double shell = shell0 * exp(-t / shell_s);
        double driven = shell_s == thermometer_s
                            ? shell0 * t / shell_s * exp(-t / shell_s)
                            : shell0 * shell_s / (shell_s - thermometer_s) * (exp(-t / shell_s) - exp(-t / thermometer_s));
        TEST_ASSERT_DOUBLE_WITHIN(1e-11, 35.0 + shell, rig.now.shell_degc);
        TEST_ASSERT_DOUBLE_WITHIN(1e-11, 35.0 + thermometer0 * exp(-t / thermometer_s) + driven, rig.now.thermometer_degc);
    }
}

static void thermometer_lags_behind_the_shell(void)
{
    two_lags_answer_a_jump(0.5, 0.2);
    two_lags_answer_a_jump(0.2, 0.5);
    two_lags_answer_a_jump(0.3, 0.3);
    two_lags_answer_a_jump(0.3, 0.3 * 1.001);
    two_lags_answer_a_jump(0.3, 1e-5);
}

static void imposed_shell_is_the_profile_to_the_bit(void)
{
    struct thermal_cfg cfg = lags(60.0, 0.0);
    cfg.shell_imposed = 1;
    struct rig rig = rig_of(&cfg);
    for (int i = 0; i < 5000; i++) {
        double degc = 50.0 * sin(0.01 * i);
        thermal_step(&rig.plan, &rig.now, degc, &rig.middle);
        TEST_ASSERT_EQUAL_DOUBLE(degc, rig.now.shell_degc);
        TEST_ASSERT_EQUAL_DOUBLE(degc, rig.now.thermometer_degc);
    }
}

static void equilibrium_stays_one_to_the_bit(void)
{
    struct thermal_cfg cfg = lags(60.0, 7.0);
    cfg.initial_degc = 25.1;
    struct rig rig = rig_of(&cfg);
    for (int i = 0; i < 100000; i++) {
        thermal_step(&rig.plan, &rig.now, 25.1, &rig.middle);
    }
    TEST_ASSERT_EQUAL_DOUBLE(25.1, rig.now.shell_degc);
    TEST_ASSERT_EQUAL_DOUBLE(25.1, rig.now.thermometer_degc);
    TEST_ASSERT_EQUAL_DOUBLE(25.1, rig.middle.shell_degc);
}

static void thermometer_codes(void)
{
    struct thermal_cfg cfg = {.thermometer_offset_degc = -40.0, .thermometer_lsb_degc = 0.0078125};
    TEST_ASSERT_EQUAL_INT32(0, thermometer_code(&cfg, -40.0));
    TEST_ASSERT_EQUAL_INT32(8320, thermometer_code(&cfg, 25.0));
    TEST_ASSERT_EQUAL_INT32(8320, thermometer_code(&cfg, 25.0 + 0.0039));
    TEST_ASSERT_EQUAL_INT32(8321, thermometer_code(&cfg, 25.0 + 0.0040));
    TEST_ASSERT_EQUAL_DOUBLE(25.0, thermometer_degc(&cfg, 8320));
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, thermometer_code(&cfg, 1e12));
    TEST_ASSERT_EQUAL_INT32(-INT32_MAX, thermometer_code(&cfg, -1e12));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(shell_follows_a_ramp);
    RUN_TEST(thermometer_lags_behind_the_shell);
    RUN_TEST(imposed_shell_is_the_profile_to_the_bit);
    RUN_TEST(equilibrium_stays_one_to_the_bit);
    RUN_TEST(thermometer_codes);
    return UNITY_END();
}
