/* Q changes at constant temperature: a mount that slips, a vacuum that fails. At once, or creeping towards its new value; for good, or for a while. */
#include <math.h>

#include "sim/effects/effect.h"

enum { DAMPING, TIME, CREEP, LASTS };

static double done(double since_s, double creep_s)
{
    if (since_s <= 0.0) {
        return 0.0;
    }
    return creep_s > 0.0 ? 1.0 - exp(-since_s / creep_s) : 1.0;
}

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double since_s = now->time_s - values[TIME], part = done(since_s, values[CREEP]);
    if (values[LASTS] > 0.0) {
        part -= done(since_s - values[LASTS], values[CREEP]);
    }
    double ratio = 1.0 + values[DAMPING] * part;
    p->resonator.damping[0] *= ratio;
    p->resonator.damping[1] *= ratio;
}

const struct effect effect_damping_step = {
    .id = "damping_step",
    .stage = EFFECT_STAGE_PRIMARY,
    .equation = "1/Q -> (1/Q) (1 + d (s(time - t1) - s(time - t1 - lasts))), s(t) = 1 - e^(-t/creep) from t = 0 on, both modes",
    .appearance = "drive level from one moment on, or for a while, at whatever temperature; open loop the scale factor too",
    .parameter = {
        {"damping", "1", EFFECT_STRENGTH, 0.0, -0.8, 10.0, 0.02, "a mount that settles; a leak goes on to many times that"},
        {"time_s", "s", EFFECT_SHAPE, 100.0, 0.0, 1e7, 100.0, "since power-up"},
        {"creep_s", "s", EFFECT_SHAPE, 0.0, 0.0, 1e6, 30.0, "0: at once"},
        {"lasts_s", "s", EFFECT_SHAPE, 0.0, 0.0, 1e7, 100.0, "0: for good"},
    },
    .parameters = apply,
};
