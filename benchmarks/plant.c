/* How fast the plant alone runs on one core: samples per second with constant parameters, and with temperature and rate changing
 * in every block of 50 samples. Prints the best of several repetitions; each is long enough for the clock to matter little. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "sim/twin.h"

enum { BLOCKS = 20000, BLOCK_SAMPLES = 50, REPETITIONS = 20 };

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static const struct resonator_cfg metal = {
    .reference_degc = 25.0, .frequency_hz = 5000.0, .frequency_slope_ppm_per_degc = 5.0,
    .frequency_curvature_ppm_per_degc2 = 0.02, .quality_factor = 1e4, .quality_slope_per_degc = -0.002,
    .quality_knee_degc = 1000.0, .split_hz = 0.02, .split_axis_deg = 20.0, .angular_gain = 2.0,
    .bias_rad_s = {1.0792e-3, -4.631e-5, 7.7044e-7, -5.8598e-9}, .drive_force_fs_s2 = 1.8e5, .rebalance_force_fs_s2 = 2.3e5,
};

static volatile double sink; /* so that no compiler drops the work */

static double best_rate(const double *temperature, const double *rate, const double *forces)
{
    double best = 0.0;
    for (int i = 0; i < REPETITIONS; i++) {
        double state[4] = {0.9, 0.0, 0.0, 0.0};
        double start = now_s();
        if (plant_run(&metal, 50000.0, BLOCK_SAMPLES, BLOCKS, temperature, rate, NULL, forces, state, NULL) != TWIN_OK) {
            exit(EXIT_FAILURE);
        }
        sink = state[0];
        double speed = BLOCKS * (double)BLOCK_SAMPLES / (now_s() - start);
        best = speed > best ? speed : best;
    }
    return best;
}

int main(void)
{
    double *temperature = malloc(BLOCKS * sizeof *temperature);
    double *rate = malloc(BLOCKS * sizeof *rate);
    double *forces = calloc((size_t)BLOCKS * BLOCK_SAMPLES * 2, sizeof *forces);
    if (!temperature || !rate || !forces) {
        return EXIT_FAILURE;
    }
    for (int i = 0; i < BLOCKS; i++) {
        temperature[i] = 25.0 + 1e-3 * i;
        rate[i] = 1e-4 * i;
    }
    printf("plant_constant\t%.2f\tMSa/s\n", 1e-6 * best_rate(NULL, NULL, forces));
    printf("plant_changing\t%.2f\tMSa/s\n", 1e-6 * best_rate(temperature, rate, forces));
    free(temperature);
    free(rate);
    free(forces);
    return EXIT_SUCCESS;
}
