/* Fractions of a sample in the converters' timing, against the same plant stepped sixteen times as fast. */
#include <math.h>

#include "sim/sampling.h"
#include "support/random.h"
#include "unity.h"

enum { FINE = 16, SAMPLES = 400 };

static const double period_s = 2e-5;
static struct resonator resonator;
static struct resonator_coefs coefs;
static pair force[SAMPLES + 1]; /* as computed at sample n */

void tearDown(void) {}

/* Every coupling on, and forces that change at random from sample to sample. */
void setUp(void)
{
    struct resonator_cfg cfg = {.reference_degc = 25.0, .frequency_hz = 5000.0, .quality_factor = 200.0, .quality_knee_degc = 1000.0,
                                .split_hz = 2.0, .split_axis_deg = 20.0, .angular_gain = 2.0, .bias_rad_s = {0.5},
                                .drive_force_fs_s2 = 3e7, .rebalance_force_fs_s2 = 4e7};
    resonator_init(&cfg, &resonator);
    resonator_coefs_at(&resonator, 25.0, 3.5, 200.0, &coefs);
}

/* Displacement at every fine step, the code of sample n acting from (n + latency) FINE on. */
static void run_fine(int latency_steps, double fine[][2])
{
    struct resonator_map map;
    struct resonator_state state = {{{0.2, 0.0}, {-0.1, 0.0}}};
    resonator_map_over(&coefs, resonator.velocity_scale_rad_s, period_s / FINE, &map);
    for (int step = 0; step < SAMPLES * FINE; step++) {
        int code = (step - latency_steps + 64 * FINE) / FINE - 64; /* floor */
        pair pushed[2];
        resonator_push(&map, code >= 1 ? force[code] : pair_of(0.0), pushed);
        resonator_step(&map, &state, pushed);
        fine[step + 1][0] = state.mode[0][0];
        fine[step + 1][1] = state.mode[1][0];
    }
}

static void check(int latency_steps, int delay_steps)
{
    static double fine[SAMPLES * FINE + 1][2];
    struct sampling_plan plan;
    struct sampling_map map;
    struct sampling_history history = {0};
    struct resonator_state state = {{{0.2, 0.0}, {-0.1, 0.0}}};
    double delay = (double)delay_steps / FINE;
    struct sampling_delays delays = {.latency_samples = (double)latency_steps / FINE, .pickoff_samples = {delay, delay}};
    sampling_plan_init(period_s, &delays, &plan);
    sampling_map_at(&plan, &coefs, resonator.velocity_scale_rad_s, &map);
    run_fine(latency_steps, fine);
    for (uint64_t n = 1; n <= SAMPLES; n++) {
        pair seen = sampling_step(&plan, &map, &history, n, 0.0, &state);
        sampling_push_force(&history, n, force[n]);
        if (n > 8) { /* the delay line is filled */
            TEST_ASSERT_DOUBLE_WITHIN(1e-12, fine[n * FINE - (uint64_t)delay_steps][0], seen[0]);
            TEST_ASSERT_DOUBLE_WITHIN(1e-12, fine[n * FINE - (uint64_t)delay_steps][1], seen[1]);
        }
    }
}

static void whole_samples(void)
{
    for (int latency = 0; latency <= 7; latency++) {
        check(latency * FINE, 0);
        check(FINE, latency * FINE);
    }
}

static void fractions_of_latency(void)
{
    for (int latency = 0; latency <= 7 * FINE; latency += 5) {
        check(latency, 0);
    }
}

static void fractions_of_delay(void)
{
    for (int delay = 0; delay <= 7 * FINE; delay += 3) {
        check(FINE, delay);
        check(0, delay);
    }
}

static void both_at_once(void)
{
    for (int latency = 0; latency <= 2 * FINE; latency += 3) {
        for (int delay = 0; delay <= 2 * FINE; delay++) {
            check(latency, delay);
        }
    }
}

int main(void)
{
    struct random_state random = random_begin("sampling", 3);
    for (int n = 0; n <= SAMPLES; n++) {
        force[n] = (pair){random_uniform(&random, -1.0, 1.0), random_uniform(&random, -1.0, 1.0)};
    }
    UNITY_BEGIN();
    RUN_TEST(whole_samples);
    RUN_TEST(fractions_of_latency);
    RUN_TEST(fractions_of_delay);
    RUN_TEST(both_at_once);
    return UNITY_END();
}
