/* The two modes differ in frequency: a stiff and a soft axis at an angle to the drive. Adds to what the device describes. */
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
    double split = ELEMENTARY_TWO_PI * (values[0] + values[1] * effect_shift_degc(now) + effect_curve(values + 3, now)) * now->velocity_scale_rad_s;
    p->resonator.stiffness[0] += split * values[COSINE];
    p->resonator.stiffness[1] -= split * values[COSINE];
    p->resonator.cross_stiffness += split * values[SINE];
}

const struct effect effect_frequency_split = {
    .id = "frequency_split",
    .stage = EFFECT_STAGE_SECONDARY,
    .equation = "k1^2, k2^2 -> +- k D cos 2a, K12 -> + k D sin 2a, D = 2 pi (split + slope t + curve)",
    .appearance = "quadrature by sin 2a; open loop an oscillating transient and a turned phase by cos 2a; closed loop the latter hides",
    .parameter = {
        {"split_hz", "Hz", EFFECT_STRENGTH, 0.0, -20.0, 20.0, 0.02, "after balancing; some hertz before"},
        {"slope_hz_per_degc", "Hz/degC", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 2e-4, "a per cent of the split per degC, from mount stresses"},
        {"axis_deg", "deg", EFFECT_SHAPE, 20.0, -90.0, 90.0, 20.0, "angle of the stiff axis in mode space; a balancing finds it poorly"},
        EFFECT_CURVE("Hz", 20.0, 0.01),
    },
    .prepare = prepare,
    .parameters = apply,
};
