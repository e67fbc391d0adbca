/* The calibration block is taken whole or not at all. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "unity.h"

#include "application/calibration.h"
#include "application/limits.h"
#include "support/board.h"
#include "support/random.h"

static const struct hal_properties board_50k = {.sample_rate_millihz = 50000000, .adc_bits = 16, .dac_bits = 16};
static uint8_t block[CALIBRATION_BYTES];

void setUp(void)
{
    block_default(block);
}

void tearDown(void)
{
}

/* Parsing must not touch the caller's calibration unless it succeeds. */
static enum reason parse_as_is(void)
{
    static struct calibration calibration, untouched;
    memset(&calibration, 0x5A, sizeof calibration);
    memset(&untouched, 0x5A, sizeof untouched);
    enum reason reason = calibration_parse(block, sizeof block, &board_50k, &calibration);
    TEST_ASSERT_EQUAL(reason == REASON_OK, memcmp(&calibration, &untouched, sizeof calibration) != 0);
    return reason;
}

static enum reason parse_with(size_t offset, uint64_t value, unsigned width)
{
    block_default(block);
    block_set(block, offset, value, width);
    block_seal(block);
    return parse_as_is();
}

static void the_compiled_in_block_is_sound(void)
{
    TEST_ASSERT_EQUAL_INT(REASON_OK, parse_as_is());
}

static void envelope_is_checked_first(void)
{
    struct calibration calibration;
    for (size_t size = 0; size < CALIBRATION_BYTES; size++) {
        TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_SIZE, calibration_parse(block, size, &board_50k, &calibration));
    }
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_MAGIC, parse_with(BLOCK_MAGIC, 0x12345678, 4));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_VERSION, parse_with(BLOCK_VERSION, CALIBRATION_VERSION + 1, 2));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_SIZE, parse_with(BLOCK_SIZE, CALIBRATION_BYTES + 4, 2));
}

static void every_changed_bit_is_noticed(void)
{
    for (size_t i = 0; i < CALIBRATION_BYTES; i++) {
        for (unsigned bit = 0; bit < 8; bit++) {
            block[i] ^= (uint8_t)(1u << bit);
            enum reason reason = parse_as_is();
            bool envelope = i < 8;
            TEST_ASSERT_TRUE(envelope ? reason != REASON_OK : reason == REASON_CALIBRATION_CRC);
            block[i] ^= (uint8_t)(1u << bit);
        }
    }
}

/* A field, the last value on either side that passes its own range, and the next one that does not. */
struct edge {
    const char *name;
    size_t offset;
    unsigned width;
    int64_t good, bad;
};

static void ranges_end_where_they_should(void)
{
    static const struct edge edges[] = {
        {"loops per slow, low", BLOCK_LOOPS_PER_SLOW, 4, 1, 0},
        {"loops per slow, high", BLOCK_LOOPS_PER_SLOW, 4, 64, 65},
        {"bias order", BLOCK_BIAS_ORDER, 4, 5, 6},
        {"shift_max", BLOCK_SHIFT_MAX, 4, INT64_C(128) << 20, (INT64_C(128) << 20) + 1},
        {"shift_min", BLOCK_SHIFT_MIN, 4, -(INT64_C(128) << 20), -(INT64_C(128) << 20) - 1},
        {"chirp, low", BLOCK_CHIRP, 4, 2, 1},
        {"chirp, high", BLOCK_CHIRP, 4, 16, 17},
        {"settle, high", BLOCK_CHIRP + 4, 4, 65535, 65536},
        {"listen, high", BLOCK_CHIRP + 8, 4, 12, 13},
        {"audible, low", BLOCK_CHIRP + 12, 4, 1 << 14, (1 << 14) - 1},
        {"attempts, high", BLOCK_CHIRP + 16, 4, 6, 7},
        {"pll proportional, low", BLOCK_CHIRP + 20, 4, 1, 0},
        {"pll proportional, high", BLOCK_CHIRP + 20, 4, 1 << 29, (1 << 29) + 1},
        {"agc proportional, low", BLOCK_CHIRP + 28, 4, 1, 0},
        {"agc integral, low", BLOCK_CHIRP + 32, 4, 0, -1},
        {"amplitude, low", BLOCK_AMPLITUDE, 4, AMPLITUDE_MIN_Q30, AMPLITUDE_MIN_Q30 - 1},
        {"amplitude, high", BLOCK_AMPLITUDE, 4, AMPLITUDE_MAX_Q30, AMPLITUDE_MAX_Q30 + 1},
        {"drive limit, low", BLOCK_DRIVE_MAX, 4, 1, 0},
        {"drive limit, high", BLOCK_DRIVE_MAX, 4, DRIVE_MAX_Q31, DRIVE_MAX_Q31 + 1},
        {"loop delay, high", BLOCK_QUADRATURE_LIMIT + 4, 4, 64 * 65536 - 1, 64 * 65536},
        {"hold ticks, low", BLOCK_LOOP - 8, 4, 1, 0},
        {"adc limit, low", BLOCK_LOOP - 4, 4, 1 << 30, (1 << 30) - 1},
        {"compensation", BLOCK_COMPENSATION, 4, 2, 3},
        {"output filter", BLOCK_OUTPUT_FILTER, 4, 4, 5},
        {"created", BLOCK_CREATED, 8, INT64_MAX, INT64_MIN},
    };
    for (size_t i = 0; i < sizeof edges / sizeof edges[0]; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(REASON_OK, parse_with(edges[i].offset, (uint64_t)edges[i].good, edges[i].width), edges[i].name);
        TEST_ASSERT_EQUAL_INT_MESSAGE(REASON_CALIBRATION_RANGE, parse_with(edges[i].offset, (uint64_t)edges[i].bad, edges[i].width),
                                      edges[i].name);
    }
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_RANGE, parse_with(BLOCK_DECIMATION, 7, 4));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_RANGE, parse_with(BLOCK_DECIMATION, 33, 4));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_RANGE, parse_with(BLOCK_LOOP, 2, 4));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_RANGE, parse_with(BLOCK_SEARCH_MAX, UINT64_C(0x5555555555555556), 8));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_RANGE, parse_with(BLOCK_SEARCH_MIN, UINT64_C(0x00FFFFFFFFFFFFFF), 8));
}

static void fields_that_contradict_each_other_are_refused(void)
{
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_CONFLICT, parse_with(BLOCK_DECIMATION, 12, 4));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_CONFLICT, parse_with(BLOCK_SEARCH_MIN, UINT64_C(0x2000000000000000), 8));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_CONFLICT, parse_with(BLOCK_SHIFT_MIN, 86 << 20, 4));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_CONFLICT, parse_with(BLOCK_CENTER_COS, 0, 4));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_CONFLICT, parse_with(BLOCK_CENTER_2COS, 1, 8));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_CONFLICT, parse_with(BLOCK_CENTER_FREQ, UINT64_C(0x2000000000000000), 8));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_CONFLICT, parse_with(BLOCK_SAMPLE_PERIOD, 1407375000, 4));
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_CONFLICT, parse_with(BLOCK_LOOP, GYRO_LOOP_REBALANCE, 4));
}

static void rebalance_needs_its_gains_and_limits_that_fit_together(void)
{
    block_set(block, BLOCK_LOOP, GYRO_LOOP_REBALANCE, 4);
    block_set(block, BLOCK_REBALANCE_SCALE, 1000, 4);
    block_set(block, BLOCK_REBALANCE_KP, 65536, 4);
    block_set(block, BLOCK_REBALANCE_LIMIT, 0x59999999, 4);      /* 0.7 */
    block_set(block, BLOCK_QUADRATURE_LIMIT, 0x59999999, 4);
    block_seal(block);
    TEST_ASSERT_EQUAL_INT(REASON_OK, parse_as_is());
    block_set(block, BLOCK_QUADRATURE_LIMIT, 0x60000000, 4);     /* 0.75: together above one */
    block_seal(block);
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_CONFLICT, parse_as_is());
}

static void a_block_for_another_sampling_rate_is_refused(void)
{
    struct hal_properties other = board_50k;
    struct calibration calibration;
    other.sample_rate_millihz++;
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_BOARD, calibration_parse(block, sizeof block, &other, &calibration));
}

/* Whatever stands in the fields, a sealed block is either refused or leaves a configuration within every range. */
static void random_fields_never_pass_a_range(void)
{
    struct random_state random = random_begin("random calibration", 11);
    uint32_t taken = 0;
    for (int round = 0; round < 20000; round++) {
        struct calibration calibration;
        block_default(block);
        size_t offset = 24 + 4 * (random_u64(&random) % ((CALIBRATION_BYTES - 28) / 4));
        block_set(block, offset, (uint32_t)random_wide_i32(&random), 4);
        block_seal(block);
        if (calibration_parse(block, sizeof block, &board_50k, &calibration) != REASON_OK) {
            continue;
        }
        taken++;
        TEST_ASSERT_TRUE(calibration.gyro.lockin.decimation >= 8 && calibration.gyro.lockin.decimation <= 32);
        TEST_ASSERT_TRUE(calibration.gyro.drive.drive_max_q31 > 0 && calibration.gyro.drive.drive_max_q31 <= DRIVE_MAX_Q31);
        TEST_ASSERT_TRUE(calibration.gyro.acquisition.freq_start_u64 < calibration.gyro.acquisition.freq_end_u64);
        TEST_ASSERT_TRUE(calibration.gyro.bias_rad_s_q31.order <= THERMAL_POLYNOMIAL_MAX_ORDER);
        TEST_ASSERT_TRUE(calibration.gyro.compensation < GYRO_COMPENSATION_COUNT);
    }
    TEST_ASSERT_TRUE(taken > 100);
}

/* ---- the vector that firmware and tools share -------------------------------------------------------------------------- */

static void load_golden(void)
{
    FILE *file = fopen(WINEGLASS_SOURCE_DIR "/tests/golden/calibration_block.hex", "r");
    TEST_ASSERT_NOT_NULL(file);
    for (size_t i = 0; i < CALIBRATION_BYTES; i++) {
        unsigned byte;
        TEST_ASSERT_EQUAL_INT(1, fscanf(file, "%2x", &byte));
        block[i] = (uint8_t)byte;
    }
    fclose(file);
}

/* What the SI values of tests/golden/calibration_block.json must become, computed here in floating point. */
static void golden_block_means_what_its_json_says(void)
{
    struct calibration calibration;
    const double rate_hz = 50e3, tick_s = 10 / rate_hz, pi = acos(-1.0);
    load_golden();
    TEST_ASSERT_EQUAL_INT(REASON_OK, calibration_parse(block, sizeof block, &board_50k, &calibration));
    const struct gyro_cfg *gyro = &calibration.gyro;
    TEST_ASSERT_EQUAL_STRING_LEN("golden", calibration.device_name, CALIBRATION_NAME_BYTES);
    TEST_ASSERT_EQUAL_UINT32(4711, calibration.serial);
    TEST_ASSERT_EQUAL_UINT32(3, calibration.sequence);
    TEST_ASSERT_EQUAL_UINT64(1700000000, calibration.created_unix_s);
    TEST_ASSERT_EQUAL_INT32(25000, calibration.reference_temperature_mdegc);
    TEST_ASSERT_EQUAL_INT32(6400, gyro->thermometer.offset_raw);
    TEST_ASSERT_EQUAL_INT32(ldexp(1.0, 36 - 8), gyro->thermometer.gain_degc_q36);
    TEST_ASSERT_EQUAL_INT32(ldexp(-65.0, 20), gyro->thermometer.shift_min_q20);
    static const double bias[] = {1.0792e-3, -4.631e-5, 7.7044e-7, -5.8598e-9};
    TEST_ASSERT_EQUAL_UINT32(3, gyro->bias_rad_s_q31.order);
    for (int i = 0; i < 4; i++) {
        TEST_ASSERT_INT_WITHIN(1, lrint(ldexp(bias[i] * pow(128.0, i), 31)), gyro->bias_rad_s_q31.coef[i]);
    }
    TEST_ASSERT_INT_WITHIN(1, lrint(ldexp(1.5, 28)), gyro->scale_rad_s_q28.coef[0]);
    TEST_ASSERT_INT_WITHIN(1, lrint(ldexp(-0.003 * 128, 28)), gyro->scale_rad_s_q28.coef[1]);
    TEST_ASSERT_INT_WITHIN(1, lrint(ldexp(1.6, 22)), gyro->decay_per_s_q22.coef[0]);
    TEST_ASSERT_INT_WITHIN(1, lrint(ldexp(0.012, 31)), gyro->demodulation_phase_rad_q31.coef[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-15, 5003.25 / rate_hz, ldexp((double)gyro->tuning.center_freq_u64, -64));
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 2 * cos(2 * pi * 5003.25 / rate_hz), ldexp((double)gyro->tuning.center_2cos_q40, -40));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, sin(2 * pi * 5003.25 / rate_hz), ldexp(gyro->tuning.center_sin_q31, -31));
    TEST_ASSERT_INT_WITHIN(1, lrint(ldexp(1.6 * 1.25 / rate_hz, 44)), gyro->tuning.coupling_gain_q44);
    TEST_ASSERT_DOUBLE_WITHIN(1e-15, 4940.0 / rate_hz, ldexp((double)gyro->acquisition.freq_start_u64, -64));
    TEST_ASSERT_EQUAL_UINT64(gyro->acquisition.freq_end_u64, gyro->drive.freq_max_u64);
    TEST_ASSERT_EQUAL_UINT32(9, gyro->acquisition.chirp_ticks_log2);
    TEST_ASSERT_EQUAL_UINT32(20, gyro->acquisition.settle_ticks);
    TEST_ASSERT_EQUAL_UINT32(8, gyro->acquisition.listen_ticks_log2);
    TEST_ASSERT_INT_WITHIN(1, lrint(ldexp(250.0 / rate_hz, 32)), gyro->drive.pll_proportional_q32);
    TEST_ASSERT_INT_WITHIN(1, lrint(ldexp(32000.0 / rate_hz * tick_s, 32)), gyro->drive.pll_integral_q32);
    TEST_ASSERT_INT_WITHIN(1, lrint(ldexp(90.0 * tick_s, 24)), gyro->drive.agc_integral_q24);
    TEST_ASSERT_INT_WITHIN(1, lrint(ldexp(0.005 * 0.9, 30)), gyro->monitor.amplitude_limit_q30);
    TEST_ASSERT_EQUAL_UINT32(500, gyro->monitor.hold_ticks);
    TEST_ASSERT_EQUAL_UINT32(GYRO_COMPENSATION_G2, gyro->compensation);
    TEST_ASSERT_EQUAL_UINT32(OUTPUT_FILTER_0_05, gyro->output_filter);
    TEST_ASSERT_EQUAL_UINT32(16, gyro->dac_shift);
    TEST_ASSERT_TRUE(gyro->calibration_valid);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(the_compiled_in_block_is_sound);
    RUN_TEST(envelope_is_checked_first);
    RUN_TEST(every_changed_bit_is_noticed);
    RUN_TEST(ranges_end_where_they_should);
    RUN_TEST(fields_that_contradict_each_other_are_refused);
    RUN_TEST(rebalance_needs_its_gains_and_limits_that_fit_together);
    RUN_TEST(a_block_for_another_sampling_rate_is_refused);
    RUN_TEST(random_fields_never_pass_a_range);
    RUN_TEST(golden_block_means_what_its_json_says);
    return UNITY_END();
}
