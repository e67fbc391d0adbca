/* The base vibrates at a mechanical line, all the time or while a machine near by runs. What of it turns is a rate; what the shell's unevenness makes of its
 * power is a bias. */
#include "sim/effects/effect.h"
#include "sim/elementary.h"

enum { RATE, RECTIFIED, FREQUENCY, STRETCHES, STRETCHES_END = STRETCHES + 8 };

/* Mean of a sine over the block or step, as part of its value in the middle. */
static double mean_part(double turns)
{
    double angle = 0.5 * ELEMENTARY_TWO_PI * turns;
    return angle > 1e-4 ? elementary_cos_sin_turns(0.5 * turns).sine / angle : 1.0;
}

/* Part of the block or step in which the base vibrates; stretches that overlap are one. */
static double part_shaken(const double *values, const struct effect_context *now)
{
    double still = 1.0;
    bool always = true;
    for (int i = STRETCHES; i < STRETCHES_END; i += 2) {
        if (values[i + 1] > 0.0) {
            always = false;
            still *= 1.0 - effect_part_within(now, values[i], values[i + 1]);
        }
    }
    return always ? 1.0 : 1.0 - still;
}

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double part = part_shaken(values, now);
    struct elementary_pair line = elementary_cos_sin_turns(values[FREQUENCY] * now->time_s);
    double size = part * values[RATE] * mean_part(values[FREQUENCY] * now->duration_s);
    p->resonator.rate_rad_s += size * line.sine;
    p->resonator.rate_dot_rad_s2 += size * ELEMENTARY_TWO_PI * values[FREQUENCY] * line.cosine;
    effect_add_bias(p, part * values[RECTIFIED]);
}

#define STRETCH(number) \
    {"begin_" number "_s", "s", EFFECT_SHAPE, 0.0, 0.0, 1e7, 100.0, "since power-up, of a stretch of time in which it vibrates"}, \
    {"lasts_" number "_s", "s", EFFECT_SHAPE, 0.0, 0.0, 1e7, 50.0, "0: no such stretch; without any it vibrates all the time"}

const struct effect effect_vibration = {
    .id = "vibration",
    .stage = EFFECT_STAGE_ENVIRONMENT,
    .equation = "W -> W + v sin(2 pi f time), 2 k z12 / g -> + b, both while the base vibrates",
    .appearance = "a line in the rate's spectrum, if its frequency passes loop and filter; a bias as long as it lasts",
    .parameter = {
        {"rate_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -10.0, 10.0, 1e-3, "0.06 deg/s: tilting of a fixture on a shaker of 1 g"},
        {"rectified_rad_s", "rad/s", EFFECT_STRENGTH, 0.0, -0.01, 0.01, 2e-5, "4 deg/h, for metal shells some deg/h per g^2"},
        {"frequency_hz", "Hz", EFFECT_SHAPE, 4.0, 0.01, 400.0, 50.0, "of the line"},
        STRETCH("1"), STRETCH("2"), STRETCH("3"), STRETCH("4"),
    },
    .parameters = apply,
};
