/* While the shell's temperature changes it is not the same all over, and a gradient makes the damping uneven: bias with dT/dt. */
#include "sim/effects/effect.h"

enum { INNER, SHELL, TIME, STARTED };

/* What is further in, a pole behind the shell. */
static double inner(const double *values, const double *state, const struct effect_context *now)
{
    if (state[STARTED] == 0.0) {
        return now->shell_degc;
    }
    return effect_one_pole(state[INNER], state[SHELL], now->shell_degc, now->time_s - state[TIME], values[1]);
}

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    double slope = values[1] > 0.0 ? (now->shell_degc - inner(values, state, now)) / values[1] : now->shell_slope_degc_s;
    effect_add_bias(p, values[0] * slope);
}

static void advance(const double *values, double *state, const struct effect_context *now)
{
    state[INNER] = inner(values, state, now);
    state[SHELL] = now->shell_degc;
    state[TIME] = now->time_s;
    state[STARTED] = 1.0;
}

const struct effect effect_thermal_gradient = {
    .id = "thermal_gradient",
    .stage = EFFECT_STAGE_COUPLING,
    .equation = "2 k z12 / g -> + c dT/dt; with a lag c (T - inner)/lag, lag inner' + inner = T",
    .appearance = "bias of opposite sign on heating and cooling, in proportion to the speed",
    .parameter = {
        {"bias_rad_s_per_degc_s", "rad/s/(degC/s)", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3,
         "3.4 deg/h at 1 degC/min; a degC of gradient across a metal shell shifts z12 by its slope over temperature, 5e-5 rad/s"},
        {"lag_s", "s", EFFECT_FORM, 0.0, 0.0, 1e5, 10.0, "heat takes its time to the other end of the gradient"},
    },
    .parameters = apply,
    .advance = advance,
};
