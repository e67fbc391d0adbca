#include "exam/random.h"

/* Marsaglia and Tsang's constants for 128 layers of equal area (J. Statistical Software 5, 2000). */
#define TAIL 3.442619855899
#define AREA 9.91256303526217e-3

static double density(double x)
{
    return exp(-0.5 * x * x);
}

/* (0, 1): never 0, so its logarithm exists. */
static double uniform(struct exam_random *random)
{
    return ((double)(exam_random_bits(random) >> 12) + 0.5) * 0x1p-52;
}

void exam_random_init(struct exam_random *random, uint64_t seed, uint64_t stream)
{
    *random = (struct exam_random){seed, stream, UINT64_C(0x9E3779B97F4A7C15) * (stream + 1), 1};
    for (int i = 0; i < 16; i++) {
        (void)exam_random_bits(random);
    }
}

void exam_ziggurat_init(struct exam_ziggurat *ziggurat)
{
    double *edge = ziggurat->edge;
    edge[0] = AREA / density(TAIL);
    edge[1] = TAIL;
    for (int i = 2; i < EXAM_LAYERS; i++) {
        edge[i] = sqrt(-2.0 * log(AREA / edge[i - 1] + density(edge[i - 1])));
    }
    edge[EXAM_LAYERS] = 0.0;
    for (int i = 0; i < EXAM_LAYERS; i++) {
        ziggurat->inside[i] = edge[i + 1] / edge[i];
    }
}

static double tail(struct exam_random *random)
{
    double x, y;
    do {
        x = -log(uniform(random)) / TAIL;
        y = -log(uniform(random));
    } while (2.0 * y < x * x);
    return TAIL + x;
}

int exam_normal_rare(struct exam_random *random, const struct exam_ziggurat *ziggurat, uint32_t layer, double u, double *normal)
{
    if (layer == 0) {
        *normal = copysign(tail(random), u);
        return 1;
    }
    double x = u * ziggurat->edge[layer];
    double low = density(ziggurat->edge[layer]), high = density(ziggurat->edge[layer + 1]);
    *normal = x;
    return low + uniform(random) * (high - low) < density(x);
}
