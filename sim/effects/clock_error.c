/* The sampling clock is off: everything that the firmware counts in samples takes a little more or less time. */
#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    p->path.clock_ratio /= 1.0 + 1e-6 * (values[0] + values[1] * effect_shift_degc(now) + values[2] * effect_hours(now));
}

const struct effect effect_clock_error = {
    .id = "clock_error",
    .stage = EFFECT_STAGE_CLOCK,
    .equation = "sample rate -> (1 + e + s t + d time) times",
    .appearance = "drive frequency lower by as much; everything else to within the same ppm",
    .parameter = {
        {"error_ppm", "ppm", EFFECT_STRENGTH, 0.0, -1e4, 1e4, 20.0, "a plain quartz oscillator; bound: a trimmed RC one"},
        {"slope_ppm_per_degc", "ppm/degC", EFFECT_STRENGTH, 0.0, -10.0, 10.0, 0.1, "the slope of its curve away from the turning point"},
        {"drift_ppm_per_h", "ppm/h", EFFECT_STRENGTH, 0.0, -1000.0, 1000.0, 1.0, "an oscillator that warms up"},
    },
    .parameters = apply,
};
