/* Strike and listen against a synthetic ringing mode: its complex envelope, in double precision, as the lock-in would show it. */
#include "unity.h"

#include <complex.h>
#include <math.h>
#include <stdio.h>

#include "core/acquisition.h"
#include "support/gyro_fixture.h"
#include "support/random.h"

#define DELAY 9 /* samples from the middle of the decimator's window: N - 1 */
#define TURN_U64 18446744073709551616.0

static double two_pi;
static struct fixture_device device;
static struct acquisition_cfg cfg;

void setUp(void)
{
    two_pi = 8.0 * atan(1.0);
    device = fixture_default();
    cfg = fixture_cfg(&device).acquisition;
}

void tearDown(void)
{
}

struct shell {
    double offset_hz, decay_per_s, growth_per_s; /* from the centre; amplitude per second at full force */
    double noise;                                /* rms of each part of a reading */
};

struct outcome {
    struct acquisition_output output;
    uint32_t ticks;
    double phase_error_rad; /* oscillator behind the shell after the hand-over */
    double ringing;         /* amplitude at the hand-over */
    uint32_t force_ticks;
};

static double center_hz(void)
{
    return ((double)cfg.freq_start_u64 + (double)cfg.freq_end_u64) / 2.0 / TURN_U64 * device.sample_rate_hz;
}

static struct polar to_polar(double complex value)
{
    double turns = carg(value) / two_pi;
    return (struct polar){(int32_t)lrint(ldexp(cabs(value), 30)), (int32_t)(uint32_t)(int64_t)llrint(ldexp(turns, 32))};
}

/* Everything turns with the band's centre: the shell at its offset, the oscillator at that of the chirp. */
static struct outcome acquire(struct shell shell, struct random_state *random)
{
    double tick_s = cfg.decimation / device.sample_rate_hz, delay_s = DELAY / device.sample_rate_hz;
    double complex turn = cexp((-shell.decay_per_s + I * two_pi * shell.offset_hz) * tick_s);
    double complex ringing = 0.0;
    double oscillator = 0.0;
    struct acquisition_state state;
    struct outcome outcome = {0};
    acquisition_reset(&cfg, &state);
    while (!outcome.output.done && outcome.ticks < 100000) {
        double oscillator_hz = (double)outcome.output.freq_u64 / TURN_U64 * device.sample_rate_hz - center_hz();
        double complex back = cexp(-(I * two_pi * (shell.offset_hz - (outcome.output.force_on ? oscillator_hz : 0.0))) * delay_s);
        double complex noise = shell.noise * (random_gauss(random) + I * random_gauss(random));
        struct polar heard = to_polar(ringing * cexp(-I * oscillator) * back + noise);
        outcome.output = acquisition_step(&cfg, &state, heard);
        outcome.ticks++;
        outcome.force_ticks += outcome.output.force_on;
        if (outcome.output.done) {
            break;
        }
        double step = two_pi * ((double)outcome.output.freq_u64 / TURN_U64 * device.sample_rate_hz - center_hz()) * tick_s;
        double complex force = outcome.output.force_on ? shell.growth_per_s * tick_s * cexp(I * (oscillator + 0.5 * step)) : 0.0;
        ringing = ringing * turn + force;
        oscillator += step;
    }
    double advance = ldexp((double)(int32_t)outcome.output.advance_u32, -32) * two_pi;
    outcome.phase_error_rad = remainder(carg(ringing) - oscillator - advance, two_pi);
    outcome.ringing = cabs(ringing);
    return outcome;
}

static double error_hz(struct outcome outcome, struct shell shell)
{
    return (double)outcome.output.freq_u64 / TURN_U64 * device.sample_rate_hz - center_hz() - shell.offset_hz;
}

static struct shell metal(double offset_hz, double noise)
{
    double decay = two_pi * 5000.0 / 2e4;
    return (struct shell){offset_hz, decay, 2.0 * 0.9 * decay, noise};
}

static void sweep(double noise, double *worst_hz, double *worst_rad, double *faintest)
{
    struct random_state random = random_begin(__func__, 1);
    for (double offset = -50.0; offset <= 50.0; offset += 1.25) {
        struct shell shell = metal(offset, noise);
        struct outcome outcome = acquire(shell, &random);
        TEST_ASSERT_TRUE(outcome.output.done);
        TEST_ASSERT_TRUE(outcome.output.force_on);
        TEST_ASSERT_EQUAL_UINT32(512 + 20 + 512, outcome.ticks);
        *worst_hz = fmax(*worst_hz, fabs(error_hz(outcome, shell)));
        *worst_rad = fmax(*worst_rad, fabs(outcome.phase_error_rad));
        *faintest = fmin(*faintest, outcome.ringing);
    }
}

/* A reading's noise: the ADC's 90 dB in the decimator's bandwidth is 1e-5 of full scale. */
static void test_frequency_and_phase_within_one_per_cent(void)
{
    const double noises[] = {0.0, 1e-5, 1e-4, 1e-3};
    const double limits_hz[] = {1e-4, 3e-3, 3e-2, 0.3}, limits_rad[] = {1e-3, 2e-3, 2e-2, 0.2};
    for (int k = 0; k < 4; k++) {
        double worst_hz = 0.0, worst_rad = 0.0, faintest = 1.0;
        sweep(noises[k], &worst_hz, &worst_rad, &faintest);
        printf("noise %.0e: worst %.2g Hz, %.2g rad; ringing at least %.3f\n", noises[k], worst_hz, worst_rad, faintest);
        TEST_ASSERT_TRUE(worst_hz <= limits_hz[k]);
        TEST_ASSERT_TRUE(worst_rad <= limits_rad[k]);
    }
}

static void test_silent_shell_gets_slower_chirps_then_the_centre(void)
{
    struct random_state random = random_begin(__func__, 2);
    struct shell shell = {0.0, 3.14, 0.0, 1e-5};
    struct outcome outcome = acquire(shell, &random);
    TEST_ASSERT_TRUE(outcome.output.done);
    TEST_ASSERT_TRUE(outcome.output.force_on);
    TEST_ASSERT_EQUAL_UINT32(0, outcome.output.advance_u32);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.0, error_hz(outcome, shell));
    uint32_t chirps = 512 + 2048 + 8192;
    TEST_ASSERT_UINT32_WITHIN(3, chirps + 3 * (20 + 512), outcome.ticks);
    TEST_ASSERT_UINT32_WITHIN(3, chirps, outcome.force_ticks);
}

static void test_faint_shell_is_found_by_a_slower_chirp(void)
{
    struct random_state random = random_begin(__func__, 3);
    struct shell shell = metal(17.0, 1e-5);
    shell.growth_per_s *= 4e-3;
    struct outcome outcome = acquire(shell, &random);
    TEST_ASSERT_TRUE(outcome.ticks > 512 + 20 + 512);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 0.0, error_hz(outcome, shell));
    printf("a shell 250 times weaker: found after %u ticks, %.2g Hz off\n", outcome.ticks, error_hz(outcome, shell));
}

static void test_shell_that_decays_too_fast_starts_at_the_centre(void)
{
    struct random_state random = random_begin(__func__, 4);
    struct shell shell = {30.0, two_pi * 5000.0 / 100.0, 2.0 * 0.9 * two_pi * 5000.0 / 100.0, 1e-5}; /* Q 50 */
    struct outcome outcome = acquire(shell, &random);
    TEST_ASSERT_TRUE(outcome.output.done);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, -30.0, error_hz(outcome, shell));
}

/* However loud, noise does not stay above the threshold for the whole listening time. */
static void test_noise_is_never_taken_for_ringing(void)
{
    struct random_state random = random_begin(__func__, 5);
    for (int run = 0; run < 60; run++) {
        struct shell shell = {0.0, 3.14, 0.0, pow(10.0, random_uniform(&random, -5.0, -0.5))};
        struct outcome outcome = acquire(shell, &random);
        TEST_ASSERT_TRUE(outcome.output.done);
        TEST_ASSERT_EQUAL_UINT32(0, outcome.output.advance_u32);
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.0, error_hz(outcome, shell));
    }
}

static void test_no_attempts_starts_at_the_centre_at_once(void)
{
    struct acquisition_state state;
    cfg.attempts = 0;
    acquisition_reset(&cfg, &state);
    TEST_ASSERT_EQUAL_UINT32(ACQUISITION_DONE, state.phase);
    TEST_ASSERT_TRUE(acquisition_step(&cfg, &state, (struct polar){0, 0}).done);
}

static void test_chirp_covers_the_band(void)
{
    struct acquisition_state state;
    struct acquisition_output output = {0};
    acquisition_reset(&cfg, &state);
    output = acquisition_step(&cfg, &state, (struct polar){0, 0});
    TEST_ASSERT_EQUAL_UINT64(cfg.freq_start_u64, output.freq_u64);
    uint64_t last = output.freq_u64;
    while (output.force_on) {
        last = output.freq_u64;
        output = acquisition_step(&cfg, &state, (struct polar){0, 0});
    }
    double covered = (double)(last - cfg.freq_start_u64) / (double)(cfg.freq_end_u64 - cfg.freq_start_u64);
    TEST_ASSERT_DOUBLE_WITHIN(0.003, 1.0, covered);
}

/* The largest listening time and phases that jump by half a turn: the sanitizer build watches the sums. */
static void test_any_angles(void)
{
    struct random_state random = random_begin(__func__, 6);
    cfg.chirp_ticks_log2 = 1;
    cfg.listen_ticks_log2 = 12;
    for (int run = 0; run < 40; run++) {
        struct acquisition_state state;
        acquisition_reset(&cfg, &state);
        int32_t angle = 0, step = run == 0 ? INT32_MAX : run == 1 ? INT32_MIN : random_i32(&random);
        for (int n = 0; n < 25000 && state.phase != ACQUISITION_DONE; n++) {
            angle = (int32_t)((uint32_t)angle + (uint32_t)step);
            (void)acquisition_step(&cfg, &state, (struct polar){INT32_MAX, run < 20 ? angle : random_i32(&random)});
        }
        TEST_ASSERT_EQUAL_UINT32(ACQUISITION_DONE, state.phase);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_frequency_and_phase_within_one_per_cent);
    RUN_TEST(test_silent_shell_gets_slower_chirps_then_the_centre);
    RUN_TEST(test_faint_shell_is_found_by_a_slower_chirp);
    RUN_TEST(test_shell_that_decays_too_fast_starts_at_the_centre);
    RUN_TEST(test_noise_is_never_taken_for_ringing);
    RUN_TEST(test_no_attempts_starts_at_the_centre_at_once);
    RUN_TEST(test_chirp_covers_the_band);
    RUN_TEST(test_any_angles);
    return UNITY_END();
}
