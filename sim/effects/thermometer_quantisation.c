/* The thermometer reads in coarse steps. With a dead band each code holds on for a part of a step, whichever way the temperature goes: that is play before the
 * rounding. */
#include <math.h>

#include "sim/effects/effect.h"
#include "sim/elementary.h"

enum { STEP, DEAD_BAND, ORIGIN };

/* Integral of the rounded value from 0. */
static double rounded_integral(double codes)
{
    double whole = floor(codes + 0.5);
    return whole * (codes - whole) + 0.5 * whole * whole;
}

/* Mean over an even spread. */
static double mean_over_spread(double codes, double spread)
{
    return (rounded_integral(codes + 0.5 * spread) - rounded_integral(codes - 0.5 * spread)) / spread;
}

/* Mean over Gaussian noise and an even spread: the saw-tooth's Fourier series, each harmonic weakened by both. */
static double mean_over_noise(double codes, double spread, double noise)
{
    double sum = codes;
    for (int k = 1; k <= 12; k++) {
        double angle = ELEMENTARY_TWO_PI * k;
        double weight = exp(-0.5 * angle * noise * angle * noise) * (k % 2 == 1 ? -2.0 : 2.0) / angle;
        double half = 0.5 * angle * spread;
        double even = half > 1e-6 ? sin(half) / half : 1.0;
        sum += weight * even * sin(angle * codes);
    }
    return sum;
}

static double read(const double *values, const struct effect_context *now, double degc, double spread_degc, double noise_degc)
{
    double origin_degc = now->reference_degc + values[ORIGIN];
    double codes = (degc - origin_degc) / values[STEP];
    double spread = fabs(spread_degc) / values[STEP];
    double noise = noise_degc / values[STEP];
    double rounded = floor(codes + 0.5);
    if (noise > 0.1) {
        rounded = mean_over_noise(codes, spread, noise);
    } else if (spread > 1e-9 || noise > 1e-9) {
        rounded = mean_over_spread(codes, sqrt(spread * spread + 12.0 * noise * noise));
    }
    return origin_degc + values[STEP] * rounded;
}

enum { HELD, STARTED };

static double hold(const double *values, double *state, const struct effect_context *now, double degc)
{
    (void)now;
    double half = fabs(values[STEP] * values[DEAD_BAND]);
    if (state[STARTED] == 0.0) {
        state[HELD] = degc;
        state[STARTED] = 1.0;
    }
    state[HELD] = fmin(fmax(state[HELD], degc - half), degc + half);
    return state[HELD];
}

const struct effect effect_thermometer_quantisation = {
    .id = "thermometer_quantisation",
    .stage = EFFECT_STAGE_TEMPERATURE,
    .equation = "Tm = T1 + q round((P - T1) / q), T1 = T0 + o, P: T with play of d q to each side",
    .appearance = "stairs in the measured temperature and in whatever is compensated with it",
    .parameter = {
        {"step_degc", "degC", EFFECT_STRENGTH, 0.0, 0.0, 10.0, 0.5, "a sensor of 9 bits"},
        {"dead_band", "1", EFFECT_SHAPE, 0.0, 0.0, 1.0, 0.25, "of a step: a comparator that holds on to its code"},
        {"origin_degc", "degC", EFFECT_SHAPE, 0.0, -1000.0, 1000.0, 0.1, "a temperature that is read as it is, from T0"},
    },
    .thermometer = hold,
    .reading = read,
};
