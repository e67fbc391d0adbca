/* The device does not turn as the rate table's channel says: scale, misalignment, earth. */
#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    (void)now;
    p->resonator.rate_rad_s = p->resonator.rate_rad_s * (1.0 + values[0]) + values[1];
    p->resonator.rate_dot_rad_s2 *= 1.0 + values[0];
}

const struct effect effect_rate_reference = {
    .id = "rate_reference",
    .stage = EFFECT_STAGE_ENVIRONMENT,
    .equation = "W = Wref (1 + e) + o",
    .appearance = "scale factor and bias of the rate against the reference; with the table at rest the offset is a bias",
    .parameter = {
        {"scale", "1", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3, "a misalignment of 2.5 degrees"},
        {"offset_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -1e-3, 1e-3, 5e-5, "vertical part of the earth's rate at 45 degrees"},
    },
    .parameters = apply,
};
