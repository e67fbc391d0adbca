/* Cross damping differs from the described (and calibrated) polynomial. */
#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double t = effect_shift_degc(now);
    effect_add_bias(p, values[0] + t * (values[1] + t * (values[2] + t * values[3])) + effect_curve(values + 4, now));
}

const struct effect effect_cross_damping = {
    .id = "cross_damping",
    .stage = EFFECT_STAGE_COUPLING,
    .equation = "2 k z12 / g -> + c0 + c1 t + c2 t^2 + c3 t^3 + curve [rad/s]",
    .appearance = "bias of the rate over temperature, without regard to speed or direction; open loop through the secondary's lag",
    .parameter = {
        {"c0_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -0.05, 0.05, 1e-4, "a tenth of a metal shell's own, 20 deg/h"},
        {"c1_rad_s_per_degc", "rad/s/degC", EFFECT_STRENGTH, 0.0, -1e-3, 1e-3, 5e-6, "a tenth of its slope"},
        {"c2_rad_s_per_degc2", "rad/s/degC^2", EFFECT_STRENGTH, 0.0, -2e-5, 2e-5, 8e-8, "a tenth of its curvature"},
        {"c3_rad_s_per_degc3", "rad/s/degC^3", EFFECT_STRENGTH, 0.0, -4e-7, 4e-7, 6e-10, "a tenth of its cubic part"},
        EFFECT_CURVE("rad/s", 0.05, 0.0001),
    },
    .parameters = apply,
};
