/* The base vibrates at a mechanical line. What of it turns is a rate; what the shell's unevenness makes of its power is a bias. */
#include "sim/effects/effect.h"
#include "sim/elementary.h"

/* Mean of a sine over the block or step, as part of its value in the middle. */
static double mean_part(double turns)
{
    double angle = 0.5 * ELEMENTARY_TWO_PI * turns;
    return angle > 1e-4 ? elementary_cos_sin_turns(0.5 * turns).sine / angle : 1.0;
}

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    struct elementary_pair line = elementary_cos_sin_turns(values[2] * now->time_s);
    double size = values[0] * mean_part(values[2] * now->duration_s);
    p->resonator.rate_rad_s += size * line.sine;
    p->resonator.rate_dot_rad_s2 += size * ELEMENTARY_TWO_PI * values[2] * line.cosine;
    effect_add_bias(p, values[1]);
}

const struct effect effect_vibration = {
    .id = "vibration",
    .stage = EFFECT_STAGE_ENVIRONMENT,
    .equation = "W -> W + v sin(2 pi f time), 2 k z12 / g -> + b",
    .appearance = "a line in the rate's spectrum, if its frequency passes loop and filter; a bias as long as it lasts",
    .parameter = {
        {"rate_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -10.0, 10.0, 1e-3, "0.06 deg/s: tilting of a fixture on a shaker of 1 g"},
        {"rectified_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -0.01, 0.01, 2e-5, "4 deg/h, for metal shells some deg/h per g^2"},
        {"frequency_hz", "Hz", EFFECT_SHAPE, 4.0, 0.01, 400.0, 50.0, "of the line"},
    },
    .parameters = apply,
};
