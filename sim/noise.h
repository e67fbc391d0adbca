/* Random numbers: xoshiro256++ (Blackman and Vigna) and Gaussian numbers by the ziggurat method (Marsaglia and Tsang) with 256 layers. */
#ifndef SIM_NOISE_H
#define SIM_NOISE_H

#include <stddef.h>
#include <stdint.h>

#define NOISE_LAYERS 256

/* One stream; streams of the same seed are independent. */
struct noise_state {
    uint64_t word[4];
};

/* Layers of equal area under exp(-x^2/2). Shared by all streams. */
struct noise_table {
    struct {
        double width; /* x of a candidate per unit of its 53-bit integer */
        double inner; /* below this |x| the candidate lies under the curve */
    } layer[NOISE_LAYERS];
    double density[NOISE_LAYERS + 1]; /* exp(-x^2/2) at the outer edge of layer i, which is the inner edge of layer i - 1 */
};

void noise_table_init(struct noise_table *table);

void noise_init(struct noise_state *state, uint64_t seed, uint32_t stream);

static inline uint64_t noise_rotate(uint64_t x, int bits)
{
    return (x << bits) | (x >> (64 - bits));
}

static inline uint64_t noise_next(struct noise_state *state)
{
    uint64_t *s = state->word;
    uint64_t result = noise_rotate(s[0] + s[3], 23) + s[0];
    uint64_t shifted = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= shifted;
    s[3] = noise_rotate(s[3], 45);
    return result;
}

/* Uniform in (0, 1), 53 bit. */
static inline double noise_uniform(struct noise_state *state)
{
    return ((double)(int64_t)(noise_next(state) >> 11) + 0.5) * 0x1p-53;
}

/* Standard Gaussian numbers. */
void noise_gaussian(const struct noise_table *table, struct noise_state *state, size_t n, double *values);

#endif
