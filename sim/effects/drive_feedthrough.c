/* Drive voltage leaks into the secondary pickoff, and its steps do through a capacitance. */
#include "sim/effects/effect.h"

enum { LEAK, SLOPE, EDGE, CURVE };

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    p->path.drive_feedthrough += values[LEAK] + values[SLOPE] * effect_shift_degc(now) + effect_curve(values + CURVE, now);
    p->path.drive_edge_feedthrough += values[EDGE];
}

const struct effect effect_drive_feedthrough = {
    .id = "drive_feedthrough",
    .stage = EFFECT_STAGE_PICKOFF,
    .equation = "secondary pickoff -> + (e + s t + curve) drive output at the instant of conversion + c (that less the output before)",
    .appearance = "mostly quadrature, in proportion to the drive level and without the secondary's lag; gone when the drive is off",
    .parameter = {
        {"leak", "FS/FS", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3, "60 dB of isolation between neighbouring electrodes"},
        {"slope_per_degc", "1/degC", EFFECT_STRENGTH, 0.0, -1e-3, 1e-3, 1e-5, "a per cent of it per degC"},
        {"edge", "FS/FS", EFFECT_STRENGTH, 0.0, -0.1, 0.1, 1e-3, "a capacitance between the same electrodes, of the same 60 dB"},
        EFFECT_CURVE("FS/FS", 0.1, 0.0003),
    },
    .parameters = apply,
};
