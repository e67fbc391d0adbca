/* Bias that wanders with equal power per octave: five relaxations, a factor of four apart, stepped on a grid in time so that both twins
 * see the same course. */
#include <math.h>

#include "sim/effects/effect.h"

enum { RELAXATIONS = 5, NOW = 5, BEFORE = 6, GRID = 7 };

#define GRID_S 0.25

static double relaxation_s(int i)
{
    static const double seconds[RELAXATIONS] = {1.0, 4.0, 16.0, 64.0, 256.0};
    return seconds[i];
}

static void step(const double *values, double *state, const struct effect_context *now)
{
    uint64_t place = (uint64_t)state[GRID];
    double sum = 0.0;
    for (int i = 0; i < RELAXATIONS; i++) {
        double kept = 1.0 - GRID_S / relaxation_s(i) + 0.5 * (GRID_S / relaxation_s(i)) * (GRID_S / relaxation_s(i));
        double fresh = effect_noise(now->seed, 24 + (uint32_t)i, place);
        state[i] = kept * state[i] + values[0] * sqrt(1.0 - kept * kept) * fresh;
        sum += state[i];
    }
    state[BEFORE] = state[NOW];
    state[NOW] = sum;
    state[GRID] += 1.0;
}

static void advance(const double *values, double *state, const struct effect_context *now)
{
    while (state[GRID] * GRID_S <= now->time_s) {
        step(values, state, now);
    }
}

/* Between the last grid point and the one before: a quarter of a second late, but without jumps. */
static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)values;
    double since = now->time_s / GRID_S - (state[GRID] - 1.0);
    since = since < 0.0 ? 0.0 : since > 1.0 ? 1.0 : since;
    effect_add_bias(p, state[BEFORE] + (state[NOW] - state[BEFORE]) * since);
}

const struct effect effect_flicker_noise = {
    .id = "flicker_noise",
    .stage = EFFECT_STAGE_PICKOFF,
    .equation = "2 k z12 / g -> + sum of relaxations of 1, 4, 16, 64, 256 s, each with rms b",
    .appearance = "floor of the rate's Allan deviation between seconds and minutes",
    .parameter = {
        {"bias_rad_s", "rad/s rms", EFFECT_STRENGTH, 0.0, 0.0, 1e-3, 1e-6, "0.2 deg/h, four times a good metal shell's instability"},
    },
    .parameters = apply,
    .advance = advance,
};
