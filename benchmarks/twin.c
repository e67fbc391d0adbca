/* How fast the twin runs on one core: plant, noise on both ADC channels, converters and the complete application in the loop.
 * Prints the best of several repetitions of two simulated seconds. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "sim/twin.h"

enum { BLOCKS = 2000, BLOCK_SAMPLES = 50, REPETITIONS = 30 };

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static const struct twin_cfg cfg = {
    .sample_rate_hz = 50000.0, .block_samples = BLOCK_SAMPLES, .serial = 1, .seed = 1,
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

static double best_rate(const struct twin_profile *profile)
{
    double best = 0.0;
    struct twin *twin = twin_create(&cfg, NULL, 0, NULL);
    for (int i = 0; twin && i < REPETITIONS; i++) {
        double start = now_s();
        if (twin_run(twin, profile, NULL) != TWIN_OK) {
            break;
        }
        double speed = BLOCKS * (double)BLOCK_SAMPLES / (now_s() - start);
        best = speed > best ? speed : best;
    }
    twin_destroy(twin);
    return best;
}

int main(void)
{
    static double rate[BLOCKS], chamber[BLOCKS];
    for (int i = 0; i < BLOCKS; i++) {
        rate[i] = 1e-5 * i;
        chamber[i] = 25.0 + 1e-3 * i;
    }
    const struct twin_profile constant = {.n_blocks = BLOCKS};
    const struct twin_profile changing = {.n_blocks = BLOCKS, .rate_rad_s = rate, .chamber_degc = chamber};
    printf("twin_constant\t%.2f\tMSa/s\n", 1e-6 * best_rate(&constant));
    printf("twin_changing\t%.2f\tMSa/s\n", 1e-6 * best_rate(&changing));
    return EXIT_SUCCESS;
}
