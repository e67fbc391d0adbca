/* What the envelope twin needs of the firmware's configuration, in SI and double precision. */
#ifndef SIM_ENVELOPE_FIRMWARE_H
#define SIM_ENVELOPE_FIRMWARE_H

#include <stdint.h>

#include "application/calibration.h"

struct envelope_polynomial {
    double coef[THERMAL_POLYNOMIAL_MAX_ORDER + 1]; /* per degC^i */
    uint32_t order;
};

static inline double envelope_polynomial(const struct envelope_polynomial *polynomial, double shift_degc)
{
    double sum = polynomial->coef[polynomial->order];
    for (uint32_t i = polynomial->order; i > 0; i--) {
        sum = sum * shift_degc + polynomial->coef[i - 1];
    }
    return sum;
}

struct envelope_firmware {
    double sample_s, tick_s, slow_s;              /* periods: sample, loop tick, slow tick */
    uint32_t decimation, slow_samples;
    double reference_degc;
    double shift_per_code_degc, shift_offset_raw; /* shift = (code - offset) per_code */
    struct envelope_polynomial bias_rad_s, scale_rad_s, rebalance_scale_rad_s, decay_per_s, demodulation_rad, drive_phase_rad;
    double coupling_gain;                         /* g times the ratio of the pickoff gains, of the decoupler */
    double center_rad_s;
    double pll_kp, pll_ki;                        /* 1/s, 1/s^2 */
    double phase_set_point_rad;
    double amplitude_fs;
    double agc_kp, agc_ki;                        /* FS/FS, FS/FS/s */
    double drive_max_fs;
    double rebalance_kp, rebalance_ki;
    double in_phase_limit_fs, quadrature_limit_fs;
    double loop_delay_samples;
    double test_in_phase_fs, test_quadrature_fs, test_hz;
    double chirp_rad_s2, chirp_center_s, acquisition_s; /* slope of the chirp, middle of it, end of listening */
    uint32_t loop, compensation, output_filter;
    uint32_t drive_off;
};

/* Scale factor of the loop that is on. */
static inline const struct envelope_polynomial *envelope_scale(const struct envelope_firmware *firmware)
{
    return firmware->loop == GYRO_LOOP_REBALANCE ? &firmware->rebalance_scale_rad_s : &firmware->scale_rad_s;
}

void envelope_firmware_init(const struct calibration *calibration, struct envelope_firmware *firmware);

#endif
