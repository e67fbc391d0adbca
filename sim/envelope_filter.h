/* The firmware's output filter over any number of slow ticks at once, exactly, for an input that is a parabola in time. */
#ifndef SIM_ENVELOPE_FILTER_H
#define SIM_ENVELOPE_FILTER_H

#include <stdint.h>

#include "sim/span.h"

#define ENVELOPE_FILTER_STATES 4

struct envelope_filter_state {
    double s[ENVELOPE_FILTER_STATES];
};

/* Rows: new states, then the mean output; columns: old states, then start, mean and end of the input. */
struct envelope_filter_map {
    double row[ENVELOPE_FILTER_STATES + 1][ENVELOPE_FILTER_STATES + 3];
    int none; /* no filter: the mean output is the mean input */
};

/* choice: enum output_filter */
void envelope_filter_build(uint32_t choice, uint32_t ticks, struct envelope_filter_map *map);

/* State that a constant input leaves after a long time. */
void envelope_filter_settle(uint32_t choice, double input, struct envelope_filter_state *state);

static inline double envelope_filter_step(const struct envelope_filter_map *map, struct envelope_filter_state *state, struct span input)
{
    if (map->none) {
        return input.mean;
    }
    double result[ENVELOPE_FILTER_STATES + 1];
    for (int i = 0; i <= ENVELOPE_FILTER_STATES; i++) {
        const double *row = map->row[i];
        result[i] = ((row[0] * state->s[0] + row[1] * state->s[1]) + (row[2] * state->s[2] + row[3] * state->s[3]))
                    + (row[4] * input.start + row[5] * input.mean + row[6] * input.end);
    }
    for (int i = 0; i < ENVELOPE_FILTER_STATES; i++) {
        state->s[i] = result[i];
    }
    return result[ENVELOPE_FILTER_STATES];
}

#endif
