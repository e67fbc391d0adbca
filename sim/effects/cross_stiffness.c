/* Stiffness between the modes beside that of the split: electrodes, mount. Given as the rate that its force would be 90 degrees later. */
#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double t = effect_shift_degc(now);
    double quadrature = values[0] + t * (values[1] + t * values[2]) + effect_curve(values + 3, now);
    p->resonator.cross_stiffness += p->resonator.angular_gain * now->velocity_scale_rad_s * quadrature;
}

const struct effect effect_cross_stiffness = {
    .id = "cross_stiffness",
    .stage = EFFECT_STAGE_COUPLING,
    .equation = "K12 -> + g k (c0 + c1 t + c2 t^2 + curve) [rad/s]",
    .appearance = "quadrature, constant and with temperature; what of it the demodulation's phase error turns into rate",
    .parameter = {
        {"c0_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -10.0, 10.0, 0.01, "half a degree per second; 0.02 Hz of split at 45 degrees is six times that"},
        {"c1_rad_s_per_degc", "rad/s/degC", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-4, "a per cent of the above per degC"},
        {"c2_rad_s_per_degc2", "rad/s/degC^2", EFFECT_STRENGTH, 0.0, -2e-3, 2e-3, 1e-6, "the same again: a per cent of its slope per degC"},
        EFFECT_CURVE("rad/s", 10.0, 0.01),
    },
    .parameters = apply,
};
