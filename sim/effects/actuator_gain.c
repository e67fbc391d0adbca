/* Force per DAC code changes with temperature: reference voltage, gaps. Both channels alike. */
#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double t = effect_shift_degc(now);
    double ratio = 1.0 + t * (values[0] + t * values[1]) + effect_curve(values + 2, now);
    for (int mode = 0; mode < 2; mode++) {
        for (int channel = 0; channel < 2; channel++) {
            p->resonator.force[mode][channel] *= ratio;
        }
    }
}

const struct effect effect_actuator_gain = {
    .id = "actuator_gain",
    .stage = EFFECT_STAGE_ACTUATION,
    .equation = "force per code -> (1 + s t + c t^2 + curve), drive and rebalance",
    .appearance = "drive level over temperature; closed loop also the scale factor",
    .parameter = {
        {"slope_per_degc", "1/degC", EFFECT_STRENGTH, 0.0, -5e-3, 5e-3, 1e-4, "a reference of 50 ppm/degC counts twice in an electrostatic force"},
        {"curvature_per_degc2", "1/degC^2", EFFECT_STRENGTH, 0.0, -5e-5, 5e-5, 1e-6, "bow of a band-gap reference"},
        EFFECT_CURVE("1", 0.3, 0.003),
    },
    .parameters = apply,
};
