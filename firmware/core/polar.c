#include "core/polar.h"

#include "core/fixed.h"

#define ITERATIONS 5                             /* leave a tangent below 2^-4 for the series */
#define INVERSE_GAIN_Q31 INT32_C(1304914694)     /* product of cos(atan 2^-k) = 0.6076482563 */
#define THIRD_Q32 INT32_C(1431655765)            /* 1/3 */
#define FIFTH_Q31 INT32_C(429496730)             /* 1/5 */
#define EIGHTH_OF_INVERSE_PI_Q32 INT32_C(170891319) /* rad in Q34 to 2^32 a turn */

/* atan(2^-k), 2^32 = one turn. */
static const int32_t angle_table[ITERATIONS] = {536870912, 316933406, 167458907, 85004756, 42667331};

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

/* Range: |value| < 2^29 afterwards, by the choice of the shift. */
static int32_t shifted(int32_t value, int shift)
{
    return shift < 0 ? value >> -shift : value * (INT32_C(1) << shift);
}

/* Back again, rounded. Range: value < 2^29.6, so up to 2^32.6 before saturation. */
static int32_t unshifted(int32_t value, int shift)
{
    bool clamped = false;
    return shift > 0 ? (int32_t)fixed_round_shift(value, (unsigned)shift)
                     : fixed_saturate_i32((int64_t)value * (INT64_C(1) << -shift), &clamped);
}

static int32_t with_sign(int32_t value, int32_t sign)
{
    return (value ^ sign) - sign; /* sign is 0 or -1 */
}

/* y / x. Range: x in [2^28.7, 2^30.3), doubled if below 2^29 for the reciprocal; |y| <= 2^-4 x, so the quotient in Q60 is at most 2^56. */
static int32_t tangent_q34(int32_t x, int32_t y)
{
    int small = x < (INT32_C(1) << 29);
    int64_t quotient_q60 = (int64_t)y * fixed_reciprocal_q60((uint32_t)x << small) * (1 + small);
    return (int32_t)(quotient_q60 >> 26);
}

/* t - t^3/3 + t^5/5; left out: t^7/7 < 2^-30. Range: t^2 <= 2^-8, 2^28 in Q36; their product with 1/3 in Q36 < 2^26.5. */
static int32_t arctangent_i32(int32_t t_q34, int32_t t2_q36)
{
    int32_t bracket_q32 = THIRD_Q32 - (fixed_mul_high_floor(t2_q36, FIFTH_Q31) >> 3); /* 1/3 - t^2/5 */
    int32_t less_q36 = fixed_mul_high_floor(t2_q36, bracket_q32);
    int32_t angle_q34 = t_q34 - (fixed_mul_high_floor(t_q34, less_q36) >> 4);
    return fixed_mul_high(angle_q34, EIGHTH_OF_INVERSE_PI_Q32);
}

/* x sqrt(1 + t^2) = x (1 + t^2/2 - t^4/8); left out: t^6/16 < 4e-9. Range: x < 2^30.3, grows by 2^-9 at most. */
static int32_t length(int32_t x, int32_t t2_q36)
{
    int32_t more_q32 = (t2_q36 >> 5) - (fixed_mul_high_floor(t2_q36, t2_q36) >> 11);
    return x + fixed_mul_high_floor(x, more_q32);
}

/* Range: both parts are below 2^29, so the length is below 2^29.5 and grows by 1.6458 to below 2^30.3; each shift floors by less than
 * one unit, 2^-28 of the length. */
struct polar polar_from_complex(struct complex_q30 value)
{
    struct polar result = {0, 0};
    if (value.i_q30 == 0 && value.q_q30 == 0) {
        return result;
    }
    int shift = normalising_shift(value);
    int32_t half_turn = value.i_q30 < 0 ? -1 : 0; /* brings the vector into the right half plane */
    int32_t x = with_sign(shifted(value.i_q30, shift), half_turn);
    int32_t y = with_sign(shifted(value.q_q30, shift), half_turn);
    uint32_t angle = (uint32_t)half_turn << 31;
    for (unsigned k = 0; k < ITERATIONS; k++) {
        int32_t below = y < 0 ? -1 : 0;
        int32_t x_next = x + with_sign(y >> k, below);
        y -= with_sign(x >> k, below);
        x = x_next;
        angle += (uint32_t)with_sign(angle_table[k], below);
    }
    int32_t t_q34 = tangent_q34(x, y);
    int32_t t2_q36 = fixed_mul_high_floor(t_q34, t_q34);
    result.magnitude_q30 = unshifted(fixed_mul_q31(length(x, t2_q36), INVERSE_GAIN_Q31), shift);
    result.angle_i32 = (int32_t)(angle + (uint32_t)arctangent_i32(t_q34, t2_q36));
    return result;
}
