/* The two modes differ in Q: an axis of larger and one of smaller damping at an angle to the drive. The cross part comes on top of the
 * calibrated bias. */
#include "sim/effects/effect.h"
#include "sim/elementary.h"

enum { COSINE = EFFECT_PARAMETERS, SINE };

static void prepare(double *values)
{
    struct elementary_pair axis = elementary_cos_sin_turns(values[2] / 180.0);
    values[COSINE] = axis.cosine;
    values[SINE] = axis.sine;
}

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double half = 0.25 * (values[0] + values[1] * effect_shift_degc(now) + effect_curve(values + 4, now)) * (p->resonator.damping[0] + p->resonator.damping[1]);
    p->resonator.damping[0] += half * values[COSINE] * (1.0 - values[3]);
    p->resonator.damping[1] -= half * values[COSINE] * (1.0 + values[3]);
    p->resonator.cross_damping_12 -= half * values[SINE];
    p->resonator.cross_damping_21 -= half * values[SINE];
}

const struct effect effect_damping_mismatch = {
    .id = "damping_mismatch",
    .stage = EFFECT_STAGE_SECONDARY,
    .equation = "2 z1 k1, 2 z2 k2 -> (1 +- (1 -+ share) (m/2) cos 2a), force on either mode - (m/2) 2 z k sin 2a x'",
    .appearance = "bias by sin 2a; by cos 2a level, and open loop scale factor and lag of the rate",
    .parameter = {
        {"mismatch", "1", EFFECT_STRENGTH, 0.0, -1.0, 1.0, 0.01, "one per cent at Q = 1e4 is a bias of half a degree per second"},
        {"slope_per_degc", "1/degC", EFFECT_STRENGTH, 0.0, -0.01, 0.01, 1e-4, "a per cent of the mismatch per degC"},
        {"axis_deg", "deg", EFFECT_SHAPE, 30.0, -90.0, 90.0, 30.0, "angle of the axis of larger damping in mode space"},
        {"second_share", "1", EFFECT_FORM, 0.0, -1.0, 1.0, 0.3, "0: either mode has half of it; 1: the second mode has all"},
        EFFECT_CURVE("1", 1.0, 0.01),
    },
    .prepare = prepare,
    .parameters = apply,
};
