/* The thermometer reads wrong. */
#include "sim/effects/effect.h"

static double read(const double *values, double *state, const struct effect_context *now, double degc)
{
    (void)state;
    return degc + values[0] + values[1] * (degc - now->reference_degc) + effect_curve(values + 2, now);
}

const struct effect effect_thermometer_error = {
    .id = "thermometer_error",
    .stage = EFFECT_STAGE_TEMPERATURE,
    .equation = "Tm = T + o + e (T - T0) + curve of the shell's T",
    .appearance = "drive frequency against measured temperature; a compensation for the wrong temperature",
    .parameter = {
        {"offset_degc", "degC", EFFECT_STRENGTH, 0.0, -30.0, 30.0, 0.5, "accuracy of a digital sensor, untrimmed"},
        {"gain", "1", EFFECT_STRENGTH, 0.0, -0.2, 0.2, 5e-3, "half a per cent"},
        EFFECT_CURVE("degC", 30.0, 0.3),
    },
    .thermometer = read,
};
