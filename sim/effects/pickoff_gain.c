/* The secondary pickoff is not as strong as the primary one. */
#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    p->path.pickoff_gain[1] *= 1.0 + values[0] + values[1] * effect_shift_degc(now) + effect_curve(values + 2, now);
}

const struct effect effect_pickoff_gain = {
    .id = "pickoff_gain",
    .stage = EFFECT_STAGE_PICKOFF,
    .equation = "secondary code -> (1 + e + s t + curve) times",
    .appearance = "open loop: rate, bias and quadrature in proportion; closed loop only the loop's speed, so it hides",
    .parameter = {
        {"gain", "1", EFFECT_STRENGTH, 0.0, -0.5, 0.5, 5e-3, "gaps and feedback capacitors, before matching"},
        {"slope_per_degc", "1/degC", EFFECT_STRENGTH, 0.0, -2e-3, 2e-3, 3e-5, "capacitors of 30 ppm/degC"},
        EFFECT_CURVE("1", 0.5, 0.001),
    },
    .parameters = apply,
};
