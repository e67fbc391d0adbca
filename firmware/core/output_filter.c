#include "core/output_filter.h"

#include "core/fixed.h"

#define GUARD 65536 /* states carry 16 more fractional bits than the signal */

/* x c / 2^29 for |x| < 2^50 and |c| <= 2^30: as 4 x times c / 2^31, |4 x| < 2^52, at most 2^51. */
static int64_t scale_q29(int64_t value, int32_t coef_q29)
{
    return fixed_mul_i64_q31(value * 4, coef_q29);
}

/* Even the input that suits it best drives a section to 1.06 times full scale at most (the sum of its response's magnitudes), so states
 * stay below 2^47.1; inputs are summed to 4 x 2^47.1 < 2^49.2. */
static int64_t section_step(const struct output_filter_section *section, struct output_filter_state *state, unsigned k, int64_t x)
{
    int64_t feed = scale_q29(x + 2 * state->x1[k] + state->x2[k], section->gain_q29);
    int64_t y = feed - scale_q29(state->y1[k], section->a1_q29) - scale_q29(state->y2[k], section->a2_q29);
    state->x2[k] = state->x1[k];
    state->x1[k] = x;
    state->y2[k] = state->y1[k];
    state->y1[k] = y;
    return y;
}

void output_filter_reset(struct output_filter_state *state, int32_t value)
{
    int64_t held = (int64_t)value * GUARD;
    for (unsigned k = 0; k < OUTPUT_FILTER_SECTIONS; k++) {
        state->x1[k] = state->x2[k] = state->y1[k] = state->y2[k] = held;
    }
}

int32_t output_filter_step(uint32_t choice, struct output_filter_state *state, int32_t value, bool *overflow)
{
    if (choice == OUTPUT_FILTER_NONE || choice >= OUTPUT_FILTER_COUNT) {
        output_filter_reset(state, value);
        return value;
    }
    int64_t signal = (int64_t)value * GUARD;
    for (unsigned k = 0; k < OUTPUT_FILTER_SECTIONS; k++) {
        signal = section_step(&output_filter_table[choice][k], state, k, signal);
    }
    return fixed_saturate_i32(fixed_round_shift(signal, 16), overflow);
}
