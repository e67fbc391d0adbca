/* The device does not compute with what its calibration block says: another block, another version. Here: biases and scale factors that
 * are off. */
#include <math.h>

#include "sim/effects/effect.h"

static int32_t rounded(double value)
{
    double wanted = round(value);
    return wanted > INT32_MAX ? INT32_MAX : wanted < -INT32_MAX ? -INT32_MAX : (int32_t)wanted;
}

static void scale(struct thermal_polynomial *polynomial, double ratio)
{
    for (uint32_t i = 0; i <= THERMAL_POLYNOMIAL_MAX_ORDER; i++) {
        polynomial->coef[i] = rounded(polynomial->coef[i] * ratio);
    }
}

static void change(const double *values, struct gyro_cfg *gyro)
{
    scale(&gyro->scale_rad_s_q28, 1.0 + values[0]);
    scale(&gyro->rebalance_scale_rad_s_q28, 1.0 + values[0]);
    scale(&gyro->bias_rad_s_q31, 1.0 + values[1]);
    gyro->bias_rad_s_q31.coef[0] = rounded(gyro->bias_rad_s_q31.coef[0] + 0x1p31 * values[2]);
}

const struct effect effect_firmware_mismatch = {
    .id = "firmware_mismatch",
    .stage = EFFECT_STAGE_FIRMWARE,
    .equation = "scale polynomials -> (1 + s) times, bias polynomial -> (1 + b) times + o, inside the device only",
    .appearance = "recorded codes replayed through the stated firmware and calibration do not give the recorded output",
    .parameter = {
        {"scale", "1", EFFECT_STRENGTH, 0.0, -0.5, 0.5, 0.01, "the block of another unit"},
        {"bias", "1", EFFECT_STRENGTH, 0.0, -1.0, 1.0, 0.1, "the same"},
        {"offset_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -0.01, 0.01, 1e-4, "a tenth of the bias: another unit's constant"},
    },
    .firmware = change,
};
