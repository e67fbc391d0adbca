/* Random numbers of the exam: SFC64 (64-bit chaotic counter generator) and a ziggurat of 128 layers for the normal distribution. */
#ifndef EXAM_RANDOM_H
#define EXAM_RANDOM_H

#include <math.h>
#include <stdint.h>

enum { EXAM_LAYERS = 128 };

struct exam_random {
    uint64_t a, b, c, counter;
};

struct exam_ziggurat {
    double edge[EXAM_LAYERS + 1]; /* right edge of each layer; [0] is that of the layer with the tail */
    double inside[EXAM_LAYERS];   /* part of a layer's width that lies under the curve over its whole height */
};

void exam_random_init(struct exam_random *random, uint64_t seed, uint64_t stream);
void exam_ziggurat_init(struct exam_ziggurat *ziggurat);

/* The rare cases: the tail, and the corner of a layer. Returns 0 when the point is refused. */
int exam_normal_rare(struct exam_random *random, const struct exam_ziggurat *ziggurat, uint32_t layer, double u, double *normal);

static inline uint64_t exam_random_bits(struct exam_random *random)
{
    uint64_t out = random->a + random->b + random->counter++;
    random->a = random->b ^ (random->b >> 11);
    random->b = random->c + (random->c << 3);
    random->c = ((random->c << 24) | (random->c >> 40)) + out;
    return out;
}

/* Mean 0, variance 1. Layer from the low 7 bits, place within it from the high 53. */
static inline double exam_normal(struct exam_random *random, const struct exam_ziggurat *ziggurat)
{
    for (;;) {
        uint64_t bits = exam_random_bits(random);
        uint32_t layer = (uint32_t)(bits & (EXAM_LAYERS - 1));
        double u = (double)((int64_t)bits >> 11) * 0x1p-52;
        double normal = u * ziggurat->edge[layer];
        if (fabs(u) < ziggurat->inside[layer] || exam_normal_rare(random, ziggurat, layer, u, &normal)) {
            return normal;
        }
    }
}

#endif
