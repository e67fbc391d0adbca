/* White noise of the pickoffs above the converters' floor. It moves no mean: the envelope twin leaves it out. */
#include "sim/effects/effect.h"

static void pickoff(const double *values, const struct effect_context *now, uint64_t sample, const double velocity_fs_s[2],
                    double displacement_fs[2])
{
    (void)velocity_fs_s;
    displacement_fs[0] += values[0] * effect_noise(now->seed, 16, sample);
    displacement_fs[1] += values[1] * effect_noise(now->seed, 17, sample);
}

const struct effect effect_excess_noise = {
    .id = "excess_noise",
    .stage = EFFECT_STAGE_PICKOFF,
    .equation = "x -> x + n, n white, per sample",
    .appearance = "noise of amplitudes and rate, white up to the output filter",
    .parameter = {
        {"primary_fs", "FS rms", EFFECT_STRENGTH, 0.0, 0.0, 0.1, 5e-5, "twice the converter's own noise at 90 dB: two bits lost"},
        {"secondary_fs", "FS rms", EFFECT_STRENGTH, 0.0, 0.0, 0.1, 5e-5, "the same"},
    },
    .pickoff = pickoff,
};
