/* Functions of 4 x 4 matrices, stored by columns of two pairs. */
#ifndef SIM_MATRIX4_H
#define SIM_MATRIX4_H

#include "sim/pair.h"

struct matrix4 {
    pair column[4][2]; /* rows 0 and 1, rows 2 and 3 */
};

static inline double matrix4_get(const struct matrix4 *m, int row, int column)
{
    return m->column[column][row / 2][row % 2];
}

static inline void matrix4_set(struct matrix4 *m, int row, int column, double value)
{
    m->column[column][row / 2][row % 2] = value;
}

/* exponential = e^a and phi1 = (e^a - 1) / a = 1 + a/2! + a^2/3! + ..., to a few units in the last place for |a| below 1 and a unit
 * more per doubling of |a| above. The solution of y' = m y + b over a time h is e^(m h) y + h phi1(m h) b. */
void matrix4_exponential(const struct matrix4 *a, struct matrix4 *exponential, struct matrix4 *phi1);

#endif
