/* Small linear systems x' = M x + B u over one step, exactly, for inputs that are parabolas in time: new state and mean state. */
#ifndef SIM_LINEAR_MAP_H
#define SIM_LINEAR_MAP_H

#include "sim/span.h"

#define LINEAR_STATES 4
#define LINEAR_INPUTS 2

/* What a caller fills: states and inputs actually used, M in 1/s, B. */
struct linear_system {
    int states, inputs;
    double m[LINEAR_STATES][LINEAR_STATES];
    double b[LINEAR_STATES][LINEAR_INPUTS];
};

/* Rows: new states, then mean states; columns: old states, then start, mean, end of each input. */
struct linear_map {
    double row[2 * LINEAR_STATES][LINEAR_STATES + 3 * LINEAR_INPUTS];
};

/* Some microseconds: by a matrix exponential with scaling and squaring, good to 1e-12 for |M| duration up to some hundreds. */
void linear_map_build(const struct linear_system *system, double duration_s, struct linear_map *map);

/* One step of a system of `states` and `inputs`, which should be constants of the caller. */
static inline void linear_map_step(const struct linear_map *map, int states, int inputs, double *state, const struct span *input,
                                   double *mean)
{
    double next[LINEAR_STATES];
    for (int i = 0; i < states; i++) {
        double sum = 0.0;
        double sum_mean = 0.0;
        for (int j = 0; j < states; j++) {
            sum += map->row[i][j] * state[j];
            sum_mean += map->row[LINEAR_STATES + i][j] * state[j];
        }
        for (int k = 0; k < inputs; k++) {
            const double *by = map->row[i] + LINEAR_STATES + 3 * k;
            const double *by_mean = map->row[LINEAR_STATES + i] + LINEAR_STATES + 3 * k;
            sum += by[0] * input[k].start + by[1] * input[k].mean + by[2] * input[k].end;
            sum_mean += by_mean[0] * input[k].start + by_mean[1] * input[k].mean + by_mean[2] * input[k].end;
        }
        next[i] = sum;
        mean[i] = sum_mean;
    }
    for (int i = 0; i < states; i++) {
        state[i] = next[i];
    }
}

#endif
