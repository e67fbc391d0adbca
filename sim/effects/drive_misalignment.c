/* The drive electrodes do not sit quite on the primary's axis: a part of the drive force pushes the secondary mode. */
#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    p->resonator.force[1][0] += (values[0] + values[1] * effect_shift_degc(now) + effect_curve(values + 2, now)) * p->resonator.force[0][0];
}

const struct effect effect_drive_misalignment = {
    .id = "drive_misalignment",
    .stage = EFFECT_STAGE_ACTUATION,
    .equation = "q2 -> q2 + (m + s t + curve) q1",
    .appearance = "bias in proportion to the drive level: with 1/Q over temperature, at amplitude steps, none in the ring-down",
    .parameter = {
        {"angle_rad", "rad", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3, "a milliradian is 400 deg/h at Q = 1e4 and g = 1.6"},
        {"slope_rad_per_degc", "rad/degC", EFFECT_STRENGTH, 0.0, -1e-3, 1e-3, 1e-5, "a per cent of the angle per degC"},
        EFFECT_CURVE("rad", 0.1, 0.0003),
    },
    .parameters = apply,
};
