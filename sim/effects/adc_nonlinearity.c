/* The converters' curves bend or jump. What is odd changes the gain at the carrier; what is even goes to the rails of zero and twice the carrier.
 *
 * The converters' noise goes through their curve with the signal, so a jump is seen through it: its mean is an error function. */
#include <math.h>

#include "sim/effects/effect.h"

enum { CUBIC, QUINTIC, QUADRATIC, SIGN_STEP, HALF_STEP, TEETH };

#define HALF_SCALE 0.5
#define TOOTH_FS 0.25 /* eight segments over the whole range */
#define TWO_OVER_PI 0.63661977236758134

static double bent(const double *values, double x)
{
    double square = x * x;
    return x * square * (values[CUBIC] + square * values[QUINTIC]) + values[QUADRATIC] * square;
}

static double sign_of(double x, double noise_fs)
{
    double sharp = (double)((x > 0.0) - (x < 0.0));
    return fabs(x) < 6.0 * noise_fs ? erf(x / (1.4142135623730951 * noise_fs)) : sharp;
}

/* Teeth that start at zero; there, too, the jump is seen through the noise. */
static double tooth(double x, double sign)
{
    double turns = fabs(x) / TOOTH_FS;
    return (x < 0.0 ? -2.0 : 2.0) * (turns - floor(turns)) - sign;
}

static double jumped(const double *values, double x, double noise_fs)
{
    double sign = sign_of(x, noise_fs), half = fabs(x) > HALF_SCALE ? copysign(values[HALF_STEP], x) : 0.0;
    return 0.5 * values[SIGN_STEP] * sign + half + values[TEETH] * tooth(x, sign);
}

static void pickoff(const double *values, const struct effect_context *now, uint64_t sample, const double velocity_fs_s[2],
                    double displacement_fs[2])
{
    (void)sample;
    (void)velocity_fs_s;
    for (int channel = 0; channel < 2; channel++) {
        double x = displacement_fs[channel];
        displacement_fs[channel] = x + bent(values, x) + jumped(values, x, now->pickoff_noise_fs[channel]);
    }
}

/* Fundamental, over the amplitude, of a unit jump at a level that a sine passes up and down. */
static double jump_gain(double level, double amplitude)
{
    double part = level / amplitude;
    return amplitude > fabs(level) ? TWO_OVER_PI * sqrt(1.0 - part * part) / amplitude : 0.0;
}

/* A unit jump at zero, which noise blurs: exact where either the sine or the noise is much the larger. */
static double sign_gain(double amplitude, double noise_fs)
{
    double size = sqrt(amplitude * amplitude + 4.0 * TWO_OVER_PI * noise_fs * noise_fs);
    return size > 0.0 ? TWO_OVER_PI / size : 0.0;
}

/* There are as many teeth as the converter has segments, however far the shell swings. */
static double teeth_gain(double amplitude, double noise_fs)
{
    double gain = 1.0 / TOOTH_FS - sign_gain(amplitude, noise_fs);
    for (double level = TOOTH_FS; level < amplitude && level < 1.0; level += TOOTH_FS) {
        gain -= 2.0 * jump_gain(level, amplitude);
    }
    return 2.0 * gain;
}

/* Fundamental of the curve: cos^3 has 3/4, cos^5 has 5/8 of it. */
static double gain(const double *values, double amplitude, double noise_fs)
{
    double square = amplitude * amplitude;
    double found = 1.0 + square * (0.75 * values[CUBIC] + 0.625 * square * values[QUINTIC]);
    found += values[SIGN_STEP] * sign_gain(amplitude, noise_fs) + 2.0 * values[HALF_STEP] * jump_gain(HALF_SCALE, amplitude);
    return found + (values[TEETH] != 0.0 ? values[TEETH] * teeth_gain(amplitude, noise_fs) : 0.0);
}

static void averaged(const double *values, const struct effect_context *now, struct plant_parameters *p)
{
    p->path.pickoff_gain[0] *= gain(values, now->amplitude_fs, now->pickoff_noise_fs[0]);
    p->path.pickoff_gain[1] *= gain(values, now->secondary_fs, now->pickoff_noise_fs[1]);
}

const struct effect effect_adc_nonlinearity = {
    .id = "adc_nonlinearity",
    .stage = EFFECT_STAGE_PICKOFF,
    .equation = "x -> x + c3 x^3 + c5 x^5 + c2 x^2 + jumps at zero and at half scale + a sawtooth of eight teeth, at both converters",
    .appearance = "primary amplitude in truth other than measured: level at amplitude steps; the scale factor with amplitude",
    .parameter = {
        {"cubic", "1 at 1 FS", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3, "charge amplifiers and gaps of 60 dB; converters alone are ten times better"},
        {"quintic", "1 at 1 FS", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 3e-4, "a third of it"},
        {"quadratic", "1 at 1 FS", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3, "single-ended gaps"},
        {"sign_step_fs", "FS", EFFECT_STRENGTH, 0.0, -0.05, 0.05, 2e-4, "wrong weight of the first bit: a few codes of 14 bits"},
        {"half_step_fs", "FS", EFFECT_STRENGTH, 0.0, -0.05, 0.05, 2e-4, "wrong weight of the second bit, alike on both sides"},
        {"teeth_fs", "FS", EFFECT_STRENGTH, 0.0, -0.05, 0.05, 2e-4, "segments whose gain is off; the peak of a tooth"},
    },
    .pickoff = pickoff,
    .averaged = averaged,
};
