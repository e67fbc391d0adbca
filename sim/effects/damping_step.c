/* Q changes at constant temperature: a mount that slips, a vacuum that fails. At once, or creeping towards its new value. */
#include <math.h>

#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double since = now->time_s - values[1];
    if (since <= 0.0) {
        return;
    }
    double done = values[2] > 0.0 ? 1.0 - exp(-since / values[2]) : 1.0;
    double ratio = 1.0 + values[0] * done;
    p->resonator.damping[0] *= ratio;
    p->resonator.damping[1] *= ratio;
}

const struct effect effect_damping_step = {
    .id = "damping_step",
    .stage = EFFECT_STAGE_PRIMARY,
    .equation = "1/Q -> (1/Q) (1 + d (1 - e^(-(time - t1)/creep))), time > t1, both modes",
    .appearance = "drive level from one moment on, at whatever temperature; open loop the scale factor too",
    .parameter = {
        {"damping", "1", EFFECT_STRENGTH, 0.0, -0.8, 10.0, 0.02, "a mount that settles; a leak goes on to many times that"},
        {"time_s", "s", EFFECT_SHAPE, 100.0, 0.0, 1e7, 100.0, "since power-up"},
        {"creep_s", "s", EFFECT_SHAPE, 0.0, 0.0, 1e6, 30.0, "0: at once"},
    },
    .parameters = apply,
};
