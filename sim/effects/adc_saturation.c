/* The pickoffs' amplifiers give way before the converters do: flat beyond a knee, or only less steep, on both sides or more on one. */
#include <math.h>

#include "sim/effects/effect.h"

enum { LOSS, POSITIVE, NEGATIVE };

static double limited(const double *values, double x)
{
    double knee = 1.0 - values[LOSS];
    if (x > knee) {
        return x - values[POSITIVE] * (x - knee);
    }
    return x < -knee ? x - values[NEGATIVE] * (x + knee) : x;
}

static void pickoff(const double *values, const struct effect_context *now, uint64_t sample, const double velocity_fs_s[2],
                    double displacement_fs[2])
{
    (void)now;
    (void)sample;
    (void)velocity_fs_s;
    displacement_fs[0] = limited(values, displacement_fs[0]);
    displacement_fs[1] = limited(values, displacement_fs[1]);
}

/* Fundamental of a clipped sine; each side takes its half of what is lost. */
static double gain(const double *values, double amplitude)
{
    double knee = 1.0 - values[LOSS];
    if (amplitude <= knee) {
        return 1.0;
    }
    double part = knee / amplitude;
    double clipped = 0.63661977236758134 * (asin(part) + part * sqrt(1.0 - part * part));
    return 1.0 - 0.5 * (values[POSITIVE] + values[NEGATIVE]) * (1.0 - clipped);
}

static void averaged(const double *values, const struct effect_context *now, struct plant_parameters *p)
{
    p->path.pickoff_gain[0] *= gain(values, now->amplitude_fs);
    p->path.pickoff_gain[1] *= gain(values, now->secondary_fs);
}

const struct effect effect_adc_saturation = {
    .id = "adc_saturation",
    .stage = EFFECT_STAGE_PICKOFF,
    .equation = "beyond +-(1 - loss) FS x loses a part of what exceeds it, at both pickoffs; all of it: limited",
    .appearance = "the shell swings wider than measured: level above what the amplitude needs, no saturation flag",
    .parameter = {
        {"loss_fs", "FS", EFFECT_STRENGTH, 0.0, 0.0, 0.8, 0.15, "an amplifier that does not reach its rail"},
        {"positive_part", "1", EFFECT_SHAPE, 1.0, 0.0, 1.0, 1.0, "1: flat; an amplifier that compresses loses some per cent"},
        {"negative_part", "1", EFFECT_SHAPE, 1.0, 0.0, 1.0, 1.0, "the same on the other side; 0 where the supply is single-ended"},
    },
    .pickoff = pickoff,
    .averaged = averaged,
};
