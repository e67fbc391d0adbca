/* The sampling clock is off: everything that the firmware counts in samples takes a little more or less time. Its oscillator is warmed by the chamber as the
 * shell is, but not by the same way: its temperature may lag behind the shell's, and lead it first. */
#include "sim/effects/effect.h"

enum { ERROR, SLOPE, DRIFT, CURVATURE, LAG, LEAD };
enum { OSCILLATOR, INPUT, STARTED };

static double input_degc(const double *values, const struct effect_context *now)
{
    return effect_shift_degc(now) + values[LEAD] * now->shell_slope_degc_s;
}

/* Of the oscillator, from T0. */
static double shift_degc(const double *values, const double *state, const struct effect_context *now)
{
    return values[LAG] > 0.0 && state[STARTED] != 0.0 ? state[OSCILLATOR] : values[LAG] > 0.0 ? effect_shift_degc(now) : input_degc(values, now);
}

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    double shift = shift_degc(values, state, now);
    p->path.clock_ratio /= 1.0 + 1e-6 * (values[ERROR] + (values[SLOPE] + values[CURVATURE] * shift) * shift + values[DRIFT] * effect_hours(now));
}

static void advance(const double *values, double *state, const struct effect_context *now)
{
    double input = input_degc(values, now);
    if (state[STARTED] == 0.0) {
        state[OSCILLATOR] = effect_shift_degc(now);
        state[INPUT] = input;
        state[STARTED] = 1.0;
    }
    state[OSCILLATOR] = effect_one_pole(state[OSCILLATOR], state[INPUT], input, now->duration_s, values[LAG]);
    state[INPUT] = input;
}

const struct effect effect_clock_error = {
    .id = "clock_error",
    .stage = EFFECT_STAGE_CLOCK,
    .equation = "sample rate -> (1 + e + (s + c x) x + d time) times, lag x' + x = T - T0 + lead T'",
    .appearance = "drive frequency lower by as much; everything else to within the same ppm",
    .parameter = {
        {"error_ppm", "ppm", EFFECT_STRENGTH, 0.0, -1e4, 1e4, 20.0, "a plain quartz oscillator; bound: a trimmed RC one"},
        {"slope_ppm_per_degc", "ppm/degC", EFFECT_STRENGTH, 0.0, -10.0, 10.0, 0.1, "the slope of its curve away from the turning point"},
        {"drift_ppm_per_h", "ppm/h", EFFECT_STRENGTH, 0.0, -1000.0, 1000.0, 1.0, "an oscillator that warms up"},
        {"curvature_ppm_per_degc2", "ppm/degC^2", EFFECT_FORM, 0.0, -0.5, 0.5, 0.035, "a tuning fork's parabola"},
        {"lag_s", "s", EFFECT_FORM, 0.0, 0.0, 1e5, 20.0, "an oscillator on a board that is slower than the shell"},
        {"lead_s", "s", EFFECT_FORM, 0.0, -1e3, 1e3, 3.0, "the shell's own time constant, where the board does not pass through it"},
    },
    .parameters = apply,
    .advance = advance,
};
