/* Damping grows with the square of the amplitude (gas film, friction in the mount). */
#include <math.h>

#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double ratio = 1.0 + values[0] * pow(now->amplitude_fs, 2.0 + values[1]);
    ratio = ratio > 0.05 ? ratio : 0.05;
    p->resonator.damping[0] *= ratio;
    p->resonator.damping[1] *= ratio;
}

const struct effect effect_amplitude_damping = {
    .id = "amplitude_damping",
    .stage = EFFECT_STAGE_PRIMARY,
    .equation = "1/Q -> (1/Q) (1 + d a^(2 + p)), both modes, a primary amplitude in FS",
    .appearance = "drive level at amplitude steps; a ring-down that is no exponential",
    .parameter = {
        {"damping", "1 at 1 FS", EFFECT_STRENGTH, 0.0, -0.5, 5.0, 0.02, "per cent at working amplitude where friction or gas films take part"},
        {"power_beyond_square", "1", EFFECT_FORM, 0.0, -1.5, 6.0, 1.0, "turbulent drag goes with the amplitude itself, contact with high powers of it"},
    },
    .parameters = apply,
};
