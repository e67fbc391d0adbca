#include "core/output_filter.h"

#include "core/fixed.h"

#define GUARD (INT64_C(1) << 29) /* the signal has 29 more fractional bits than its 32-bit form */

/* x c / 2^32 for |x| < 2^62: with c in Q29, an eighth of their product. */
static int64_t eighth(int64_t value, int32_t coef_q29)
{
    struct fixed_words x = fixed_words(value);
    return (int64_t)x.high * coef_q29 + fixed_mul_high_floor(x.low, coef_q29);
}

/* Transposed: y = b x + next, next <- 2 b x - a1 y + after, after <- b x - a2 y, sums in eighths. Even the input that suits it best drives a
 * section to 1.06 times full scale at most (the sum of its response's magnitudes), so |y| stays below 2^60.1, b x below 2^57.3 / 8 and the sums
 * below 2^62 / 8. */
static int64_t section_step(const struct output_filter_section *section, struct output_filter_memory *memory, int64_t x)
{
    int64_t feed = eighth(x, section->gain_q29);
    int64_t y = (feed + memory->next) * 8;
    memory->next = memory->after + 2 * feed - eighth(y, section->a1_q29);
    memory->after = feed - eighth(y, section->a2_q29);
    return y;
}

/* As if the value had been there forever. */
static void hold(const struct output_filter_section *section, struct output_filter_memory *memory, int64_t value)
{
    int64_t feed = eighth(value, section->gain_q29);
    memory->next = value / 8 - feed;
    memory->after = feed - eighth(value, section->a2_q29);
}

void output_filter_reset(struct output_filter_state *state, int32_t value)
{
    *state = (struct output_filter_state){.last = value, .choice = OUTPUT_FILTER_NONE};
}

static void choose(struct output_filter_state *state, uint32_t choice)
{
    for (unsigned k = 0; k < OUTPUT_FILTER_SECTIONS; k++) {
        hold(&output_filter_table[choice][k], &state->memory[k], (int64_t)state->last * GUARD);
    }
    state->choice = choice;
}

int32_t output_filter_step(uint32_t choice, struct output_filter_state *state, int32_t value, bool *overflow)
{
    if (choice == OUTPUT_FILTER_NONE || choice >= OUTPUT_FILTER_COUNT) {
        output_filter_reset(state, value);
        return value;
    }
    if (choice != state->choice) {
        choose(state, choice);
    }
    int64_t signal = (int64_t)value * GUARD;
    for (unsigned k = 0; k < OUTPUT_FILTER_SECTIONS; k++) {
        signal = section_step(&output_filter_table[choice][k], &state->memory[k], signal);
    }
    state->last = fixed_saturate_i32(fixed_round_shift(signal, 29), overflow);
    return state->last;
}
