/* A gyro configuration from physical numbers, and a small ringing plant to close the loop around it. For tests of the core alone;
 * the digital twin is in sim/. */
#ifndef SUPPORT_GYRO_FIXTURE_H
#define SUPPORT_GYRO_FIXTURE_H

#include <stdint.h>

#include "core/gyro.h"

struct fixture_device {
    double sample_rate_hz;
    double freq_hz;          /* true resonance of both modes */
    double center_freq_hz;   /* what the calibration believes */
    double quality;
    double gain;             /* g, Coriolis gain */
    double bias_rad_s;       /* cross damping as a rate */
    double rate_rad_s;
    double amplitude;        /* set-point, of full scale */
    double force_margin;     /* full force over holding force, both axes */
    double adc_noise;        /* rms, of full scale */
    uint32_t adc_bits;       /* 0: no quantiser (31 bits) */
    uint32_t loop;           /* enum gyro_loop */
    uint32_t compensation;   /* enum gyro_compensation */
};

/* 5 kHz, Q 1e4, g 2, 50 kSa/s, amplitude 0.9, 16 bit, 90 dB, no bias, no rate, no compensation. */
struct fixture_device fixture_default(void);

/* Coefficients for the decoupler's tuning and for the gyro as the calibration block would carry them. */
struct decoupler_tuning fixture_tuning(double sample_rate_hz, double center_freq_hz, double gain);
struct gyro_cfg fixture_cfg(const struct fixture_device *device);

/* Two identical modes under held forces; the secondary is coupled by rate and cross damping. Positions of full scale. */
struct fixture_plant {
    double position_rr, position_rv, velocity_rr, velocity_rv, force_r, force_v; /* one sample's propagation */
    double full_force;
    double kick; /* Coriolis velocity change per half sample and velocity */
    double x1, v1, x2, v2;
};

void fixture_plant_init(struct fixture_plant *plant, const struct fixture_device *device);
void fixture_plant_step(struct fixture_plant *plant, int32_t drive_q31, int32_t rebalance_q31);

/* Position and noise (of full scale) -> left-justified code. */
int32_t fixture_adc_q31(const struct fixture_device *device, double position, double noise);

/* One closed sample: pickoffs with noise into the gyro, its forces into the plant. */
struct random_state;
struct gyro_output fixture_sample(const struct fixture_device *device, const struct gyro_cfg *cfg, struct gyro_state *state,
                                  struct fixture_plant *plant, struct random_state *random);

#endif
