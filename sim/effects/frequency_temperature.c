/* The shell's frequency follows temperature otherwise than described: k -> k (1 + s t + c t^2), both modes alike. Q, split and quadrature stay what they are, so
 * that this is the same as another slope in the description. */
#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double t = effect_shift_degc(now);
    double ratio = 1.0 + 1e-6 * (t * (values[0] + t * values[1]) + effect_curve(values + 3, now));
    double mean = 0.5 * (p->resonator.stiffness[0] + p->resonator.stiffness[1]) * ratio * ratio;
    double split = 0.5 * (p->resonator.stiffness[0] - p->resonator.stiffness[1]) * ratio; /* k times the split, which stays */
    p->resonator.stiffness[0] = mean + split;
    p->resonator.stiffness[1] = mean - split;
    p->resonator.cross_stiffness *= ratio;
    double losses = 1.0 + (ratio - 1.0) * (1.0 - values[2]);
    p->resonator.damping[0] *= losses;
    p->resonator.damping[1] *= losses;
}

const struct effect effect_frequency_temperature = {
    .id = "frequency_temperature",
    .stage = EFFECT_STAGE_PRIMARY,
    .equation = "k -> k (1 + s t + c t^2 + curve), t = T - T0, damping k z -> times (1 + (1 - l) of that)",
    .appearance = "drive frequency against temperature; nothing in rate or level",
    .parameter = {
        {"slope_ppm_per_degc", "ppm/degC", EFFECT_STRENGTH, 0.0, -200.0, 200.0, 0.5,
         "elastic alloys are delivered within a few tenths of a ppm/degC; bound: twice plain fused silica"},
        {"curvature_ppm_per_degc2", "ppm/degC^2", EFFECT_STRENGTH, 0.0, -2.0, 2.0, 0.01,
         "the quadratic part that heat treatment leaves; bound: a hundred times that"},
        {"losses_stay", "1", EFFECT_FORM, 0.0, -1.0, 2.0, 1.0, "0: Q stays, as of losses in proportion to the stiffness; 1: the damping rate stays, as of gas"},
        EFFECT_CURVE("ppm", 5000.0, 10.0),
    },
    .parameters = apply,
};
