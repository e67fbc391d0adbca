/* Bias depends on the way that the temperature took, not on its speed: glue and mounts with dry friction. A play of half width w follows
 * the temperature; the bias goes with how far the play is stretched. */
#include "sim/effects/effect.h"

enum { CENTRE, STARTED };

static double clamp(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

static double centre(const double *values, const double *state, const struct effect_context *now)
{
    return state[STARTED] != 0.0 ? clamp(state[CENTRE], now->shell_degc - values[1], now->shell_degc + values[1]) : now->shell_degc;
}

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    effect_add_bias(p, values[0] * (now->shell_degc - centre(values, state, now)) / values[1]);
}

static void advance(const double *values, double *state, const struct effect_context *now)
{
    state[CENTRE] = centre(values, state, now);
    state[STARTED] = 1.0;
}

const struct effect effect_thermal_hysteresis = {
    .id = "thermal_hysteresis",
    .stage = EFFECT_STAGE_COUPLING,
    .equation = "2 k z12 / g -> + h (T - p)/w, p the play of half width w that follows T",
    .appearance = "bias of opposite sign on heating and cooling, whatever the speed; it turns over within 2 w after a reversal",
    .parameter = {
        {"bias_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -0.01, 0.01, 2e-5, "4 deg/h, between the branches of metal shells with glued mounts"},
        {"half_width_degc", "degC", EFFECT_SHAPE, 5.0, 0.1, 50.0, 5.0, "a few degC until friction gives way"},
    },
    .parameters = apply,
    .advance = advance,
};
