#include "core/polar.h"

#include "core/fixed.h"
#include "core/oscillator.h"

#define OCTANT_AT_TANGENT_Q12 88318u     /* angle in steps of the oscillator's table, 0 .. 16, is t (21.562 - 5.5625 t) to 0.08 of a step */
#define OCTANT_CURVATURE_Q4 89u
#define THIRD_Q32 INT32_C(1431655765)    /* 1/3 */
#define RAD_TO_TURNS INT32_C(683565276)  /* 2^32 / 2 pi */

/* A vector in the first octant, the larger part within [2^29, 2^30). */
struct folded {
    uint32_t x, y;
};

/* A vector turned to within 0.0285 rad of the axis: x as it is, y with five more bits. */
struct turned {
    int32_t x, y_q5;
};

static uint32_t absolute(int32_t value)
{
    return value < 0 ? 0u - (uint32_t)value : (uint32_t)value;
}

/* The nearest point of the oscillator's table. Range: y < 2^30, x >> 12 >= 2^17, so t <= 2^12 (1 + 2^-17); 2^12 88318 < 2^29. */
static uint32_t nearest_step(struct folded vector)
{
    uint32_t t_q12 = vector.y / (vector.x >> 12);
    uint32_t steps_q24 = t_q12 * (OCTANT_AT_TANGENT_Q12 - ((t_q12 * OCTANT_CURVATURE_Q4) >> 4));
    return (steps_q24 + (1u << 23)) >> 24;
}

/* Range: x < 2^30 sqrt(2) in Q60, |y| < 0.0285 2^60.5 = 2^55.4. All four factors are positive: the point lies in the first octant, too. */
static struct turned turn_back(struct folded vector, struct phasor_q30 point)
{
    uint32_t cosine_q30 = (uint32_t)point.cosine_q30, sine_q30 = (uint32_t)point.sine_q30;
    uint64_t x_q30 = (uint64_t)vector.x * cosine_q30 + (uint64_t)vector.y * sine_q30;
    uint64_t y_q30 = (uint64_t)vector.y * cosine_q30 - (uint64_t)vector.x * sine_q30;
    return (struct turned){fixed_middle_word((int64_t)x_q30, 30), fixed_middle_word((int64_t)y_q30, 25)};
}

/* y / x. A hardware division gives 14 bits of 1/x, the remainder of the quotient another 14. Range: x in [0.9995 2^29, 2^30.5), so
 * 2^59 / x < 2^30.1; |t| < 0.0285; the remainder is below 2^-13 of y, 2^44 in Q32, 2^31 in Q19. */
static int32_t tangent_q32(struct turned vector)
{
    int32_t reciprocal_q59 = (int32_t)((UINT32_C(0xFFFFFFFF) / ((uint32_t)vector.x >> 15)) << 12);
    int32_t first_q32 = fixed_mul_high_floor(vector.y_q5, reciprocal_q59);
    int64_t rest_q32 = (int64_t)vector.y_q5 * (INT32_C(1) << 27) - (int64_t)first_q32 * vector.x;
    return first_q32 + (fixed_mul_high_floor(fixed_middle_word(rest_q32, 13), reciprocal_q59) >> 14);
}

/* t - t^3/3, 2^32 = one turn; left out: t^5/5 < 4e-9 rad. */
static uint32_t arctangent_u32(int32_t t_q32, int32_t t2_q32)
{
    int32_t angle_q32 = t_q32 - fixed_mul_high_floor(t_q32, fixed_mul_high_floor(t2_q32, THIRD_Q32));
    return (uint32_t)fixed_mul_high(angle_q32, RAD_TO_TURNS);
}

/* x sqrt(1 + t^2) = x (1 + t^2/2 - t^4/8); left out: t^6/16 < 4e-11. */
static int32_t length(int32_t x, int32_t t2_q32)
{
    int32_t more_q32 = (t2_q32 >> 1) - (fixed_mul_high_floor(t2_q32, t2_q32) >> 3);
    return x + fixed_mul_high_floor(x, more_q32);
}

/* Undoes the shift to the left by `zeros` less two, rounded. Range: value < 2^30.6. */
static int32_t unshifted(int32_t value, unsigned zeros)
{
    if (zeros > 2) {
        unsigned shift = zeros - 2;
        return (value + (INT32_C(1) << (shift - 1))) >> shift;
    }
    return value > INT32_MAX >> (2 - zeros) ? INT32_MAX : value * (INT32_C(1) << (2 - zeros));
}

struct polar polar_from_complex(struct complex_q30 value)
{
    uint32_t i = absolute(value.i_q30), q = absolute(value.q_q30);
    bool steep = q > i;
    uint32_t larger = steep ? q : i, smaller = steep ? i : q;
    if (larger == 0) {
        return (struct polar){0, 0};
    }
    unsigned zeros = fixed_leading_zeros(larger);
    struct folded vector = {(larger << zeros) >> 2, (smaller << zeros) >> 2};
    uint32_t step = nearest_step(vector);
    struct turned turned = turn_back(vector, oscillator_table[step]);
    int32_t t_q32 = tangent_q32(turned);
    int32_t t2_q32 = fixed_mul_high_floor(t_q32, t_q32);
    uint32_t angle = (step << (32 - OSCILLATOR_TABLE_BITS)) + arctangent_u32(t_q32, t2_q32);
    angle = steep ? UINT32_C(0x40000000) - angle : angle;
    angle = value.i_q30 < 0 ? UINT32_C(0x80000000) - angle : angle;
    angle = value.q_q30 < 0 ? 0u - angle : angle;
    return (struct polar){unshifted(length(turned.x, t2_q32), zeros), (int32_t)angle};
}
