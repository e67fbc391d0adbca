#include "core/polar.h"

#include "core/fixed.h"

#define ITERATIONS 26
#define INVERSE_GAIN_Q31 INT32_C(1304065748) /* product of cos(atan 2^-k) = 0.6072529350 */

/* atan(2^-k), 2^32 = one turn. */
static const int32_t angle_table[ITERATIONS] = {
    536870912, 316933406, 167458907, 85004756, 42667331, 21354465, 10679838, 5340245, 2670163, 1335087, 667544, 333772, 166886,
    83443,     41722,     20861,     10430,    5215,     2608,     1304,     652,      326,     163,     81,      41,     20,
};

static int64_t magnitude_of(int64_t value)
{
    return value < 0 ? -value : value;
}

/* Range: the vector is scaled so that its larger part lies in [2^39, 2^40]; its length then is below 2^40.5 and grows by 1.6468 to
 * below 2^41.3. Truncation of the shifts adds at most ITERATIONS units of 2^-40. */
struct polar polar_from_complex(struct complex_q30 value)
{
    struct polar result = {0, 0};
    int64_t x = value.i_q30;
    int64_t y = value.q_q30;
    int64_t larger = magnitude_of(x) > magnitude_of(y) ? magnitude_of(x) : magnitude_of(y);
    if (larger == 0) {
        return result;
    }
    unsigned scale = 0;
    while ((larger << scale) < (INT64_C(1) << 39)) {
        scale++;
    }
    uint32_t angle = 0;
    if (x < 0) { /* half a turn brings the vector into the right half plane */
        x = -x;
        y = -y;
        angle = UINT32_C(0x80000000);
    }
    x *= INT64_C(1) << scale;
    y *= INT64_C(1) << scale;
    for (unsigned k = 0; k < ITERATIONS; k++) {
        int64_t direction = y < 0 ? -1 : 1;
        int64_t x_next = x + direction * (y >> k);
        y -= direction * (x >> k);
        x = x_next;
        angle += (uint32_t)(direction * angle_table[k]);
    }
    bool clamped = false;
    result.magnitude_q30 = fixed_saturate_i32(fixed_round_shift(fixed_mul_i64_q31(x, INVERSE_GAIN_Q31), scale), &clamped);
    result.angle_i32 = (int32_t)angle;
    return result;
}
