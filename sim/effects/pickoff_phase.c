/* The secondary pickoff's channel is slower than the primary's: a part of the quadrature is demodulated as rate. */
#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    p->path.pickoff_delay_s[1] += values[0] + values[1] * effect_shift_degc(now) + effect_curve(values + 2, now);
}

const struct effect effect_pickoff_phase = {
    .id = "pickoff_phase",
    .stage = EFFECT_STAGE_PICKOFF,
    .equation = "secondary is seen d + s t + curve later; phase error k times that",
    .appearance = "open loop: quadrature leaks into rate and rate into quadrature; closed loop it hides",
    .parameter = {
        {"delay_s", "s", EFFECT_STRENGTH, 0.0, -1.5e-5, 3e-5, 1e-7, "3 mrad at 5 kHz: unlike poles of two charge amplifiers"},
        {"slope_s_per_degc", "s/degC", EFFECT_STRENGTH, 0.0, -1e-7, 1e-7, 5e-10, "half a per cent of the delay per degC"},
        EFFECT_CURVE("s", 1e-05, 1e-08),
    },
    .parameters = apply,
};
