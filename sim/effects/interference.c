/* An electrical tone on the secondary pickoff, near the carrier or where sampling folds it there: a switching supply, a radio. */
#include <math.h>

#include "sim/effects/effect.h"
#include "sim/elementary.h"

static void pickoff(const double *values, const struct effect_context *now, uint64_t sample, const double velocity_fs_s[2],
                    double displacement_fs[2])
{
    (void)velocity_fs_s;
    double turns = values[1] / now->sample_rate_hz;
    turns = (turns - floor(turns)) * (double)sample;
    displacement_fs[1] += values[0] * elementary_cos_sin_turns(turns).cosine;
}

static void averaged(const double *values, const struct effect_context *now, struct plant_parameters *p)
{
    double turns = values[1] / now->sample_rate_hz;
    double folded = fabs(turns - floor(turns + 0.5));
    p->path.tone_fs = values[0];
    p->path.tone_rad_s = ELEMENTARY_TWO_PI * folded * now->sample_rate_hz;
}

const struct effect effect_interference = {
    .id = "interference",
    .stage = EFFECT_STAGE_ENVIRONMENT,
    .equation = "secondary pickoff -> + v cos(2 pi f time)",
    .appearance = "a line at |f - drive frequency| in rate and quadrature alike, its phase running; it moves when the shell's frequency does",
    .parameter = {
        {"amplitude_fs", "FS", EFFECT_STRENGTH, 0.0, 0.0, 0.1, 3e-4, "70 dB below full scale, from a supply on the same board"},
        {"frequency_hz", "Hz", EFFECT_SHAPE, 5003.0, 1.0, 1e6, 5003.0, "before folding: a supply at 45 or 55 kHz is at 5 kHz after sampling with 50 kSa/s"},
    },
    .pickoff = pickoff,
    .averaged = averaged,
};
