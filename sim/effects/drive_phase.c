/* Forces come later than the firmware believes: amplifier and filter. The loop then holds the shell off its resonance. */
#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    p->path.force_delay_s += values[0] + values[1] * effect_shift_degc(now) + effect_curve(values + 2, now);
}

const struct effect effect_drive_phase = {
    .id = "drive_phase",
    .stage = EFFECT_STAGE_ACTUATION,
    .equation = "forces act d + s t + curve later; phase error k times that",
    .appearance = "drive frequency off by the phase error over 2 tau, level by its cosine; open loop nothing in quadrature, closed loop rate and quadrature mix",
    .parameter = {
        {"delay_s", "s", EFFECT_STRENGTH, 0.0, -1e-5, 1e-5, 3e-7, "an amplifier of 500 kHz; 10 mrad at 5 kHz"},
        {"slope_s_per_degc", "s/degC", EFFECT_STRENGTH, 0.0, -1e-7, 1e-7, 1e-9, "0.3 % of the delay per degC"},
        EFFECT_CURVE("s", 1e-05, 3e-08),
    },
    .parameters = apply,
};
