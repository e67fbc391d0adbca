/* While the shell's temperature changes it is not the same all over, and a gradient makes the damping uneven: bias with dT/dt. A gradient needs a while to
 * build up: it is the shell against something that follows it with one pole, over that pole's time. */
#include "sim/effects/effect.h"

enum { BIAS, SETTLES };
enum { FOLLOWER, INPUT, TIME, STARTED };

/* Where what follows the shell stands at that instant; the state may be one of before. */
static double follower_degc(const double *values, const double *state, const struct effect_context *now)
{
    double since_s = now->time_s - state[TIME];
    return state[STARTED] == 0.0 ? now->shell_degc : effect_one_pole(state[FOLLOWER], state[INPUT], now->shell_degc, since_s, values[SETTLES]);
}

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    double settles_s = values[SETTLES];
    double slope_degc_s = settles_s > 0.0 ? (now->shell_degc - follower_degc(values, state, now)) / settles_s : now->shell_slope_degc_s;
    effect_add_bias(p, values[BIAS] * slope_degc_s);
}

static void advance(const double *values, double *state, const struct effect_context *now)
{
    state[FOLLOWER] = follower_degc(values, state, now);
    state[INPUT] = now->shell_degc;
    state[TIME] = now->time_s;
    state[STARTED] = 1.0;
}

const struct effect effect_thermal_gradient = {
    .id = "thermal_gradient",
    .stage = EFFECT_STAGE_COUPLING,
    .equation = "2 k z12 / g -> + c G, settles G' + G = dT/dt",
    .appearance = "bias of opposite sign on heating and cooling, in proportion to the speed",
    .parameter = {
        [BIAS] = {"bias_rad_s_per_degc_s", "rad/s/(degC/s)", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3,
                  "3.4 deg/h at 1 degC/min; a degC of gradient across a metal shell shifts z12 by its slope over temperature, 5e-5 rad/s"},
        [SETTLES] = {"settles_s", "s", EFFECT_FORM, 0.0, 0.0, 1e5, 10.0, "heat that goes on into the stem or the mount: a tenth of the shell's time constant"},
    },
    .parameters = apply,
    .advance = advance,
};
