#include "sim/noise.h"

#include <math.h>
#include <stdbool.h>

#include "sim/elementary.h"

/* Where the base layer ends and the area of every layer, for 256 layers (Marsaglia and Tsang 2000; Doornik 2005). */
static const double base_end = 3.6541528853610088;
static const double layer_area = 0.00492867323399;

static double density(double x)
{
    return elementary_exp(-0.5 * x * x);
}

/* Layer 0 is the base with the tail: its rectangle is wider than base_end so that its area is the same. */
void noise_table_init(struct noise_table *table)
{
    double outer = layer_area / density(base_end);
    double inner = base_end;
    for (int i = 0; i < NOISE_LAYERS; i++) {
        table->layer[i].width = outer * 0x1p-52;
        table->layer[i].inner = inner;
        table->density[i] = density(outer);
        table->density[i + 1] = density(inner);
        outer = inner;
        double height = layer_area / outer + density(outer);
        inner = i < NOISE_LAYERS - 2 ? sqrt(-2.0 * elementary_log(height)) : 0.0;
    }
}

/* splitmix64 (Steele, Lea and Flood), the generator's recommended seeding. */
static uint64_t mix(uint64_t z)
{
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    return z ^ (z >> 31);
}

void noise_init(struct noise_state *state, uint64_t seed, uint32_t stream)
{
    const uint64_t golden = UINT64_C(0x9E3779B97F4A7C15);
    uint64_t start = mix(seed + golden) ^ mix(~(uint64_t)stream * golden);
    for (unsigned i = 0; i < 4; i++) {
        state->word[i] = mix(start + (i + 1) * golden);
    }
}

/* Beyond base_end: an exponential majorant, accepted with the ratio of the densities. */
static double tail(struct noise_state *state)
{
    double x, y;
    do {
        x = -elementary_log(noise_uniform(state)) / base_end;
        y = -elementary_log(noise_uniform(state));
    } while (y + y < x * x);
    return base_end + x;
}

/* The candidate lies in the corner of its layer that the curve cuts. */
static bool below_curve(const struct noise_table *table, struct noise_state *state, size_t layer, double x)
{
    double low = table->density[layer];
    double high = table->density[layer + 1];
    return low + noise_uniform(state) * (high - low) < density(x);
}

/* Draw until accepted, starting with one that was not accepted at once (about 1 in 80). */
static double __attribute__((noinline))
redraw(const struct noise_table *table, struct noise_state *state, size_t layer, double x)
{
    for (;;) {
        if (layer == 0) {
            return copysign(tail(state), x);
        }
        if (below_curve(table, state, layer, x)) {
            return x;
        }
        uint64_t bits = noise_next(state);
        layer = bits % NOISE_LAYERS;
        x = (double)((int64_t)bits >> 11) * table->layer[layer].width;
        if (fabs(x) < table->layer[layer].inner) {
            return x;
        }
    }
}

void noise_gaussian(const struct noise_table *table, struct noise_state *state, size_t n, double *values)
{
    struct noise_state local = *state;
    for (size_t i = 0; i < n; i++) {
        uint64_t bits = noise_next(&local);
        size_t layer = bits % NOISE_LAYERS;
        double x = (double)((int64_t)bits >> 11) * table->layer[layer].width;
        if (fabs(x) >= table->layer[layer].inner) {
            *state = local;
            x = redraw(table, state, layer, x);
            local = *state;
        }
        values[i] = x;
    }
    *state = local;
}
