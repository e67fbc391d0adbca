/* The pickoffs' amplifiers clip before the converters do. */
#include <math.h>

#include "sim/effects/effect.h"

static double clip(double x, double limit)
{
    return x > limit ? limit : x < -limit ? -limit : x;
}

static void pickoff(const double *values, const struct effect_context *now, uint64_t sample, const double velocity_fs_s[2],
                    double displacement_fs[2])
{
    (void)now;
    (void)sample;
    (void)velocity_fs_s;
    displacement_fs[0] = clip(displacement_fs[0], 1.0 - values[0]);
    displacement_fs[1] = clip(displacement_fs[1], 1.0 - values[0]);
}

/* Fundamental of a clipped sine. */
static double gain(double amplitude, double limit)
{
    if (amplitude <= limit) {
        return 1.0;
    }
    double part = limit / amplitude;
    return 0.63661977236758134 * (asin(part) + part * sqrt(1.0 - part * part));
}

static void averaged(const double *values, const struct effect_context *now, struct plant_parameters *p)
{
    p->path.pickoff_gain[0] *= gain(now->amplitude_fs, 1.0 - values[0]);
    p->path.pickoff_gain[1] *= gain(now->secondary_fs, 1.0 - values[0]);
}

const struct effect effect_adc_saturation = {
    .id = "adc_saturation",
    .stage = EFFECT_STAGE_PICKOFF,
    .equation = "x -> limited to +-(1 - loss) FS at both pickoffs",
    .appearance = "the shell swings wider than measured: level above what the amplitude needs, no saturation flag",
    .parameter = {
        {"loss_fs", "FS", EFFECT_STRENGTH, 0.0, 0.0, 0.8, 0.15, "an amplifier that does not reach its rail"},
    },
    .pickoff = pickoff,
    .averaged = averaged,
};
