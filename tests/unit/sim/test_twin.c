/* The whole loop: refusals, repeatability, and the firmware's view against the truth. */
#include <math.h>
#include <string.h>

#include "hal/host/wineglass_device.h"
#include "sim/twin.h"
#include "unity.h"

enum { BLOCK = 50, SECOND = 1000 };

void setUp(void) {}
void tearDown(void) {}

/* What the compiled-in calibration expects, with everything on that a device may have. */
static struct twin_cfg device(void)
{
    const double k = 2.0 * 3.14159265358979323846 * 5000.0;
    return (struct twin_cfg){
        .sample_rate_hz = 50000.0, .block_samples = BLOCK, .serial = 7, .seed = 11,
        .resonator = {.reference_degc = 25.0, .frequency_hz = 5000.4, .frequency_slope_ppm_per_degc = 5.0, .quality_factor = 1e4,
                      .quality_slope_per_degc = -0.002, .quality_knee_degc = 1000.0, .angular_gain = 2.0, .bias_rad_s = {1.0792e-3},
                      .drive_force_fs_s2 = 2.0 * 0.9 * 1e-4 * k * k, .rebalance_force_fs_s2 = 2.6 * 0.9 * 1e-4 * k * k},
        .thermal = {.initial_degc = 25.0, .shell_time_constant_s = 3.0, .thermometer_lsb_degc = 1.0 / 65536, .thermometer_noise_degc = 0.004},
        .electronics = {.adc_bits = 16, .dac_bits = 16, .adc_noise_rms_fs = {2.236e-5, 2.236e-5}, .dac_latency_samples = 1.0},
    };
}

static struct twin *create(const struct twin_cfg *cfg)
{
    int32_t error = 1;
    struct twin *twin = twin_create(cfg, NULL, 0, &error);
    TEST_ASSERT_EQUAL_INT32(TWIN_OK, error);
    TEST_ASSERT_NOT_NULL(twin);
    return twin;
}

static void refused(const struct twin_cfg *cfg, int32_t expected)
{
    int32_t error = 1;
    TEST_ASSERT_NULL(twin_create(cfg, NULL, 0, &error));
    TEST_ASSERT_EQUAL_INT32(expected, error);
}

#define REFUSED(field, value, expected)      \
    do {                                     \
        struct twin_cfg cfg_ = device();     \
        cfg_.field = (value);                \
        refused(&cfg_, (expected));          \
    } while (0)

static void bad_configurations_are_refused(void)
{
    REFUSED(sample_rate_hz, 0.0, TWIN_ERROR_SAMPLE_RATE);
    REFUSED(sample_rate_hz, NAN, TWIN_ERROR_SAMPLE_RATE);
    REFUSED(sample_rate_hz, 20000.0, TWIN_ERROR_SAMPLE_RATE);
    REFUSED(block_samples, 0, TWIN_ERROR_SAMPLE_RATE);
    REFUSED(resonator.quality_factor, 0.0, TWIN_ERROR_RESONATOR);
    REFUSED(resonator.bias_rad_s[0], 1.6, TWIN_ERROR_RESONATOR);
    REFUSED(resonator.split_hz, NAN, TWIN_ERROR_RESONATOR);
    REFUSED(thermal.shell_time_constant_s, -1.0, TWIN_ERROR_THERMAL);
    REFUSED(thermal.thermometer_lsb_degc, 0.0, TWIN_ERROR_THERMAL);
    REFUSED(thermal.initial_degc, NAN, TWIN_ERROR_THERMAL);
    REFUSED(electronics.adc_bits, 7, TWIN_ERROR_ELECTRONICS);
    REFUSED(electronics.dac_bits, 33, TWIN_ERROR_ELECTRONICS);
    REFUSED(electronics.adc_delay_samples, 24.5, TWIN_ERROR_ELECTRONICS);
    REFUSED(electronics.dac_latency_samples, -0.1, TWIN_ERROR_ELECTRONICS);
    REFUSED(electronics.adc_noise_rms_fs[1], NAN, TWIN_ERROR_ELECTRONICS);
    struct twin_cfg cfg = device();
    const uint8_t nonsense[16] = {0};
    int32_t error = 0;
    TEST_ASSERT_NULL(twin_create(&cfg, nonsense, sizeof nonsense, &error));
    TEST_ASSERT_EQUAL_INT32(TWIN_ERROR_DEVICE, error);
}

static void bad_profiles_are_refused_and_nothing_runs(void)
{
    struct twin_cfg cfg = device();
    struct twin *twin = create(&cfg);
    struct twin_truth truth;
    double values[2] = {0.0, NAN};
    struct twin_profile profile = {.n_blocks = 2, .rate_rad_s = values};
    TEST_ASSERT_EQUAL_INT32(TWIN_ERROR_PROFILE, twin_run(twin, &profile, NULL));
    profile = (struct twin_profile){.n_blocks = 2, .chamber_degc = values};
    TEST_ASSERT_EQUAL_INT32(TWIN_ERROR_PROFILE, twin_run(twin, &profile, NULL));
    values[1] = 600.0; /* Q(T) is negative there */
    TEST_ASSERT_EQUAL_INT32(TWIN_ERROR_PROFILE, twin_run(twin, &profile, NULL));
    twin_truth(twin, &truth);
    TEST_ASSERT_EQUAL_UINT64(0, truth.samples);
    twin_destroy(twin);
}

/* ---- repeatability ------------------------------------------------------------------------------------------------------ */

enum { BLOCKS = 1500 };

struct trace {
    int32_t codes[BLOCKS * BLOCK][4];
    double thermometer[BLOCKS], primary_i[BLOCKS];
};

static struct trace first, second;
static double rate[BLOCKS], rate_dot[BLOCKS], chamber[BLOCKS];

static void fill_profile(void)
{
    for (int i = 0; i < BLOCKS; i++) {
        rate[i] = 0.05 * sin(0.01 * i);
        rate_dot[i] = 0.5 * cos(0.01 * i);
        chamber[i] = 25.0 + 0.01 * i;
    }
}

/* In pieces of `piece` blocks. */
static void run_into(struct twin *twin, struct trace *trace, uint64_t piece)
{
    for (uint64_t i = 0; i < BLOCKS; i += piece) {
        struct twin_profile profile = {.n_blocks = piece < BLOCKS - i ? piece : BLOCKS - i, .rate_rad_s = rate + i,
                                       .rate_dot_rad_s2 = rate_dot + i, .chamber_degc = chamber + i};
        struct twin_record record = {.codes = trace->codes[i * BLOCK], .thermometer_degc = trace->thermometer + i,
                                     .primary_i = trace->primary_i + i};
        TEST_ASSERT_EQUAL_INT32(TWIN_OK, twin_run(twin, &profile, &record));
    }
}

static void trace_of(const struct twin_cfg *cfg, struct trace *trace, uint64_t piece)
{
    struct twin *twin = create(cfg);
    memset(trace, 0, sizeof *trace);
    run_into(twin, trace, piece);
    twin_destroy(twin);
}

static void same_seed_same_bytes_however_the_run_is_split(void)
{
    struct twin_cfg cfg = device();
    cfg.electronics.adc_delay_samples = 1.3;
    cfg.electronics.dac_latency_samples = 1.25;
    fill_profile();
    trace_of(&cfg, &first, BLOCKS);
    trace_of(&cfg, &second, 7);
    TEST_ASSERT_EQUAL_MEMORY(&first, &second, sizeof first);
    cfg.seed++;
    trace_of(&cfg, &second, BLOCKS);
    TEST_ASSERT_TRUE(memcmp(first.codes, second.codes, sizeof first.codes) != 0);
    TEST_ASSERT_TRUE(memcmp(first.thermometer, second.thermometer, sizeof first.thermometer) != 0);
}

/* Two twins in turn are the same as each alone. */
static void twins_share_nothing(void)
{
    struct twin_cfg cfg = device(), other = device();
    other.seed = 99;
    fill_profile();
    trace_of(&cfg, &first, BLOCKS);
    struct twin *twin = create(&cfg), *neighbour = create(&other);
    memset(&second, 0, sizeof second);
    for (uint64_t i = 0; i < BLOCKS; i += 100) {
        struct twin_profile profile = {.n_blocks = 100, .rate_rad_s = rate + i, .rate_dot_rad_s2 = rate_dot + i, .chamber_degc = chamber + i};
        struct twin_record record = {.codes = second.codes[i * BLOCK]};
        TEST_ASSERT_EQUAL_INT32(TWIN_OK, twin_run(twin, &profile, &record));
        TEST_ASSERT_EQUAL_INT32(TWIN_OK, twin_run(neighbour, &profile, NULL));
    }
    TEST_ASSERT_EQUAL_MEMORY(first.codes, second.codes, sizeof first.codes);
    twin_destroy(twin);
    twin_destroy(neighbour);
}

/* ---- what happens in the loop ------------------------------------------------------------------------------------------- */

static void run_seconds(struct twin *twin, double seconds)
{
    struct twin_profile profile = {.n_blocks = (uint64_t)(seconds * SECOND)};
    TEST_ASSERT_EQUAL_INT32(TWIN_OK, twin_run(twin, &profile, NULL));
}

/* Cold start to lock: what the firmware believes is what is. */
static void firmware_locks_to_the_true_resonance(void)
{
    struct twin_cfg cfg = device();
    struct twin *twin = create(&cfg);
    struct twin_truth truth;
    struct wg_device_signals signals;
    run_seconds(twin, 5.0);
    twin_truth(twin, &truth);
    wg_device_get_signals(twin_device(twin), &signals);
    TEST_ASSERT_EQUAL_UINT64(5 * SECOND * BLOCK, truth.samples);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 5.0, truth.time_s);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 5000.4, truth.resonance_hz);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, truth.resonance_hz, truth.oscillator_hz);
    TEST_ASSERT_DOUBLE_WITHIN(0.009, 0.9, truth.primary_amplitude);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, truth.primary_amplitude, ldexp(signals.primary_i_q30, -30));
    TEST_ASSERT_DOUBLE_WITHIN(0.0175, 0.0, truth.primary_phase_rad);
    TEST_ASSERT_EQUAL_UINT64(0, truth.adc_saturations);
    TEST_ASSERT_EQUAL_UINT64(0, truth.dac_saturations);
    twin_destroy(twin);
}

/* Rate and cross damping: A2 = (g W + g bias) / (2 z k) A1 after many time constants, and the firmware sees the same amplitude. */
static void secondary_answers_rate_and_cross_damping(void)
{
    struct twin_cfg cfg = device();
    cfg.resonator.frequency_slope_ppm_per_degc = 0.0;
    cfg.resonator.quality_slope_per_degc = 0.0;
    struct twin *twin = create(&cfg);
    enum { N = 12 * SECOND };
    static double constant[N];
    for (int i = 0; i < N; i++) {
        constant[i] = 0.02;
    }
    struct twin_profile profile = {.n_blocks = N, .rate_rad_s = constant};
    struct twin_truth truth;
    TEST_ASSERT_EQUAL_INT32(TWIN_OK, twin_run(twin, &profile, NULL));
    twin_truth(twin, &truth);
    double ratio = 2.0 * (0.02 + 1.0792e-3) / (2.0 * 3.14159265358979323846 * 5000.4 / 1e4);
    TEST_ASSERT_DOUBLE_WITHIN(2e-3 * ratio, ratio, truth.secondary_i / truth.primary_amplitude);
    TEST_ASSERT_DOUBLE_WITHIN(5e-3 * ratio, 0.0, truth.secondary_q / truth.primary_amplitude);
    TEST_ASSERT_DOUBLE_WITHIN(1e-15, 1.0792e-3, truth.bias_rad_s);
    twin_destroy(twin);
}

/* The temperatures of the record, and the thermometer's noise. */
static void shell_and_thermometer_are_recorded(void)
{
    enum { N = 3000 };
    static double shell[N], thermometer[N], degc[N];
    struct twin_cfg cfg = device();
    struct twin *twin = create(&cfg);
    for (int i = 0; i < N; i++) {
        degc[i] = 25.0 + 1e-3 * (i + 1);
    }
    struct twin_profile profile = {.n_blocks = N, .chamber_degc = degc};
    struct twin_record record = {.shell_degc = shell, .thermometer_degc = thermometer};
    TEST_ASSERT_EQUAL_INT32(TWIN_OK, twin_run(twin, &profile, &record));
    double squares = 0.0;
    for (int i = 0; i < N; i++) {
        double t = 1e-3 * (i + 1);
        TEST_ASSERT_DOUBLE_WITHIN(1e-9, 25.0 + t - 3.0 * (1.0 - exp(-t / 3.0)), shell[i]);
        squares += pow(thermometer[i] - shell[i], 2.0);
    }
    TEST_ASSERT_DOUBLE_WITHIN(4.5 * 0.004 * sqrt(0.5 / N), 0.004, sqrt(squares / N));
    twin_destroy(twin);
}

/* A resonator that no force moves: the codes are noise of the stated size, and the channels' noises are different ones. */
static void channels_have_their_own_noise(void)
{
    struct twin_cfg cfg = device();
    cfg.resonator.drive_force_fs_s2 = cfg.resonator.rebalance_force_fs_s2 = 0.0;
    cfg.electronics.adc_bits = 24;
    cfg.electronics.adc_noise_rms_fs[1] *= 2.0;
    fill_profile();
    trace_of(&cfg, &first, BLOCKS);
    double n = (double)BLOCKS * BLOCK, products[2][2] = {{0}};
    for (int s = 0; s < BLOCKS * BLOCK; s++) {
        for (int a = 0; a < 2; a++) {
            for (int b = 0; b < 2; b++) {
                products[a][b] += (double)first.codes[s][a] * first.codes[s][b] / n;
            }
        }
    }
    double unit = 2.236e-5 * 8388608.0 * 2.236e-5 * 8388608.0;
    TEST_ASSERT_DOUBLE_WITHIN(4.5 * sqrt(2.0 / n) * unit, unit, products[0][0]);
    TEST_ASSERT_DOUBLE_WITHIN(4.5 * sqrt(2.0 / n) * 4.0 * unit, 4.0 * unit, products[1][1]);
    TEST_ASSERT_DOUBLE_WITHIN(4.5 * sqrt(1.0 / n) * 2.0 * unit, 0.0, products[0][1]);
}

/* An offset at the end of the secondary's range: three codes in four are clamped, and counted. */
static void saturation_is_counted(void)
{
    struct twin_cfg cfg = device();
    cfg.electronics.adc_offset_fs[1] = 1.0;
    struct twin *twin = create(&cfg);
    struct twin_truth truth;
    run_seconds(twin, 0.2);
    twin_truth(twin, &truth);
    TEST_ASSERT_GREATER_THAN_UINT64(5000, truth.adc_saturations);
    twin_destroy(twin);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(bad_configurations_are_refused);
    RUN_TEST(bad_profiles_are_refused_and_nothing_runs);
    RUN_TEST(same_seed_same_bytes_however_the_run_is_split);
    RUN_TEST(twins_share_nothing);
    RUN_TEST(firmware_locks_to_the_true_resonance);
    RUN_TEST(secondary_answers_rate_and_cross_damping);
    RUN_TEST(shell_and_thermometer_are_recorded);
    RUN_TEST(channels_have_their_own_noise);
    RUN_TEST(saturation_is_counted);
    return UNITY_END();
}
