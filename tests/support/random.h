/* Random numbers for tests: one generator, its seed printed and settable (environment variable WINEGLASS_SEED). */
#ifndef SUPPORT_RANDOM_H
#define SUPPORT_RANDOM_H

#include <stdint.h>

struct random_state {
    uint64_t counter;
};

/* Seed from WINEGLASS_SEED, else the given one; printed so that a failure can be repeated. */
struct random_state random_begin(const char *test, uint64_t default_seed);

uint64_t random_u64(struct random_state *state);
int32_t random_i32(struct random_state *state);

/* Any bit width with equal chance: small numbers, large ones and the extremes all occur. */
int32_t random_wide_i32(struct random_state *state);

double random_uniform(struct random_state *state, double low, double high);
double random_gauss(struct random_state *state);

#endif
