/* The angular gain is not what the calibration says: constant, with temperature, and with the rate itself. */
#include <math.h>

#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double rate = p->resonator.rate_rad_s;
    p->resonator.angular_gain *= 1.0 + values[0] + values[1] * effect_shift_degc(now) + values[2] * rate * rate + values[3] * fabs(rate)
                                + effect_curve(values + 4, now);
}

const struct effect effect_coriolis_gain = {
    .id = "coriolis_gain",
    .stage = EFFECT_STAGE_COUPLING,
    .equation = "g -> g (1 + e + s t + c W^2 + b |W| + curve); the cross damping keeps its size",
    .appearance = "scale factor: rate in proportion to the true one, its slope over temperature, its cubic part",
    .parameter = {
        {"gain", "1", EFFECT_STRENGTH, 0.0, -0.2, 0.2, 2e-3, "geometry of the shell; a calibrated unit is a few 1e-4"},
        {"slope_per_degc", "1/degC", EFFECT_STRENGTH, 0.0, -1e-3, 1e-3, 2e-5, "thermal expansion of electrodes and shell"},
        {"cubic_s2_rad2", "s^2/rad^2", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3, "a tenth of a percent at 57 deg/s, before anything is trimmed; bound: a tenth"},
        {"bend_s_rad", "s/rad", EFFECT_FORM, 0.0, -0.2, 0.2, 1e-3, "a law that is no square: as large at 57 deg/s"},
        EFFECT_CURVE("1", 0.2, 0.001),
    },
    .parameters = apply,
};
