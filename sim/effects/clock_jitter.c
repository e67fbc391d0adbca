/* Samples are taken a little early or late, independently of each other: noise in proportion to the velocity. */
#include "sim/effects/effect.h"

static void pickoff(const double *values, const struct effect_context *now, uint64_t sample, const double velocity_fs_s[2],
                    double displacement_fs[2])
{
    double late_s = values[0] * effect_noise(now->seed, 18, sample);
    displacement_fs[0] += velocity_fs_s[0] * late_s;
    displacement_fs[1] += velocity_fs_s[1] * late_s;
}

const struct effect effect_clock_jitter = {
    .id = "clock_jitter",
    .stage = EFFECT_STAGE_CLOCK,
    .equation = "x(t) -> x(t) + x'(t) d, d white, the same for both channels",
    .appearance = "noise of the primary's quadrature in proportion to its amplitude; of the secondary hardly any",
    .parameter = {
        {"jitter_s", "s rms", EFFECT_STRENGTH, 0.0, 0.0, 1e-5, 3e-9, "a clock from a noisy PLL: 30 times a quartz; a tenth of the converter's noise at 5 kHz"},
    },
    .pickoff = pickoff,
};
