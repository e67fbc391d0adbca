/* Fixed-point arithmetic: multiply, round, saturate, reciprocal.
 *
 * Formats: q31 means value = integer / 2^31, and so on; `phase_u32` and `phase_u64` count one turn as 2^32 and 2^64.
 * Nothing here wraps silently: what can leave its range saturates and sets a flag that the caller owns.
 * Modular arithmetic is used on purpose in two places only (phases and the decimator's integrators), on unsigned types. */
#ifndef WINEGLASS_CORE_FIXED_H
#define WINEGLASS_CORE_FIXED_H

#include <stdbool.h>
#include <stdint.h>

/* The whole core relies on an arithmetic right shift of negative integers, which C leaves to the implementation. */
_Static_assert((-5 >> 1) == -3, "right shift of a negative integer must be arithmetic");
_Static_assert((int32_t)0x80000000u == INT32_MIN, "conversion to a signed integer must be two's complement");

/* Upper word, towards minus infinity. Through unsigned, so that 32-bit compilers see a register and not a 64-bit shift. */
static inline int32_t fixed_high_word(int64_t value)
{
    return (int32_t)(uint32_t)((uint64_t)value >> 32);
}

/* Lower 32 bits of value >> shift, 1 <= shift <= 31. From words, so that 32-bit compilers go on seeing 32 bits where they know the range. */
static inline int32_t fixed_middle_word(int64_t value, unsigned shift)
{
    return (int32_t)(((uint32_t)value >> shift) | ((uint32_t)fixed_high_word(value) << (32 - shift)));
}

/* 4 value, from words for the same reason. */
static inline int64_t fixed_times_4(int32_t value)
{
    return (int64_t)(((uint64_t)(uint32_t)(value >> 30) << 32) | ((uint32_t)value << 2));
}

/* Clamp to 32 bit; *overflow is set (never cleared) when the value did not fit: when its upper word is not the lower one's sign. */
static inline int32_t fixed_saturate_i32(int64_t value, bool *overflow)
{
    int32_t low = (int32_t)(uint32_t)value;
    if (fixed_high_word(value) != low >> 31) {
        *overflow = true;
        return value < 0 ? INT32_MIN : INT32_MAX;
    }
    return low;
}

/* Clamp to [low, high], low <= high; *overflow is set when the value did not fit. */
static inline int64_t fixed_clamp_i64(int64_t value, int64_t low, int64_t high, bool *overflow)
{
    if (value > high) {
        *overflow = true;
        return high;
    }
    if (value < low) {
        *overflow = true;
        return low;
    }
    return value;
}

/* value = high 2^32 + low with a signed low word, so that both factors of every product are signed 32-bit words.
 * Range: value < 2^63 - 2^31. */
struct fixed_words {
    int32_t high, low;
};

static inline struct fixed_words fixed_words(int64_t value)
{
    int32_t low = (int32_t)(uint32_t)value;
    return (struct fixed_words){fixed_high_word(value) - (low >> 31), low};
}

/* *sum = a + b modulo 2^32; true when the sum itself does not fit. One instruction and a branch where the compiler knows how. */
static inline bool fixed_add_wraps(int32_t a, int32_t b, int32_t *sum)
{
#if defined(__GNUC__)
    return __builtin_add_overflow(a, b, sum);
#else
    *sum = (int32_t)((uint32_t)a + (uint32_t)b);
    return ((a ^ *sum) & (b ^ *sum)) < 0;
#endif
}

/* The same for a - b. */
static inline bool fixed_sub_wraps(int32_t a, int32_t b, int32_t *difference)
{
#if defined(__GNUC__)
    return __builtin_sub_overflow(a, b, difference);
#else
    *difference = (int32_t)((uint32_t)a - (uint32_t)b);
    return ((a ^ b) & (a ^ *difference)) < 0;
#endif
}

/* a - b, |.| <= INT32_MAX; what does not fit is as good as the limit to the controllers that use it. */
static inline int32_t fixed_error(int32_t a, int32_t b)
{
    int32_t difference;
    if (fixed_sub_wraps(a, b, &difference)) {
        difference = (a >> 31) ^ INT32_MAX;
    }
    return difference;
}

/* error (Q30) x gain (Q16) = Q46, bounded to +-2^54 (a force of 256) and scaled to Q54. Range: |product| <= 2^62; the bound is put to the upper
 * word. */
static inline int64_t fixed_proportional_q54(int32_t error_q30, int32_t gain_q16)
{
    int64_t product_q46 = (int64_t)error_q30 * gain_q16;
    int32_t high = fixed_high_word(product_q46);
    high = high < -(INT32_C(1) << 22) ? -(INT32_C(1) << 22) : high;
    high = high > (INT32_C(1) << 22) - 1 ? (INT32_C(1) << 22) - 1 : high;
    uint32_t low = (uint32_t)product_q46;
    return (int64_t)((uint64_t)(((uint32_t)high << 8) | (low >> 24)) << 32 | (low << 8));
}

/* Leading zeros, value != 0. */
static inline unsigned fixed_leading_zeros(uint32_t value)
{
#if defined(__GNUC__)
    return (unsigned)__builtin_clz(value);
#else
    unsigned zeros = 0;
    for (; value < UINT32_C(0x80000000); value <<= 1) {
        zeros++;
    }
    return zeros;
#endif
}

/* Upper half of the product, Qa x Qb -> Q(a+b-32), floored: within half a unit more than fixed_mul_high, one instruction less. */
static inline int32_t fixed_mul_high_floor(int32_t a, int32_t b)
{
    return fixed_high_word((int64_t)a * b);
}

/* Rounded upper half of the product, Qa x Qb -> Q(a+b-32).
 * Range: |a b| <= 2^62, plus 2^31 < 2^63; the result is within [-2^30 + 1, 2^30]. */
static inline int32_t fixed_mul_high(int32_t a, int32_t b)
{
    return (int32_t)(((int64_t)a * b + INT64_C(0x80000000)) >> 32);
}

/* Rounded Qa x Q31 -> Qa. Range: only INT32_MIN x INT32_MIN leaves 32 bit, as 2^31, which wraps to INT32_MIN; no other product
 * rounds to that (the next is -2^31 (1 - 2^-31)), so it is told by its result and saturates to INT32_MAX. */
static inline int32_t fixed_mul_q31(int32_t a, int32_t b_q31)
{
    int32_t product = (int32_t)(uint32_t)((uint64_t)((int64_t)a * b_q31 + (INT64_C(1) << 30)) >> 31);
    return product == INT32_MIN ? INT32_MAX : product;
}

/* Shift right with rounding half up, 1 <= shift <= 62. Range: value <= INT64_MAX - 2^(shift-1). */
static inline int64_t fixed_round_shift(int64_t value, unsigned shift)
{
    return (value + (INT64_C(1) << (shift - 1))) >> shift;
}

/* Product of a 64-bit and a 32-bit factor, divided by 2^31, floor to within one unit.
 * value = high 2^31 + low, 0 <= low < 2^31, so value factor / 2^31 = high factor + low factor / 2^31.
 * Range: |value| < 2^62 so that `high` fits 32 bit; the result fits 64 bit as |value factor| < 2^93. */
static inline int64_t fixed_mul_i64_q31(int64_t value, int32_t factor_q31)
{
    int32_t high = (int32_t)(uint32_t)((uint64_t)value >> 31);
    int32_t low = (int32_t)((uint32_t)value & UINT32_C(0x7FFFFFFF));
    return (int64_t)high * factor_q31 + (((int64_t)low * factor_q31) >> 31);
}

/* 2^60 / divisor for 2^29 <= divisor < 2^31, relative error below 2^-26; exactly 2^31 saturates to INT32_MAX.
 * A 32-bit division gives 14 good bits, one Newton step x (2 - d x) doubles them.
 * Range: divisor >> 14 in [2^15, 2^17), so seed in (2^15, 2^17], |error| <= 2^46 1.5 2^-14 < 2^33,
 * |seed error| < 2^50; the result lies in (2^29, 2^31]. */
static inline int32_t fixed_reciprocal_q60(uint32_t divisor)
{
    uint32_t seed = UINT32_C(0xFFFFFFFF) / (divisor >> 14); /* 2^46 / divisor */
    int64_t error_q46 = (INT64_C(1) << 46) - (int64_t)((uint64_t)divisor * seed);
    int64_t result = ((int64_t)seed << 14) + (((int64_t)seed * error_q46) >> 32);
    return result > INT32_MAX ? INT32_MAX : (int32_t)result;
}

#endif
