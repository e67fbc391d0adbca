/* Converters: rounding, limits, noise and offset. */
#include <math.h>

#include "sim/electronics.h"
#include "sim/noise.h"
#include "support/random.h"
#include "unity.h"

void setUp(void) {}
void tearDown(void) {}

static struct electronics_cfg bits(uint32_t n)
{
    return (struct electronics_cfg){.adc_bits = n, .dac_bits = n};
}

static uint64_t clamped;

static int32_t code_of(const struct electronics_cfg *cfg, double displacement, double noise)
{
    struct adc adc;
    int32_t code[2];
    adc_init(cfg, &adc);
    clamped = 0;
    adc_convert(&adc, (pair){displacement, 0.0}, (pair){noise, 0.0}, code, &clamped);
    return code[0];
}

static void rounds_to_nearest_with_ties_to_even(void)
{
    struct electronics_cfg cfg = bits(16);
    TEST_ASSERT_EQUAL_INT32(0, code_of(&cfg, 0.5 / 32768, 0.0));
    TEST_ASSERT_EQUAL_INT32(2, code_of(&cfg, 1.5 / 32768, 0.0));
    TEST_ASSERT_EQUAL_INT32(-2, code_of(&cfg, -1.5 / 32768, 0.0));
    TEST_ASSERT_EQUAL_INT32(1, code_of(&cfg, 0.501 / 32768, 0.0));
    TEST_ASSERT_EQUAL_INT32(16384, code_of(&cfg, 0.5, 0.0));
    TEST_ASSERT_EQUAL_UINT64(0, clamped);
}

static void saturates_and_counts(void)
{
    struct electronics_cfg cfg = bits(16);
    TEST_ASSERT_EQUAL_INT32(32767, code_of(&cfg, 32767.49 / 32768, 0.0));
    TEST_ASSERT_EQUAL_UINT64(0, clamped);
    TEST_ASSERT_EQUAL_INT32(32767, code_of(&cfg, 1.0, 0.0));
    TEST_ASSERT_EQUAL_UINT64(1, clamped);
    TEST_ASSERT_EQUAL_INT32(-32768, code_of(&cfg, -1.0, 0.0));
    TEST_ASSERT_EQUAL_UINT64(0, clamped);
    TEST_ASSERT_EQUAL_INT32(-32768, code_of(&cfg, -1.00002, 0.0));
    TEST_ASSERT_EQUAL_UINT64(1, clamped);
}

static void survives_what_is_absurd(void)
{
    struct electronics_cfg cfg = bits(24);
    for (double size = 1.5; size < 1e300; size *= 1e3) {
        TEST_ASSERT_EQUAL_INT32(8388607, code_of(&cfg, size, 0.0));
        TEST_ASSERT_EQUAL_INT32(-8388608, code_of(&cfg, -size, 0.0));
        TEST_ASSERT_EQUAL_UINT64(1, clamped);
    }
    TEST_ASSERT_EQUAL_INT32(8388607, code_of(&cfg, INFINITY, 0.0));
    TEST_ASSERT_EQUAL_INT32(-8388608, code_of(&cfg, -INFINITY, 0.0));
    TEST_ASSERT_EQUAL_INT32(-8388608, code_of(&cfg, NAN, 0.0));
    TEST_ASSERT_EQUAL_UINT64(1, clamped);
}

/* 32 bit: every code is within half a code of the displacement, up to both ends. */
static void quantiser_can_be_switched_off(void)
{
    struct electronics_cfg cfg = bits(32);
    for (double x = -1.0; x < 0.9999999995; x += 0.000317) {
        TEST_ASSERT_DOUBLE_WITHIN(0.5, x * 2147483648.0, code_of(&cfg, x, 0.0));
    }
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, code_of(&cfg, -1.0, 0.0));
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, code_of(&cfg, 2147483647.4 / 2147483648.0, 0.0));
    TEST_ASSERT_EQUAL_UINT64(0, clamped);
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, code_of(&cfg, 1.0, 0.0));
    TEST_ASSERT_EQUAL_UINT64(1, clamped);
}

/* Mean = displacement + offset, variance = noise^2 + 1/12 code^2, both channels with their own figures. */
static void noise_and_offset_have_their_size(void)
{
    enum { N = 400000 };
    static double noise[2][N];
    struct electronics_cfg cfg = bits(16);
    struct random_state random = random_begin("electronics", 2);
    uint64_t seed = random_u64(&random);
    struct noise_table table;
    struct noise_state state;
    struct adc adc;
    double sum[2] = {0}, squares[2] = {0};
    noise_table_init(&table);
    for (uint32_t channel = 0; channel < 2; channel++) {
        cfg.adc_noise_rms_fs[channel] = (channel + 1) * sqrt(0.5) * pow(10.0, -90.0 / 20.0);
        cfg.adc_offset_fs[channel] = channel == 0 ? 1e-3 : -2e-3;
        noise_init(&state, seed, channel);
        noise_gaussian(&table, &state, N, noise[channel]);
    }
    adc_init(&cfg, &adc);
    for (int i = 0; i < N; i++) {
        int32_t code[2];
        double x = 0.3 + 1e-6 * (i % 1000);
        adc_convert(&adc, (pair){x, -x}, (pair){noise[0][i], noise[1][i]}, code, &clamped);
        double error[2] = {code[0] - 32768.0 * x, code[1] + 32768.0 * x};
        for (int channel = 0; channel < 2; channel++) {
            sum[channel] += error[channel];
            squares[channel] += error[channel] * error[channel];
        }
    }
    for (int channel = 0; channel < 2; channel++) {
        double variance = pow(cfg.adc_noise_rms_fs[channel] * 32768.0, 2.0) + 1.0 / 12;
        double mean = sum[channel] / N;
        TEST_ASSERT_DOUBLE_WITHIN(4.5 * sqrt(variance / N), cfg.adc_offset_fs[channel] * 32768.0, mean);
        TEST_ASSERT_DOUBLE_WITHIN(4.5 * variance * sqrt(2.0 / N), variance, squares[channel] / N - mean * mean);
    }
}

static void dac_scales_and_saturates(void)
{
    struct electronics_cfg cfg = bits(12);
    struct dac dac;
    uint64_t saturated = 0;
    dac_init(&cfg, &dac);
    const int32_t inside[2] = {1024, -2048}, outside[2] = {2048, -2049};
    pair force = dac_convert(&dac, inside, &saturated);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, force[0]);
    TEST_ASSERT_EQUAL_DOUBLE(-1.0, force[1]);
    TEST_ASSERT_EQUAL_UINT64(0, saturated);
    force = dac_convert(&dac, outside, &saturated);
    TEST_ASSERT_EQUAL_DOUBLE(2047.0 / 2048, force[0]);
    TEST_ASSERT_EQUAL_DOUBLE(-1.0, force[1]);
    TEST_ASSERT_EQUAL_UINT64(2, saturated);
    cfg = bits(32);
    dac_init(&cfg, &dac);
    const int32_t widest[2] = {INT32_MIN, INT32_MAX};
    force = dac_convert(&dac, widest, &saturated);
    TEST_ASSERT_EQUAL_DOUBLE(-1.0, force[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1.0 - 0x1p-31, force[1]);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(rounds_to_nearest_with_ties_to_even);
    RUN_TEST(saturates_and_counts);
    RUN_TEST(survives_what_is_absurd);
    RUN_TEST(quantiser_can_be_switched_off);
    RUN_TEST(noise_and_offset_have_their_size);
    RUN_TEST(dac_scales_and_saturates);
    return UNITY_END();
}
