/* How fast the envelope twin runs on one core: 600 s at 50 Hz, ramps of temperature and turns of the rate, open loop with decoupling, with an
 * output filter, without and with two effects. Prints the best of several repetitions, as the samples that the sampled twin would have needed. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "sim/effect_set.h"
#include "sim/envelope.h"

enum { STEPS = 30000, REPETITIONS = 40 };

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static const struct twin_cfg plant = {
    .sample_rate_hz = 50000.0, .block_samples = 50, .serial = 1, .seed = 1,
    .resonator = {
        .reference_degc = 25.0, .frequency_hz = 5000.0, .frequency_slope_ppm_per_degc = 5.0,
        .frequency_curvature_ppm_per_degc2 = 0.02, .quality_factor = 1e4, .quality_slope_per_degc = -0.002,
        .quality_knee_degc = 1000.0, .split_hz = 0.02, .split_axis_deg = 20.0, .angular_gain = 2.0,
        .bias_rad_s = {1.0792e-3, -4.631e-5, 7.7044e-7, -5.8598e-9}, .drive_force_fs_s2 = 1.777e5,
        .rebalance_force_fs_s2 = 2.31e5,
    },
    .thermal = {.initial_degc = 25.0, .shell_time_constant_s = 3.0, .thermometer_lsb_degc = 1.0 / 128.0, .thermometer_noise_degc = 0.004},
    .electronics = {.adc_bits = 16, .dac_bits = 16, .adc_noise_rms_fs = {2.236e-5, 2.236e-5}, .dac_latency_samples = 1.0},
};

static double best_s(const struct envelope_cfg *cfg, const struct envelope_profile *profile, const struct envelope_record *record)
{
    double best = 1e9;
    struct envelope *envelope = envelope_create(&plant, cfg, NULL, 0, NULL);
    for (int i = 0; envelope && i < REPETITIONS; i++) {
        double start = now_s();
        envelope_reset(envelope);
        if (envelope_run(envelope, profile, record) != TWIN_OK) {
            break;
        }
        best = fmin(best, now_s() - start);
    }
    envelope_destroy(envelope);
    return best;
}

static void report(const char *name, double seconds)
{
    printf("%s\t%.1f\tMSa/s\n", name, 1e-6 * 600.0 * plant.sample_rate_hz / seconds);
}

static void fill(double *rate_mean, double *rate_end, double *chamber)
{
    for (int i = 0; i < STEPS; i++) {
        double time_s = 0.02 * i;
        rate_mean[i] = 0.2 * sin(0.5 * (time_s + 0.01));
        rate_end[i] = 0.2 * sin(0.5 * (time_s + 0.02));
        chamber[i] = 25.0 + 50.0 * sin(0.02 * (time_s + 0.02));
    }
}

int main(void)
{
    static double rate_mean[STEPS], rate_end[STEPS], chamber[STEPS], rate[STEPS], level[STEPS];
    fill(rate_mean, rate_end, chamber);
    const struct envelope_event decoupled[] = {{2.0, ENVELOPE_COMPENSATION, 0, {2.0}}, {2.0, ENVELOPE_OUTPUT_FILTER, 0, {3.0}}};
    const struct envelope_event closed[] = {{2.0, ENVELOPE_REBALANCE, 0, {175.0, 11000.0, 0.9, 0.3}}, {2.0, ENVELOPE_LOOP, 0, {1.0}},
                                            {2.0, ENVELOPE_COMPENSATION, 0, {1.0}}, {2.0, ENVELOPE_OUTPUT_FILTER, 0, {3.0}}};
    const struct effect_setting effects[] = {{(uint32_t)effect_find("frequency_split"), 0, {0.02, 0.0, 20.0}},
                                             {(uint32_t)effect_find("thermal_hysteresis"), 0, {1e-4, 5.0}}};
    const struct envelope_record record = {.rate = rate, .drive_level = level};
    struct envelope_profile profile = {STEPS, rate_mean, rate_end, chamber, 2, decoupled};
    struct envelope_cfg cfg = {.step_ticks = 20, .frame_steps = 1};
    report("envelope_open", best_s(&cfg, &profile, &record));
    profile.n_events = 4;
    profile.events = closed;
    report("envelope_rebalance", best_s(&cfg, &profile, &record));
    cfg.n_effects = 2;
    cfg.effects = effects;
    report("envelope_effects", best_s(&cfg, &profile, &record));
    return EXIT_SUCCESS;
}
