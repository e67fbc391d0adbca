#include "support/random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

struct random_state random_begin(const char *test, uint64_t default_seed)
{
    const char *text = getenv("WINEGLASS_SEED");
    struct random_state state = {text != NULL ? strtoull(text, NULL, 0) : default_seed};
    printf("%s: WINEGLASS_SEED=%llu\n", test, (unsigned long long)state.counter);
    return state;
}

/* A counter through the finaliser of splitmix64. */
uint64_t random_u64(struct random_state *state)
{
    state->counter += UINT64_C(0x9E3779B97F4A7C15);
    uint64_t x = state->counter;
    x = (x ^ (x >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    x = (x ^ (x >> 27)) * UINT64_C(0x94D049BB133111EB);
    return x ^ (x >> 31);
}

int32_t random_i32(struct random_state *state)
{
    return (int32_t)(uint32_t)(random_u64(state) >> 32);
}

int32_t random_wide_i32(struct random_state *state)
{
    static const int32_t extremes[] = {INT32_MIN, INT32_MIN + 1, -1, 0, 1, INT32_MAX - 1, INT32_MAX};
    uint64_t choice = random_u64(state);
    if ((choice & 15) == 0) {
        return extremes[(choice >> 4) % (sizeof extremes / sizeof extremes[0])];
    }
    return random_i32(state) >> ((choice >> 4) & 31);
}

double random_uniform(struct random_state *state, double low, double high)
{
    return low + (high - low) * (double)(random_u64(state) >> 11) * 0x1p-53;
}

double random_gauss(struct random_state *state)
{
    double u = (double)((random_u64(state) >> 11) + 1) * 0x1p-53;
    double v = random_uniform(state, 0.0, 8.0 * atan(1.0));
    return sqrt(-2.0 * log(u)) * cos(v);
}
