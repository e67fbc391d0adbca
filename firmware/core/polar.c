#include "core/polar.h"

#include "core/fixed.h"

#define ITERATIONS 14                            /* leaves an angle below 2^-13, finished by its tangent: error 2^-40 */
#define INVERSE_GAIN_Q31 INT32_C(1304065751) /* product of cos(atan 2^-k) = 0.6072529365 */
#define INVERSE_PI_Q31 INT32_C(683565276)

/* atan(2^-k), 2^32 = one turn. */
static const int32_t angle_table[ITERATIONS] = {
    536870912, 316933406, 167458907, 85004756, 42667331, 21354465, 10679838, 5340245,
    2670163, 1335087, 667544, 333772, 166886, 83443,
};

static uint32_t absolute(int32_t value)
{
    return value < 0 ? 0u - (uint32_t)value : (uint32_t)value;
}

/* Left shift that brings the larger part into [2^28, 2^29); negative: right. Range: -3 .. 28 for parts that are not both zero. */
static int normalising_shift(struct complex_q30 value)
{
    uint32_t i = absolute(value.i_q30), q = absolute(value.q_q30);
    uint32_t larger = i > q ? i : q;
    int shift = 0;
    for (; larger >= UINT32_C(1) << 29; larger >>= 1) {
        shift--;
    }
    for (; larger < UINT32_C(1) << 28; larger <<= 1) {
        shift++;
    }
    return shift;
}

static int64_t shifted(int64_t value, int shift)
{
    return shift < 0 ? value >> -shift : value * (INT64_C(1) << shift);
}

static int32_t with_sign(int32_t value, int32_t sign)
{
    return (value ^ sign) - sign; /* sign is 0 or -1 */
}

/* Tangent of what is left, as an angle. Range: x in [2^28.7, 2^30.3), doubled if below 2^29 for the reciprocal; |y| < 2^-13 x + 2^5, so the
 * quotient in Q60 is below 2^47.1 and in Q31 below 2^18.1. */
static int32_t small_angle_i32(int32_t x, int32_t y)
{
    int small = x < (INT32_C(1) << 29);
    int64_t quotient_q60 = (int64_t)y * fixed_reciprocal_q60((uint32_t)x << small) * (1 + small);
    return fixed_mul_q31((int32_t)(quotient_q60 >> 29), INVERSE_PI_Q31);
}

/* Range: both parts are below 2^29, so the length is below 2^29.5 and grows by 1.6468 to below 2^30.3; each of the shifts floors by
 * less than one unit of at most 2^-28 of the length, 14 times: 5e-8 rad in the worst case. */
struct polar polar_from_complex(struct complex_q30 value)
{
    struct polar result = {0, 0};
    if (value.i_q30 == 0 && value.q_q30 == 0) {
        return result;
    }
    int shift = normalising_shift(value);
    int32_t half_turn = value.i_q30 < 0 ? -1 : 0; /* brings the vector into the right half plane */
    int32_t x = with_sign((int32_t)shifted(value.i_q30, shift), half_turn);
    int32_t y = with_sign((int32_t)shifted(value.q_q30, shift), half_turn);
    uint32_t angle = (uint32_t)half_turn << 31;
    for (unsigned k = 0; k < ITERATIONS; k++) {
        int32_t below = y < 0 ? -1 : 0;
        int32_t x_next = x + with_sign(y >> k, below);
        y -= with_sign(x >> k, below);
        x = x_next;
        angle += (uint32_t)with_sign(angle_table[k], below);
    }
    bool clamped = false;
    int64_t magnitude = fixed_mul_q31(x, INVERSE_GAIN_Q31);
    magnitude = shift > 0 ? fixed_round_shift(magnitude, (unsigned)shift) : shifted(magnitude, -shift);
    result.magnitude_q30 = fixed_saturate_i32(magnitude, &clamped);
    result.angle_i32 = (int32_t)(angle + (uint32_t)small_angle_i32(x, y));
    return result;
}
