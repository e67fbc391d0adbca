#include "sim/envelope_filter.h"

#include <math.h>
#include <string.h>

#include "core/output_filter.h"

/* One slow tick of both sections, in the transposed form with two states each. */
static double tick(uint32_t choice, double *s, double x)
{
    for (int k = 0; k < OUTPUT_FILTER_SECTIONS; k++) {
        const struct output_filter_section *section = &output_filter_table[choice][k];
        double b = ldexp(section->gain_q29, -29);
        double y = b * x + s[2 * k];
        s[2 * k] = 2.0 * b * x - ldexp(section->a1_q29, -29) * y + s[2 * k + 1];
        s[2 * k + 1] = b * x - ldexp(section->a2_q29, -29) * y;
        x = y;
    }
    return x;
}

/* The firmware filters means over slow ticks. */
static double mean_of_tick(const double p[3], uint32_t i, uint32_t ticks)
{
    double s = (i + 0.5) / ticks;
    return p[0] + s * (p[1] + s * p[2]) + p[2] / (12.0 * ticks * ticks);
}

/* One column: what a unit of one state, or of one of start, mean and end, becomes. */
static void run_column(uint32_t choice, uint32_t ticks, int column, struct envelope_filter_map *map)
{
    static const double parabola[3][3] = {{1.0, -4.0, 3.0}, {0.0, 6.0, -6.0}, {0.0, -2.0, 3.0}};
    static const double zero[3] = {0.0, 0.0, 0.0};
    const double *p = column < ENVELOPE_FILTER_STATES ? zero : parabola[column - ENVELOPE_FILTER_STATES];
    double s[ENVELOPE_FILTER_STATES] = {0.0};
    double sum = 0.0;
    if (column < ENVELOPE_FILTER_STATES) {
        s[column] = 1.0;
    }
    for (uint32_t i = 0; i < ticks; i++) {
        sum += tick(choice, s, mean_of_tick(p, i, ticks));
    }
    for (int i = 0; i < ENVELOPE_FILTER_STATES; i++) {
        map->row[i][column] = s[i];
    }
    map->row[ENVELOPE_FILTER_STATES][column] = sum / ticks;
}

void envelope_filter_build(uint32_t choice, uint32_t ticks, struct envelope_filter_map *map)
{
    memset(map, 0, sizeof *map);
    map->none = choice == OUTPUT_FILTER_NONE || choice >= OUTPUT_FILTER_COUNT;
    for (int column = 0; !map->none && column < ENVELOPE_FILTER_STATES + 3; column++) {
        run_column(choice, ticks, column, map);
    }
}

void envelope_filter_settle(uint32_t choice, double input, struct envelope_filter_state *state)
{
    memset(state, 0, sizeof *state);
    for (int i = 0; i < 2000 && choice != OUTPUT_FILTER_NONE && choice < OUTPUT_FILTER_COUNT; i++) {
        tick(choice, state->s, input);
    }
}
