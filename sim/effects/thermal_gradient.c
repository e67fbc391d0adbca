/* While the shell's temperature changes it is not the same all over, and a gradient makes the damping uneven: bias with dT/dt. */
#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    effect_add_bias(p, values[0] * now->shell_slope_degc_s);
}

const struct effect effect_thermal_gradient = {
    .id = "thermal_gradient",
    .stage = EFFECT_STAGE_COUPLING,
    .equation = "2 k z12 / g -> + c dT/dt",
    .appearance = "bias of opposite sign on heating and cooling, in proportion to the speed",
    .parameter = {
        {"bias_rad_s_per_degc_s", "rad/s/(degC/s)", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3,
         "3.4 deg/h at 1 degC/min; a degC of gradient across a metal shell shifts z12 by its slope over temperature, 5e-5 rad/s"},
    },
    .parameters = apply,
};
