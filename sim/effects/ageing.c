/* The bias drifts with time at whatever temperature: linearly, or with the logarithm of time as stresses relax. */
#include "sim/effects/effect.h"
#include "sim/elementary.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double time_s = now->time_s > 0.0 ? now->time_s : 0.0;
    double drift = values[0] * effect_hours(now);
    if (values[1] != 0.0) {
        drift += values[1] * elementary_log(1.0 + time_s / values[2]);
    }
    if (values[3] != 0.0) {
        drift += values[3] * (1.0 - elementary_exp(-time_s / values[2]));
    }
    effect_add_bias(p, drift);
}

const struct effect effect_ageing = {
    .id = "ageing",
    .stage = EFFECT_STAGE_COUPLING,
    .equation = "2 k z12 / g -> + d time + l ln(1 + time/tau) + e (1 - exp(-time/tau))",
    .appearance = "bias that goes on in one direction through all temperatures",
    .parameter = {
        {"linear_rad_s_per_h", "rad/s/h", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-4, "20 deg/h in an hour, in the first hours of a new mount"},
        {"logarithmic_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -0.01, 0.01, 1e-5, "2 deg/h per factor e of time"},
        {"time_constant_s", "s", EFFECT_SHAPE, 60.0, 0.1, 1e6, 60.0, "when the logarithm begins"},
        {"settling_rad_s", "rad/s", EFFECT_FORM, 0.0, -0.01, 0.01, 1e-5, "glue that cures settles exponentially: as much as a factor e of time"},
    },
    .parameters = apply,
};
