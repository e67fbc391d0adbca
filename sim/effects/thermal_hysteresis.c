/* Bias depends on the way that the temperature took, not on its speed: glue and mounts with dry friction. A play of half width w follows
 * the temperature; the bias goes with how far the play is stretched. */
#include "sim/effects/effect.h"

enum { PLAYS = 4, STARTED = PLAYS };

/* Half widths over the given one; their sizes are the bias and, behind the width, the forms. */
static const double part[PLAYS] = {1.0, 0.5, 0.25, 2.0};

static double clamp(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

static double centre(int play, double half_width, const double *state, const struct effect_context *now)
{
    return state[STARTED] != 0.0 ? clamp(state[play], now->shell_degc - half_width, now->shell_degc + half_width) : now->shell_degc;
}

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    for (int play = 0; play < PLAYS; play++) {
        double half_width = part[play] * values[1], size = play == 0 ? values[0] : values[play + 1];
        effect_add_bias(p, size * (now->shell_degc - centre(play, half_width, state, now)) / half_width);
    }
}

static void advance(const double *values, double *state, const struct effect_context *now)
{
    for (int play = 0; play < PLAYS; play++) {
        state[play] = centre(play, part[play] * values[1], state, now);
    }
    state[STARTED] = 1.0;
}

const struct effect effect_thermal_hysteresis = {
    .id = "thermal_hysteresis",
    .stage = EFFECT_STAGE_COUPLING,
    .equation = "2 k z12 / g -> + h (T - p)/w, p the play of half width w that follows T; so with w/2, w/4 and 2 w (Prandtl and Ishlinskii's)",
    .appearance = "bias of opposite sign on heating and cooling, whatever the speed; it turns over within 2 w after a reversal",
    .parameter = {
        {"bias_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -0.01, 0.01, 2e-5, "4 deg/h, between the branches of metal shells with glued mounts"},
        {"half_width_degc", "degC", EFFECT_SHAPE, 5.0, 0.1, 50.0, 5.0, "a few degC until friction gives way"},
        {"half_rad_s", "rad/s", EFFECT_FORM, 0.0, -0.01, 0.01, 1e-5, "of half the width: friction that gives way bit by bit"},
        {"quarter_rad_s", "rad/s", EFFECT_FORM, 0.0, -0.01, 0.01, 1e-5, "of a quarter of the width"},
        {"double_rad_s", "rad/s", EFFECT_FORM, 0.0, -0.01, 0.01, 1e-5, "of twice the width"},
    },
    .parameters = apply,
    .advance = advance,
};
