/* Cost of one sample of the core on this machine, locked, for each compensation mode.
 *
 * The codes come from a recorded closed run, replayed, so that only gyro_step is timed. Best of nine rounds. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "core/gyro.h"
#include "float64_chain.h"
#include "support/gyro_fixture.h"
#include "support/random.h"

#define SETTLE 150000
#define SAMPLES 500000
#define ROUNDS 9

static struct gyro_input codes[SAMPLES];

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Runs the loop closed; the state returned is that before the first of `codes`. */
static struct gyro_state record(const struct fixture_device *device, const struct gyro_cfg *cfg)
{
    struct gyro_state state, at_start;
    struct fixture_plant plant;
    struct random_state noise = {1};
    gyro_reset(cfg, &state);
    fixture_plant_init(&plant, device);
    at_start = state;
    for (long n = -SETTLE; n < SAMPLES; n++) {
        struct gyro_input input = {fixture_adc_q31(device, plant.x1, random_gauss(&noise)),
                                   fixture_adc_q31(device, plant.x2, random_gauss(&noise)), 0};
        if (n == 0) {
            at_start = state;
        }
        if (n >= 0) {
            codes[n] = input;
        }
        struct gyro_output output = gyro_step(cfg, &state, &input);
        fixture_plant_step(&plant, output.drive_q31, output.rebalance_q31);
    }
    return at_start;
}

static double best_round_ns(const struct gyro_cfg *cfg, const struct gyro_state *start, uint32_t *check)
{
    double best = 1e9;
    for (int round = 0; round < ROUNDS; round++) {
        struct gyro_state state = *start;
        double begin = seconds();
        for (long n = 0; n < SAMPLES; n++) {
            *check += (uint32_t)gyro_step(cfg, &state, &codes[n]).drive_q31;
        }
        double spent = seconds() - begin;
        best = spent < best ? spent : best;
    }
    return best / SAMPLES * 1e9;
}

static double float64_round_ns(double *check)
{
    double best = 1e9;
    struct float64_chain chain;
    float64_chain_init(&chain, 5000.3, 50000.0, 1.57, 2e-8);
    for (int round = 0; round < ROUNDS; round++) {
        double begin = seconds();
        for (long n = 0; n < SAMPLES; n++) {
            *check += float64_chain_step(&chain, codes[n].primary_q31 * 0x1p-31, codes[n].secondary_q31 * 0x1p-31);
        }
        double spent = seconds() - begin;
        best = spent < best ? spent : best;
    }
    return best / SAMPLES * 1e9;
}

int main(void)
{
    uint32_t sink = 1;
    static const char *const names[] = {"none", "static", "g2"};
    for (uint32_t mode = 0; mode < 3; mode++) {
        struct fixture_device device = fixture_default();
        device.freq_hz = 5000.3;
        device.bias_rad_s = 1.08e-3;
        device.compensation = mode;
        struct gyro_cfg cfg = fixture_cfg(&device);
        struct gyro_state start = record(&device, &cfg);
        uint32_t check = 0;
        double ns = best_round_ns(&cfg, &start, &check);
        if (!(start.signals.status & GYRO_STATUS_LOCKED)) {
            return EXIT_FAILURE;
        }
        printf("core_%s\t%.3f\tns\n", names[mode], ns);
        sink += check;
    }
    double check = 0.0;
    printf("float64_chain\t%.3f\tns\n", float64_round_ns(&check));
    sink += (uint32_t)(int64_t)check;
    return sink == 0 ? EXIT_FAILURE : EXIT_SUCCESS; /* the sums depend on every output, so that none is left out */
}
