#include "sim/linear_map.h"

#include <math.h>
#include <string.h>

/* States, and for every input its parabola p0 + p1 s + p2 s^2 over the step, 0 <= s <= 1, as three more states. */
#define SIZE (LINEAR_STATES + 3 * LINEAR_INPUTS)

struct square {
    double at[SIZE][SIZE];
};

static struct square product(const struct square *a, const struct square *b)
{
    struct square c = {0};
    for (int i = 0; i < SIZE; i++) {
        for (int k = 0; k < SIZE; k++) {
            double factor = a->at[i][k];
            for (int j = 0; factor != 0.0 && j < SIZE; j++) {
                c.at[i][j] += factor * b->at[k][j];
            }
        }
    }
    return c;
}

static struct square sum(const struct square *a, double factor, double identity)
{
    struct square c = *a;
    for (int i = 0; i < SIZE; i++) {
        for (int j = 0; j < SIZE; j++) {
            c.at[i][j] *= factor;
        }
        c.at[i][i] += identity;
    }
    return c;
}

static double norm(const struct square *a)
{
    double largest = 0.0;
    for (int i = 0; i < SIZE; i++) {
        double row = 0.0;
        for (int j = 0; j < SIZE; j++) {
            row += fabs(a->at[i][j]);
        }
        largest = row > largest ? row : largest;
    }
    return largest;
}

/* e^a and its mean over the step, (e^a - 1)/a = sum of a^k / (k+1)!: Horner to order 18 at |a| <= 1/2, then doubling. */
static void exponential_and_mean(const struct square *a, struct square *exponential, struct square *mean)
{
    int doublings = 0;
    double factor = 1.0;
    for (double size = norm(a); size * factor > 0.5; doublings++) {
        factor *= 0.5;
    }
    struct square scaled = sum(a, factor, 0.0);
    struct square zero = {0};
    *mean = sum(&zero, 0.0, 1.0);
    for (int order = 18; order >= 2; order--) {
        struct square next = product(&scaled, mean);
        *mean = sum(&next, 1.0 / order, 1.0);
    }
    struct square grown = product(&scaled, mean);
    *exponential = sum(&grown, 1.0, 1.0);
    for (; doublings > 0; doublings--) {
        struct square half = sum(exponential, 0.5, 0.5);
        *mean = product(mean, &half);
        *exponential = product(exponential, exponential);
    }
}

static struct square augmented(const struct linear_system *system, double duration_s)
{
    struct square a = {0};
    for (int i = 0; i < system->states; i++) {
        for (int j = 0; j < system->states; j++) {
            a.at[i][j] = duration_s * system->m[i][j];
        }
        for (int k = 0; k < system->inputs; k++) {
            a.at[i][LINEAR_STATES + 3 * k] = duration_s * system->b[i][k];
        }
    }
    for (int k = 0; k < system->inputs; k++) { /* p0' = p1, p1' = 2 p2 */
        int p0 = LINEAR_STATES + 3 * k;
        a.at[p0][p0 + 1] = 1.0;
        a.at[p0 + 1][p0 + 2] = 2.0;
    }
    return a;
}

/* p0 = start, p1 = 6 mean - 4 start - 2 end, p2 = 3 start + 3 end - 6 mean */
static void fold_parabolas(const struct linear_system *system, const struct square *from, int first, struct linear_map *map)
{
    for (int i = 0; i < system->states; i++) {
        double *row = map->row[first + i];
        memcpy(row, from->at[i], LINEAR_STATES * sizeof *row);
        for (int k = 0; k < system->inputs; k++) {
            const double *p = from->at[i] + LINEAR_STATES + 3 * k;
            double *out = row + LINEAR_STATES + 3 * k;
            out[0] = p[0] - 4.0 * p[1] + 3.0 * p[2];
            out[1] = 6.0 * (p[1] - p[2]);
            out[2] = 3.0 * p[2] - 2.0 * p[1];
        }
    }
}

void linear_map_build(const struct linear_system *system, double duration_s, struct linear_map *map)
{
    struct square exponential, mean;
    struct square a = augmented(system, duration_s);
    exponential_and_mean(&a, &exponential, &mean);
    memset(map, 0, sizeof *map);
    fold_parabolas(system, &exponential, 0, map);
    fold_parabolas(system, &mean, LINEAR_STATES, map);
}
