/* The converters' curves bend. What is odd changes the gain at the carrier; what is even goes to the rails of zero and twice the carrier. */
#include "sim/effects/effect.h"

static double curved(const double *values, double x)
{
    double square = x * x;
    return x * (1.0 + square * (values[0] + square * values[1])) + values[2] * square;
}

static void pickoff(const double *values, const struct effect_context *now, uint64_t sample, const double velocity_fs_s[2],
                    double displacement_fs[2])
{
    (void)now;
    (void)sample;
    (void)velocity_fs_s;
    displacement_fs[0] = curved(values, displacement_fs[0]);
    displacement_fs[1] = curved(values, displacement_fs[1]);
}

/* Fundamental of the curve: cos^3 has 3/4, cos^5 has 5/8 of it. */
static double gain(const double *values, double amplitude)
{
    double square = amplitude * amplitude;
    return 1.0 + square * (0.75 * values[0] + 0.625 * square * values[1]);
}

static void averaged(const double *values, const struct effect_context *now, struct plant_parameters *p)
{
    p->path.pickoff_gain[0] *= gain(values, now->amplitude_fs);
    p->path.pickoff_gain[1] *= gain(values, now->secondary_fs);
}

const struct effect effect_adc_nonlinearity = {
    .id = "adc_nonlinearity",
    .stage = EFFECT_STAGE_PICKOFF,
    .equation = "x -> x + c3 x^3 + c5 x^5 + c2 x^2 at both converters",
    .appearance = "primary amplitude in truth other than measured: level at amplitude steps; the scale factor with amplitude",
    .parameter = {
        {"cubic", "1 at 1 FS", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3, "charge amplifiers and gaps of 60 dB; converters alone are ten times better"},
        {"quintic", "1 at 1 FS", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 3e-4, "a third of it"},
        {"quadratic", "1 at 1 FS", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3, "single-ended gaps"},
    },
    .pickoff = pickoff,
    .averaged = averaged,
};
