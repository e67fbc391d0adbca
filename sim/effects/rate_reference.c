/* The device does not turn as the rate table's channel says: scale, misalignment, earth. A sense axis that is tilted against the table's has a part of the
 * earth's horizontal rate, which comes and goes as the table turns. */
#include "sim/effects/effect.h"
#include "sim/elementary.h"

enum { ANGLE_TURNS, SINCE_S };

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    p->resonator.rate_rad_s = p->resonator.rate_rad_s * (1.0 + values[0]) + values[1];
    p->resonator.rate_dot_rad_s2 *= 1.0 + values[0];
    if (values[2] != 0.0 || values[3] != 0.0) {
        double turned = state[ANGLE_TURNS] + now->rate_rad_s * (now->time_s - state[SINCE_S]) / ELEMENTARY_TWO_PI;
        struct elementary_pair angle = elementary_cos_sin_turns(turned);
        p->resonator.rate_rad_s += values[2] * angle.cosine + values[3] * angle.sine;
    }
}

static void advance(const double *values, double *state, const struct effect_context *now)
{
    (void)values;
    state[ANGLE_TURNS] += now->rate_rad_s * now->duration_s / ELEMENTARY_TWO_PI;
    state[SINCE_S] = now->time_s;
}

const struct effect effect_rate_reference = {
    .id = "rate_reference",
    .stage = EFFECT_STAGE_ENVIRONMENT,
    .equation = "W = Wref (1 + e) + o + a cos F + b sin F, F the angle by which Wref has turned since power-up",
    .appearance = "scale factor and bias of the rate against the reference; with the table at rest the offset is a bias; tilted, a bias that goes round with the table",
    .parameter = {
        {"scale", "1", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3, "a misalignment of 2.5 degrees"},
        {"offset_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -1e-3, 1e-3, 5e-5, "vertical part of the earth's rate at 45 degrees"},
        {"turning_cos_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -1e-3, 1e-3, 5e-6, "a tilt of 5 degrees in the earth's horizontal rate"},
        {"turning_sin_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -1e-3, 1e-3, 5e-6, "the same, by the azimuth at power-up"},
    },
    .parameters = apply,
    .advance = advance,
};
