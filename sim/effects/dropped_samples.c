/* The device misses a sample now and then, or gets one twice: its clock and the shell's part by a sample's phase. */
#include "sim/effects/effect.h"

#define CLOSEST 2 /* samples: where every one is lost there is no recording */

/* Losses at whole multiples of the distance. */
static int32_t lost(const double *values, uint64_t first, uint64_t last)
{
    uint64_t distance = values[0] < CLOSEST ? CLOSEST : (uint64_t)(values[0] + 0.5);
    uint64_t before = first > 0 ? (first - 1) / distance : 0;
    int32_t count = (int32_t)(last / distance - before);
    return values[1] > 0.5 ? -count : count;
}

const struct effect effect_dropped_samples = {
    .id = "dropped_samples",
    .stage = EFFECT_STAGE_CLOCK,
    .equation = "every n-th sample is lost (or doubled): phase of the shell against the oscillator +- k/fs",
    .appearance = "jolts of frequency, level and, closed loop, of the rebalance forces, together with gaps of the counter",
    .parameter = {
        {"distance_samples", "sample", EFFECT_STRENGTH, 0.0, 0.0, 1e9, 100000.0, "an interrupt that comes too late every two seconds"},
        {"doubled", "1", EFFECT_SHAPE, 0.0, 0.0, 1.0, 1.0, "0: lost, 1: doubled"},
    },
    .lost = lost,
};
