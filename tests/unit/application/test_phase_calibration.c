/* The sequence of the phase calibration against a gyro on paper: levels and answers by trigonometry in double. */
#include "unity.h"

#include <math.h>
#include <string.h>

#include "application/phase_calibration.h"
#include "support/random.h"

#define GOOD_STATUS (GYRO_STATUS_LOCKED | GYRO_STATUS_CALIBRATION_VALID)

static struct phase_calibration calibration;
static struct gyro_cfg cfg;
static double drive_lag, secondary_lag; /* of the paper gyro, rad */
static double level_drift, answer_drift; /* per slow tick */
static uint32_t status;
static uint32_t ticks;
static bool saw_set_point, saw_force, saw_rate_unmarked;

void setUp(void)
{
    memset(&calibration, 0, sizeof calibration);
    memset(&cfg, 0, sizeof cfg);
    cfg.loop = GYRO_LOOP_OPEN;
    cfg.lockin.decimation = 10;
    cfg.rebalance = (struct rebalance_cfg){.proportional_q16 = 1 << 16, .in_phase_limit_q31 = 1 << 30, .quadrature_limit_q31 = 1 << 30};
    drive_lag = secondary_lag = level_drift = answer_drift = 0.0;
    status = GOOD_STATUS;
    ticks = 0;
    saw_set_point = saw_force = saw_rate_unmarked = false;
}

void tearDown(void)
{
}

static double turns(int32_t angle_i32)
{
    return ldexp((double)angle_i32, -32) * 8.0 * atan(1.0);
}

static int32_t q(double value, int bits)
{
    return (int32_t)lrint(ldexp(value, bits));
}

/* What the signal processing would publish with the present configuration. */
static struct gyro_signals paper_gyro(void)
{
    double lag = drive_lag - ldexp(cfg.drive_phase_rad_q31.coef[0], -31);
    double turn = secondary_lag - ldexp(cfg.demodulation_phase_rad_q31.coef[0], -31) + lag;
    double answer = 2.0 * ldexp(cfg.test_signal.quadrature_q31, -31); /* amplitude per force */
    struct gyro_signals signals = {
        .drive_level_q31 = q(0.45 / cos(lag + turns(cfg.drive.phase_set_point_i32)) + level_drift * ticks, 31),
        .secondary = {q(0.01 - answer * sin(turn) + answer_drift * ticks, 30), q(-0.02 - answer * cos(turn), 30)},
        .temperature_shift_q20 = 7 << 20,
        .status = status,
    };
    return signals;
}

static void slow_tick(void)
{
    struct gyro_signals signals = paper_gyro();
    phase_calibration_add(&calibration, &signals);
    phase_calibration_poll(&calibration, &cfg);
    ticks++;
    saw_set_point = saw_set_point || cfg.drive.phase_set_point_i32 != 0;
    saw_force = saw_force || cfg.test_signal.quadrature_q31 > 1 || cfg.test_signal.quadrature_q31 < -1;
    bool marked = cfg.drive.phase_set_point_i32 != 0 || cfg.test_signal.quadrature_q31 != 0;
    saw_rate_unmarked = saw_rate_unmarked || (!marked && !phase_calibration_idle(&calibration));
}

static void run(uint32_t parts)
{
    const struct phase_calibration_order order = {parts, 3, 4, 5, q(0.2 / (8.0 * atan(1.0)), 32), q(0.05, 31)};
    phase_calibration_start(&calibration, &order, &cfg);
    for (uint32_t i = 0; i < 100000 && !phase_calibration_idle(&calibration); i++) {
        slow_tick();
    }
    TEST_ASSERT_TRUE(phase_calibration_idle(&calibration));
}

static double rad(int32_t angle_rad_q31)
{
    return ldexp(angle_rad_q31, -31);
}

static void both_phases_are_found(void)
{
    struct random_state random = random_begin(__func__, 1);
    for (int round = 0; round < 50; round++) {
        setUp();
        drive_lag = 0.1 * (random_uniform(&random, -0.5, 0.5));
        secondary_lag = 0.6 * (random_uniform(&random, -0.5, 0.5));
        run(PHASE_CALIBRATION_DRIVE | PHASE_CALIBRATION_DEMODULATION);
        TEST_ASSERT_EQUAL_UINT32(PHASE_CALIBRATION_DONE, calibration.result.outcome);
        TEST_ASSERT_DOUBLE_WITHIN(2e-5, drive_lag, rad(calibration.result.drive.correction_rad_q31));
        TEST_ASSERT_DOUBLE_WITHIN(2e-5, secondary_lag, rad(calibration.result.demodulation.correction_rad_q31));
        TEST_ASSERT_TRUE(rad(calibration.result.drive.uncertainty_rad_q31) < 2e-5);
        TEST_ASSERT_EQUAL_INT32(7 << 20, calibration.result.temperature_shift_q20);
    }
}

static void linear_drift_cancels_and_shows_in_the_uncertainty(void)
{
    drive_lag = 0.01;
    secondary_lag = -0.02;
    level_drift = 1e-7;
    answer_drift = 1e-6;
    run(PHASE_CALIBRATION_DRIVE | PHASE_CALIBRATION_DEMODULATION);
    TEST_ASSERT_DOUBLE_WITHIN(5e-5, 0.01, rad(calibration.result.drive.correction_rad_q31));
    TEST_ASSERT_DOUBLE_WITHIN(5e-5, -0.02, rad(calibration.result.demodulation.correction_rad_q31));
    TEST_ASSERT_TRUE(rad(calibration.result.drive.uncertainty_rad_q31) > 1e-4);
    TEST_ASSERT_TRUE(rad(calibration.result.demodulation.uncertainty_rad_q31) > 1e-3);
}

static void settings_come_back(void)
{
    cfg.drive_phase_rad_q31.coef[0] = 1000;
    cfg.demodulation_phase_rad_q31.coef[0] = -2000;
    cfg.test_signal.in_phase_q31 = 5;
    drive_lag = 0.01;
    struct gyro_cfg before = cfg;
    run(PHASE_CALIBRATION_DRIVE | PHASE_CALIBRATION_DEMODULATION);
    TEST_ASSERT_EQUAL_MEMORY(&before, &cfg, sizeof cfg);
    TEST_ASSERT_TRUE(saw_set_point && saw_force && !saw_rate_unmarked);
    TEST_ASSERT_EQUAL_INT32(1000 + calibration.result.drive.correction_rad_q31, calibration.result.drive_rad_q31);
}

static void the_level_s_own_slope_is_taken_out(void)
{
    cfg.tuning.center_freq_u64 = UINT64_C(0x199999999999999A); /* a tenth of the sample rate */
    cfg.tuning.sample_period_q46 = q(1.0 / 50e3, 46);
    cfg.decay_per_s_q22.coef[0] = q(4.0 * atan(1.0) * 5000.0 / 100.0, 22); /* Q = 100 */
    run(PHASE_CALIBRATION_DRIVE);
    TEST_ASSERT_DOUBLE_WITHIN(2e-5, 1.0 / 200.0, rad(calibration.result.drive.correction_rad_q31));
}

static void what_is_found_stays_on_wish(void)
{
    cfg.drive_phase_rad_q31.coef[0] = 1000;
    drive_lag = 0.01;
    run(PHASE_CALIBRATION_DRIVE | PHASE_CALIBRATION_APPLY);
    TEST_ASSERT_EQUAL_INT32(1000 + calibration.result.drive.correction_rad_q31, cfg.drive_phase_rad_q31.coef[0]);
    TEST_ASSERT_EQUAL_INT32(0, cfg.demodulation_phase_rad_q31.coef[0]);
    TEST_ASSERT_EQUAL_INT32(0, cfg.drive.phase_set_point_i32);
    TEST_ASSERT_FALSE(saw_force);
}

static void the_drive_phase_is_measured_with_closed_rebalance_loops_if_they_are_sound(void)
{
    const struct phase_calibration_order order = {PHASE_CALIBRATION_DRIVE | PHASE_CALIBRATION_DEMODULATION, 2, 2, 1, 1 << 27, 1 << 26};
    phase_calibration_start(&calibration, &order, &cfg);
    TEST_ASSERT_EQUAL_UINT32(GYRO_LOOP_OPEN, cfg.loop); /* no scale factor */
    phase_calibration_abort(&calibration, &cfg);
    cfg.rebalance_scale_rad_s_q28.coef[0] = 1 << 28;
    cfg.tuning.coupling_gain_q44 = q(2.0 / 50e3, 44);
    phase_calibration_start(&calibration, &order, &cfg);
    TEST_ASSERT_EQUAL_UINT32(GYRO_LOOP_REBALANCE, cfg.loop);
    while (calibration.part == PHASE_CALIBRATION_DRIVE) {
        slow_tick();
    }
    TEST_ASSERT_EQUAL_UINT32(GYRO_LOOP_OPEN, cfg.loop);
}

static void trouble_ends_it_and_leaves_the_old_phases(void)
{
    const uint32_t troubles[] = {0, GOOD_STATUS | GYRO_STATUS_DRIVE_SATURATED, GOOD_STATUS | GYRO_STATUS_ADC_SATURATED,
                                 GOOD_STATUS | GYRO_STATUS_REBALANCE_SATURATED, GOOD_STATUS | GYRO_STATUS_OVERFLOW};
    for (size_t i = 0; i < sizeof troubles / sizeof troubles[0]; i++) {
        setUp();
        struct gyro_cfg before = cfg;
        status = troubles[i];
        run(PHASE_CALIBRATION_DRIVE | PHASE_CALIBRATION_APPLY);
        TEST_ASSERT_EQUAL_UINT32(PHASE_CALIBRATION_DISTURBED, calibration.result.outcome);
        TEST_ASSERT_FALSE(calibration.result_valid);
        TEST_ASSERT_EQUAL_MEMORY(&before, &cfg, sizeof cfg);
    }
}

static void lock_may_be_lost_while_it_settles(void)
{
    const struct phase_calibration_order order = {PHASE_CALIBRATION_DRIVE, 3, 3, 2, 1 << 27, 1 << 26};
    phase_calibration_start(&calibration, &order, &cfg);
    while (!phase_calibration_idle(&calibration)) {
        status = calibration.phase == PHASE_CALIBRATION_MEASURE ? GOOD_STATUS : 0;
        slow_tick();
    }
    TEST_ASSERT_EQUAL_UINT32(PHASE_CALIBRATION_DONE, calibration.result.outcome);
}

static void a_secondary_that_does_not_answer_is_no_result(void)
{
    secondary_lag = 2.0; /* turned by more than any lag: the answer has the wrong sign */
    run(PHASE_CALIBRATION_DEMODULATION);
    TEST_ASSERT_EQUAL_UINT32(PHASE_CALIBRATION_DISTURBED, calibration.result.outcome);
}

static void abort_puts_everything_back(void)
{
    const struct phase_calibration_order order = {PHASE_CALIBRATION_DRIVE, 3, 3, 2, 1 << 27, 1 << 26};
    for (uint32_t at = 0; at < 700; at += 37) {
        setUp();
        struct gyro_cfg before = cfg;
        phase_calibration_start(&calibration, &order, &cfg);
        for (uint32_t i = 0; i < at; i++) {
            slow_tick();
        }
        phase_calibration_abort(&calibration, &cfg);
        TEST_ASSERT_EQUAL_UINT32(PHASE_CALIBRATION_ABORTED, calibration.result.outcome);
        TEST_ASSERT_EQUAL_MEMORY(&before, &cfg, sizeof cfg);
        slow_tick();
        TEST_ASSERT_EQUAL_MEMORY(&before, &cfg, sizeof cfg);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(both_phases_are_found);
    RUN_TEST(linear_drift_cancels_and_shows_in_the_uncertainty);
    RUN_TEST(settings_come_back);
    RUN_TEST(the_level_s_own_slope_is_taken_out);
    RUN_TEST(what_is_found_stays_on_wish);
    RUN_TEST(the_drive_phase_is_measured_with_closed_rebalance_loops_if_they_are_sound);
    RUN_TEST(trouble_ends_it_and_leaves_the_old_phases);
    RUN_TEST(lock_may_be_lost_while_it_settles);
    RUN_TEST(a_secondary_that_does_not_answer_is_no_result);
    RUN_TEST(abort_puts_everything_back);
    return UNITY_END();
}
