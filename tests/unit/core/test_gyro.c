/* The whole chain around a small plant: cold start, rate, compensation, health, schedule. The digital twin's own tests are wider. */
#include "unity.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/gyro.h"
#include "support/gyro_fixture.h"
#include "support/random.h"

#define LOCKED (GYRO_STATUS_LOCKED | GYRO_STATUS_AMPLITUDE_IN_RANGE)

static struct fixture_device device;
static struct gyro_cfg cfg;
static struct gyro_state state;
static struct fixture_plant plant;
static struct random_state noise;

void setUp(void)
{
    device = fixture_default();
    noise = (struct random_state){1};
}

void tearDown(void)
{
}

static void power_on(void)
{
    cfg = fixture_cfg(&device);
    gyro_reset(&cfg, &state);
    fixture_plant_init(&plant, &device);
}

static struct gyro_output run(double seconds)
{
    struct gyro_output output = {0, 0, false};
    for (long n = lrint(seconds * device.sample_rate_hz); n > 0; n--) {
        output = fixture_sample(&device, &cfg, &state, &plant, &noise);
    }
    return output;
}

struct mean {
    double rate, uncompensated, freq_hz, amplitude;
    uint32_t all, any;
};

static struct mean average(double seconds)
{
    struct mean mean = {.all = UINT32_MAX};
    long count = 0;
    for (long n = lrint(seconds * device.sample_rate_hz); n > 0; n--) {
        if (fixture_sample(&device, &cfg, &state, &plant, &noise).slow_tick) {
            mean.rate += ldexp(state.signals.rate_rad_s_q28, -28);
            mean.uncompensated += ldexp(state.signals.rate_uncompensated_rad_s_q28, -28);
            mean.freq_hz += ldexp((double)state.signals.freq_u64, -64) * device.sample_rate_hz;
            mean.amplitude += ldexp(hypot(state.signals.primary.i_q30, state.signals.primary.q_q30), -30);
            mean.all &= state.signals.status;
            mean.any |= state.signals.status;
            count++;
        }
    }
    mean.rate /= (double)count;
    mean.uncompensated /= (double)count;
    mean.freq_hz /= (double)count;
    mean.amplitude /= (double)count;
    return mean;
}

static void test_cold_start_within_1_5_s_anywhere_within_one_per_cent(void)
{
    for (double offset = -50.0; offset <= 50.0; offset += 12.5) {
        device.freq_hz = 5000.0 + offset;
        power_on();
        run(1.4);
        struct mean mean = average(0.1);
        TEST_ASSERT_EQUAL_HEX32(LOCKED, mean.all & LOCKED);
        TEST_ASSERT_DOUBLE_WITHIN(0.02, device.freq_hz, mean.freq_hz);
        TEST_ASSERT_DOUBLE_WITHIN(0.009, 0.9, mean.amplitude);
    }
}

static void test_held_conditions_when_locked_is_set(void)
{
    device.freq_hz = 5033.0;
    power_on();
    while (!(state.signals.status & GYRO_STATUS_LOCKED)) {
        (void)fixture_sample(&device, &cfg, &state, &plant, &noise);
    }
    double amplitude = hypot(plant.x1, plant.v1 / (8.0 * atan(1.0) * device.freq_hz));
    TEST_ASSERT_DOUBLE_WITHIN(0.01 * device.amplitude, device.amplitude, amplitude);
    TEST_ASSERT_DOUBLE_WITHIN(0.05, device.freq_hz, ldexp((double)state.oscillator.freq_u64, -64) * device.sample_rate_hz);
}

static void test_noise_alone_never_locks(void)
{
    struct random_state random = random_begin(__func__, 2);
    for (int run_index = 0; run_index < 12; run_index++) {
        device.adc_noise = pow(10.0, random_uniform(&random, -5.0, 0.0));
        noise.counter = random_u64(&random);
        power_on();
        for (long n = 0; n < 200000; n++) {
            struct gyro_input input = {fixture_adc_q31(&device, 0.0, random_gauss(&noise)), 0, 0};
            (void)gyro_step(&cfg, &state, &input);
            TEST_ASSERT_FALSE(state.signals.status & (GYRO_STATUS_LOCKED | GYRO_STATUS_RATE_VALID));
        }
    }
}

static void test_rate_open_loop(void)
{
    const double rates[] = {0.02, -0.02};
    for (int k = 0; k < 2; k++) {
        device.rate_rad_s = rates[k];
        power_on();
        run(8.0); /* twelve time constants */
        struct mean mean = average(1.0);
        TEST_ASSERT_DOUBLE_WITHIN(2e-4 * 0.02, rates[k], mean.rate);
        TEST_ASSERT_TRUE(mean.all & GYRO_STATUS_RATE_VALID);
    }
}

static void test_bias_is_taken_out_by_static_and_by_g2(void)
{
    device.bias_rad_s = 1.08e-3;
    device.rate_rad_s = 0.01;
    for (uint32_t mode = 0; mode < GYRO_COMPENSATION_COUNT; mode++) {
        device.compensation = mode;
        power_on();
        run(8.0);
        struct mean mean = average(1.0);
        double expected = mode == GYRO_COMPENSATION_NONE ? 0.01108 : 0.01;
        printf("compensation %u: rate %.7f, uncompensated %.7f\n", mode, mean.rate, mean.uncompensated);
        TEST_ASSERT_DOUBLE_WITHIN(4e-6, expected, mean.rate);
        TEST_ASSERT_DOUBLE_WITHIN(4e-6, 0.01108, mean.uncompensated);
    }
}

static void test_rebalance_nulls_the_secondary_and_measures_the_rate(void)
{
    device.loop = GYRO_LOOP_REBALANCE;
    device.compensation = GYRO_COMPENSATION_STATIC;
    device.bias_rad_s = 1.08e-3;
    device.rate_rad_s = 0.05;
    power_on();
    run(2.0);
    struct mean mean = average(0.5);
    TEST_ASSERT_TRUE(mean.all & GYRO_STATUS_REBALANCE_ACTIVE);
    TEST_ASSERT_TRUE(mean.all & GYRO_STATUS_RATE_VALID);
    TEST_ASSERT_DOUBLE_WITHIN(0.001 * 0.05, 0.05, mean.rate);
    TEST_ASSERT_TRUE(hypot(state.signals.secondary.i_q30, state.signals.secondary.q_q30) < ldexp(2e-4, 30));
}

static void test_slow_ticks_come_every_fifty_samples(void)
{
    power_on();
    for (long n = 0; n < 5000; n++) {
        struct gyro_output output = fixture_sample(&device, &cfg, &state, &plant, &noise);
        TEST_ASSERT_EQUAL(n % 50 == 5, output.slow_tick);
    }
}

static void test_codes_use_the_dacs_bits_only(void)
{
    power_on();
    for (long n = 0; n < 100000; n++) {
        struct gyro_output output = fixture_sample(&device, &cfg, &state, &plant, &noise);
        TEST_ASSERT_EQUAL_HEX32(0, ((uint32_t)output.drive_q31 | (uint32_t)output.rebalance_q31) & 0xFFFF);
    }
}

static void test_missing_thermometer_takes_the_rate_away_and_gives_it_back(void)
{
    device.compensation = GYRO_COMPENSATION_G2;
    power_on();
    run(2.0);
    TEST_ASSERT_TRUE(state.signals.status & GYRO_STATUS_RATE_VALID);
    for (long n = 0; n < 1000; n++) {
        struct gyro_input input = {fixture_adc_q31(&device, plant.x1, 0.0), fixture_adc_q31(&device, plant.x2, 0.0),
                                   GYRO_THERMOMETER_INVALID};
        struct gyro_output output = gyro_step(&cfg, &state, &input);
        fixture_plant_step(&plant, output.drive_q31, output.rebalance_q31);
    }
    TEST_ASSERT_FALSE(state.signals.status & (GYRO_STATUS_RATE_VALID | GYRO_STATUS_TEMPERATURE_VALID));
    TEST_ASSERT_TRUE(state.signals.status & GYRO_STATUS_LOCKED);
    run(0.1);
    TEST_ASSERT_TRUE(state.signals.status & GYRO_STATUS_RATE_VALID);
}

static void test_a_saturated_pickoff_is_said_and_forgotten(void)
{
    power_on();
    run(2.0);
    TEST_ASSERT_TRUE(state.signals.status & GYRO_STATUS_RATE_VALID);
    for (int limit = 0; limit < 4; limit++) {
        struct gyro_input input = {limit == 0 ? INT32_MAX : limit == 1 ? INT32_MIN : 0,
                                   limit == 2 ? INT32_MAX : limit == 3 ? INT32_MIN : 0, 0};
        struct gyro_output output = gyro_step(&cfg, &state, &input);
        while (!output.slow_tick) {
            output = fixture_sample(&device, &cfg, &state, &plant, &noise);
        }
        TEST_ASSERT_TRUE(state.signals.status & GYRO_STATUS_ADC_SATURATED);
        TEST_ASSERT_FALSE(state.signals.status & GYRO_STATUS_RATE_VALID);
        run(0.004);
        TEST_ASSERT_FALSE(state.signals.status & GYRO_STATUS_ADC_SATURATED);
    }
}

static void test_retuning_outside_its_validity_is_said(void)
{
    device.compensation = GYRO_COMPENSATION_G2;
    power_on();
    run(2.0);
    TEST_ASSERT_TRUE(state.signals.status & GYRO_STATUS_RETUNE_VALID);
    cfg.tuning.center_freq_u64 += UINT64_C(1) << 56;
    run(0.01);
    TEST_ASSERT_FALSE(state.signals.status & (GYRO_STATUS_RETUNE_VALID | GYRO_STATUS_RATE_VALID));
}

static void test_a_stopped_shell_is_acquired_again(void)
{
    power_on();
    run(2.0);
    plant.full_force = 0.0;
    plant.x1 = plant.v1 = 0.0;
    run(2.0);
    TEST_ASSERT_FALSE(state.signals.status & GYRO_STATUS_LOCKED);
    fixture_plant_init(&plant, &device);
    run(4.0);
    TEST_ASSERT_TRUE(state.signals.status & GYRO_STATUS_LOCKED);
}

/* No hidden memory: two gyros in turns are the two gyros alone. */
/* Q/(pi f): the amplitude falls as the plant's own, the frequency stays, and there is no cold start afterwards. */
static void test_a_ring_down_decays_as_the_shell_does(void)
{
    const double decay_s = device.quality / (4.0 * atan(1.0) * device.freq_hz);
    power_on();
    run(3.0);
    double level = ldexp(state.signals.drive_level_q31, -31);
    cfg.drive.off = true;
    run(0.2);
    double before = ldexp(state.drive.amplitude_q30, -30);
    struct mean mean = average(decay_s);
    TEST_ASSERT_DOUBLE_WITHIN(0.002 * before, before * exp(-1.0), ldexp(state.drive.amplitude_q30, -30));
    TEST_ASSERT_DOUBLE_WITHIN(0.002, device.freq_hz, mean.freq_hz);
    TEST_ASSERT_TRUE(mean.all & GYRO_STATUS_DRIVE_OFF);
    TEST_ASSERT_FALSE(mean.any & (GYRO_STATUS_RATE_VALID | GYRO_STATUS_ACQUIRING));
    cfg.drive.off = false;
    run(2.0);
    mean = average(0.1);
    TEST_ASSERT_EQUAL_HEX32(LOCKED, mean.all & LOCKED);
    TEST_ASSERT_FALSE(mean.any & GYRO_STATUS_DRIVE_OFF);
    TEST_ASSERT_DOUBLE_WITHIN(0.002, level, ldexp(state.signals.drive_level_q31, -31));
}

/* When there is nothing left to hear the frequency waits; the drive then finds the shell where it left it, without a cold start. */
static void test_a_shell_that_rang_down_to_nothing_is_driven_again(void)
{
    power_on();
    run(3.0);
    cfg.drive.off = true;
    run(10.0);
    TEST_ASSERT_EQUAL_INT32(0, state.drive.drive_q31);
    TEST_ASSERT_TRUE(state.drive.amplitude_q30 < cfg.acquisition.audible_q30);
    TEST_ASSERT_DOUBLE_WITHIN(1.0, device.freq_hz, ldexp((double)state.oscillator.freq_u64, -64) * device.sample_rate_hz);
    cfg.drive.off = false;
    struct mean mean = average(2.0);
    TEST_ASSERT_FALSE(mean.any & GYRO_STATUS_ACQUIRING);
    mean = average(0.1);
    TEST_ASSERT_EQUAL_HEX32(LOCKED, mean.all & LOCKED);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, device.freq_hz, mean.freq_hz);
}

static void test_gyros_share_nothing(void)
{
    static struct gyro_state alone[2], together[2];
    struct random_state random = random_begin(__func__, 3);
    device.compensation = GYRO_COMPENSATION_G2;
    power_on();
    struct gyro_cfg other = cfg;
    other.compensation = GYRO_COMPENSATION_NONE;
    other.lockin.decimation = 8;
    other.lockin.reference_shift = lockin_reference_shift(8);
    const struct gyro_cfg *const cfgs[2] = {&cfg, &other};
    enum { COUNT = 20000 };
    static struct gyro_input inputs[COUNT];
    for (int n = 0; n < COUNT; n++) {
        inputs[n] = (struct gyro_input){random_wide_i32(&random), random_wide_i32(&random), random_wide_i32(&random)};
    }
    for (int k = 0; k < 2; k++) {
        gyro_reset(cfgs[k], &alone[k]);
        gyro_reset(cfgs[k], &together[k]);
        for (int n = 0; n < COUNT; n++) {
            (void)gyro_step(cfgs[k], &alone[k], &inputs[n]);
        }
    }
    for (int n = 0; n < COUNT; n++) {
        (void)gyro_step(cfgs[0], &together[0], &inputs[n]);
        (void)gyro_step(cfgs[1], &together[1], &inputs[n]);
    }
    TEST_ASSERT_EQUAL_MEMORY(alone, together, sizeof alone);
}

/* Any codes, any temperature, any change of mode, either loop: the sanitizer build watches for overflow. */
static void test_any_codes(void)
{
    struct random_state random = random_begin(__func__, 4);
    device.bias_rad_s = 6e-3;
    power_on();
    cfg.bias_rad_s_q31 = (struct thermal_polynomial){{INT32_MAX, INT32_MIN, INT32_MAX, 3, 4, INT32_MIN}, 5};
    for (long n = 0; n < 3000000; n++) {
        if (n % 10000 == 0) {
            cfg.loop = (uint32_t)(random_u64(&random) % GYRO_LOOP_COUNT);
            cfg.compensation = (uint32_t)(random_u64(&random) % GYRO_COMPENSATION_COUNT);
            cfg.output_filter = (uint32_t)(random_u64(&random) % OUTPUT_FILTER_COUNT);
            cfg.test_signal.in_phase_q31 = random_i32(&random) / 2;
            cfg.bias_rad_s_q31.order = (uint32_t)(random_u64(&random) % 6);
            state.acquisition.phase = random_u64(&random) & 1 ? ACQUISITION_DONE : state.acquisition.phase;
        }
        bool extreme = (n / 5000) % 2 == 0;
        struct gyro_input input = {extreme ? ((n / 5) % 2 == 0 ? INT32_MIN : INT32_MAX) : random_wide_i32(&random),
                                   extreme ? ((n / 5) % 2 == 0 ? INT32_MAX : INT32_MIN) : random_wide_i32(&random),
                                   random_wide_i32(&random)};
        (void)gyro_step(&cfg, &state, &input);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_cold_start_within_1_5_s_anywhere_within_one_per_cent);
    RUN_TEST(test_held_conditions_when_locked_is_set);
    RUN_TEST(test_noise_alone_never_locks);
    RUN_TEST(test_rate_open_loop);
    RUN_TEST(test_bias_is_taken_out_by_static_and_by_g2);
    RUN_TEST(test_rebalance_nulls_the_secondary_and_measures_the_rate);
    RUN_TEST(test_slow_ticks_come_every_fifty_samples);
    RUN_TEST(test_codes_use_the_dacs_bits_only);
    RUN_TEST(test_missing_thermometer_takes_the_rate_away_and_gives_it_back);
    RUN_TEST(test_a_saturated_pickoff_is_said_and_forgotten);
    RUN_TEST(test_retuning_outside_its_validity_is_said);
    RUN_TEST(test_a_stopped_shell_is_acquired_again);
    RUN_TEST(test_a_ring_down_decays_as_the_shell_does);
    RUN_TEST(test_a_shell_that_rang_down_to_nothing_is_driven_again);
    RUN_TEST(test_gyros_share_nothing);
    RUN_TEST(test_any_codes);
    return UNITY_END();
}
