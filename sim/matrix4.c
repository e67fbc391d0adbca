#include "sim/matrix4.h"

#include <math.h>

static inline struct matrix4 product(const struct matrix4 *a, const struct matrix4 *b)
{
    struct matrix4 result;
    for (int j = 0; j < 4; j++) {
        pair b0 = pair_of(b->column[j][0][0]);
        pair b1 = pair_of(b->column[j][0][1]);
        pair b2 = pair_of(b->column[j][1][0]);
        pair b3 = pair_of(b->column[j][1][1]);
        for (int half = 0; half < 2; half++) {
            result.column[j][half] = (a->column[0][half] * b0 + a->column[1][half] * b1)
                                     + (a->column[2][half] * b2 + a->column[3][half] * b3);
        }
    }
    return result;
}

static inline struct matrix4 times(const struct matrix4 *a, double factor)
{
    struct matrix4 result;
    for (int j = 0; j < 4; j++) {
        result.column[j][0] = a->column[j][0] * pair_of(factor);
        result.column[j][1] = a->column[j][1] * pair_of(factor);
    }
    return result;
}

static inline void add_identity(struct matrix4 *m, double factor)
{
    m->column[0][0] += (pair){factor, 0.0};
    m->column[1][0] += (pair){0.0, factor};
    m->column[2][1] += (pair){factor, 0.0};
    m->column[3][1] += (pair){0.0, factor};
}

/* 1/(k+1)!, k = 0 .. 15 */
static const double inverse_factorial[16] = {
    1.0, 1.0 / 2, 1.0 / 6, 1.0 / 24, 1.0 / 120, 1.0 / 720, 1.0 / 5040, 1.0 / 40320, 1.0 / 362880, 1.0 / 3628800, 1.0 / 39916800,
    1.0 / 479001600, 1.0 / 6227020800, 1.0 / 87178291200, 1.0 / 1307674368000, 1.0 / 20922789888000,
};

/* sum += c[0] + c[1] a + c[2] a2 + c[3] a3 */
static inline void add_cubic(const double c[4], const struct matrix4 *a, const struct matrix4 *a2, const struct matrix4 *a3,
                             struct matrix4 *sum)
{
    for (int j = 0; j < 4; j++) {
        for (int half = 0; half < 2; half++) {
            sum->column[j][half] += a->column[j][half] * pair_of(c[1])
                                    + (a2->column[j][half] * pair_of(c[2]) + a3->column[j][half] * pair_of(c[3]));
        }
    }
    add_identity(sum, c[0]);
}

/* Taylor polynomial of degree 15 in six products (Paterson and Stockmeyer); remainder |a|^16 / 17!, 3e-15 at |a| = 1. */
static inline void short_exponential(const struct matrix4 *a, struct matrix4 *exponential, struct matrix4 *phi1)
{
    struct matrix4 a2 = product(a, a);
    struct matrix4 a3 = product(a, &a2);
    struct matrix4 a4 = product(&a2, &a2);
    struct matrix4 sum = times(a, 0.0);
    add_cubic(inverse_factorial + 12, a, &a2, &a3, &sum);
    for (int i = 8; i >= 0; i -= 4) {
        sum = product(&a4, &sum);
        add_cubic(inverse_factorial + i, a, &a2, &a3, &sum);
    }
    *phi1 = sum;
    *exponential = product(a, &sum);
    add_identity(exponential, 1.0);
}

/* Largest sum of magnitudes in a column. */
static inline double norm(const struct matrix4 *a)
{
    double largest = 0.0;
    for (int j = 0; j < 4; j++) {
        double sum = (fabs(a->column[j][0][0]) + fabs(a->column[j][0][1])) + (fabs(a->column[j][1][0]) + fabs(a->column[j][1][1]));
        largest = sum > largest ? sum : largest;
    }
    return largest;
}

/* phi1(2a) = phi1(a) (e^a + 1) / 2, e^(2a) = (e^a)^2 */
static void double_argument(struct matrix4 *exponential, struct matrix4 *phi1)
{
    struct matrix4 half_sum = times(exponential, 0.5);
    add_identity(&half_sum, 0.5);
    *phi1 = product(phi1, &half_sum);
    *exponential = product(exponential, exponential);
}

static void long_exponential(const struct matrix4 *a, double size, struct matrix4 *exponential, struct matrix4 *phi1)
{
    int doublings = 0;
    double factor = 1.0;
    for (; size * factor > 1.0 && doublings < 60; doublings++) {
        factor *= 0.5;
    }
    struct matrix4 scaled = times(a, factor);
    short_exponential(&scaled, exponential, phi1);
    for (; doublings > 0; doublings--) {
        double_argument(exponential, phi1);
    }
}

void matrix4_exponential(const struct matrix4 *a, struct matrix4 *exponential, struct matrix4 *phi1)
{
    double size = norm(a);
    if (size > 1.0) {
        long_exponential(a, size, exponential, phi1);
    } else {
        short_exponential(a, exponential, phi1);
    }
}
