/* Q follows temperature otherwise than described: Q -> Q (1 + s t + c t^2), both modes; the cross part is left alone. */
#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double t = effect_shift_degc(now);
    double ratio = 1.0 + t * (values[0] + t * values[1]) + effect_curve(values + 2, now);
    ratio = ratio > 0.05 ? ratio : 0.05;
    p->resonator.damping[0] /= ratio;
    p->resonator.damping[1] /= ratio;
}

const struct effect effect_damping_temperature = {
    .id = "damping_temperature",
    .stage = EFFECT_STAGE_PRIMARY,
    .equation = "Q -> Q (1 + s t + c t^2 + curve), t = T - T0",
    .appearance = "drive level against temperature; open loop also the scale factor and the lag of the rate",
    .parameter = {
        {"slope_per_degc", "1/degC", EFFECT_STRENGTH, 0.0, -0.01, 0.01, 5e-4,
         "a quarter of a metal shell's own slope: the thermoelastic part differs from part to part"},
        {"curvature_per_degc2", "1/degC^2", EFFECT_STRENGTH, 0.0, -1e-4, 1e-4, 5e-6,
         "the same over half the temperature range"},
        EFFECT_CURVE("1", 0.8, 0.01),
    },
    .parameters = apply,
};
