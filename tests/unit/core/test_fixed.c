/* Arithmetic against 128-bit integers and long double. */
#include "unity.h"

#include <math.h>

#include "core/fixed.h"
#include "support/random.h"

#define ROUNDS 1000000

void setUp(void)
{
}

void tearDown(void)
{
}

static int64_t random_i64(struct random_state *random, int64_t limit)
{
    int64_t value = (int64_t)random_u64(random) >> (random_u64(random) & 63);
    return value > limit ? limit : value < -limit ? -limit : value;
}

static void test_saturate_keeps_what_fits_and_flags_what_does_not(void)
{
    const int64_t inside[] = {INT32_MIN, -1, 0, 1, INT32_MAX};
    for (int i = 0; i < 5; i++) {
        bool overflow = false;
        TEST_ASSERT_EQUAL_INT32((int32_t)inside[i], fixed_saturate_i32(inside[i], &overflow));
        TEST_ASSERT_FALSE(overflow);
    }
    const int64_t outside[] = {INT64_MIN, (int64_t)INT32_MIN - 1, (int64_t)INT32_MAX + 1, INT64_MAX};
    for (int i = 0; i < 4; i++) {
        bool overflow = false;
        TEST_ASSERT_EQUAL_INT32(outside[i] < 0 ? INT32_MIN : INT32_MAX, fixed_saturate_i32(outside[i], &overflow));
        TEST_ASSERT_TRUE(overflow);
    }
}

static void test_saturate_never_clears_the_flag(void)
{
    bool overflow = true;
    (void)fixed_saturate_i32(0, &overflow);
    (void)fixed_clamp_i64(0, -1, 1, &overflow);
    TEST_ASSERT_TRUE(overflow);
}

static void test_clamp(void)
{
    bool overflow = false;
    TEST_ASSERT_EQUAL_INT64(-7, fixed_clamp_i64(-7, -7, 9, &overflow));
    TEST_ASSERT_EQUAL_INT64(9, fixed_clamp_i64(9, -7, 9, &overflow));
    TEST_ASSERT_FALSE(overflow);
    TEST_ASSERT_EQUAL_INT64(-7, fixed_clamp_i64(INT64_MIN, -7, 9, &overflow));
    TEST_ASSERT_TRUE(overflow);
    overflow = false;
    TEST_ASSERT_EQUAL_INT64(9, fixed_clamp_i64(INT64_MAX, -7, 9, &overflow));
    TEST_ASSERT_TRUE(overflow);
}

static void test_products_of_extremes(void)
{
    TEST_ASSERT_EQUAL_INT32(INT32_C(1) << 30, fixed_mul_high(INT32_MIN, INT32_MIN));
    TEST_ASSERT_EQUAL_INT32(-(INT32_C(1) << 30) + 1, fixed_mul_high(INT32_MIN, INT32_MAX));
    TEST_ASSERT_EQUAL_INT32(-(INT32_C(1) << 30), fixed_mul_high_floor(INT32_MIN, INT32_MAX));
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, fixed_mul_q31(INT32_MIN, INT32_MIN));
    TEST_ASSERT_EQUAL_INT32(-INT32_MAX, fixed_mul_q31(INT32_MIN, INT32_MAX));
}

static void test_products_against_128_bit(void)
{
    struct random_state random = random_begin(__func__, 1);
    for (int i = 0; i < ROUNDS; i++) {
        int32_t a = random_wide_i32(&random), b = random_wide_i32(&random);
        __int128 product = (__int128)a * b;
        TEST_ASSERT_EQUAL_INT32((int32_t)((product + (INT64_C(1) << 31)) >> 32), fixed_mul_high(a, b));
        TEST_ASSERT_EQUAL_INT32((int32_t)(product >> 32), fixed_mul_high_floor(a, b));
        __int128 rounded = (product + (INT64_C(1) << 30)) >> 31;
        TEST_ASSERT_EQUAL_INT32(rounded > INT32_MAX ? INT32_MAX : (int32_t)rounded, fixed_mul_q31(a, b));
    }
}

static void test_high_word_is_the_floor(void)
{
    struct random_state random = random_begin(__func__, 2);
    for (int i = 0; i < ROUNDS; i++) {
        int64_t value = (int64_t)random_u64(&random);
        TEST_ASSERT_EQUAL_INT32((int32_t)floorl((long double)value / 4294967296.0L), fixed_high_word(value));
    }
}

static void test_round_shift(void)
{
    TEST_ASSERT_EQUAL_INT64(-1, fixed_round_shift(-3, 1)); /* halves go up */
    TEST_ASSERT_EQUAL_INT64(2, fixed_round_shift(3, 1));
    TEST_ASSERT_EQUAL_INT64(-2, fixed_round_shift(INT64_MIN, 62));
    struct random_state random = random_begin(__func__, 3);
    for (int i = 0; i < ROUNDS; i++) {
        unsigned shift = 1 + (unsigned)(random_u64(&random) % 62);
        int64_t value = random_i64(&random, INT64_MAX - (INT64_C(1) << (shift - 1)));
        __int128 expected = ((__int128)value + ((__int128)1 << (shift - 1))) >> shift;
        TEST_ASSERT_EQUAL_INT64((int64_t)expected, fixed_round_shift(value, shift));
    }
}

static void test_wide_product_is_the_floor_within_one_unit(void)
{
    struct random_state random = random_begin(__func__, 4);
    for (int i = 0; i < ROUNDS; i++) {
        int64_t value = random_i64(&random, (INT64_C(1) << 62) - 1);
        int32_t factor = random_wide_i32(&random);
        int64_t expected = (int64_t)(((__int128)value * factor) >> 31);
        TEST_ASSERT_INT64_WITHIN(1, expected, fixed_mul_i64_q31(value, factor));
    }
    TEST_ASSERT_EQUAL_INT64((INT64_C(1) << 62) - 1, -fixed_mul_i64_q31((INT64_C(1) << 62) - 1, INT32_MIN));
}

static void expect_reciprocal(uint32_t divisor)
{
    long double exact = ldexpl(1.0L, 60) / divisor;
    long double error = fixed_reciprocal_q60(divisor) / exact - 1.0L;
    TEST_ASSERT_TRUE_MESSAGE(fabsl(error) < ldexpl(1.0L, -26), "relative error of the reciprocal");
}

static void test_reciprocal(void)
{
    struct random_state random = random_begin(__func__, 5);
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, fixed_reciprocal_q60(UINT32_C(1) << 29));
    expect_reciprocal((UINT32_C(1) << 29) + 1);
    expect_reciprocal((UINT32_C(1) << 30) - 1);
    expect_reciprocal(UINT32_C(1) << 30);
    expect_reciprocal((UINT32_C(1) << 31) - 1);
    for (int i = 0; i < ROUNDS; i++) {
        expect_reciprocal((UINT32_C(1) << 29) + (uint32_t)(random_u64(&random) % (UINT64_C(3) << 29)));
    }
    for (uint32_t top = UINT32_C(1) << 15; top < UINT32_C(1) << 17; top++) { /* both ends of every seed's interval */
        expect_reciprocal(top << 14);
        expect_reciprocal((top << 14) | 0x3FFF);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_saturate_keeps_what_fits_and_flags_what_does_not);
    RUN_TEST(test_saturate_never_clears_the_flag);
    RUN_TEST(test_clamp);
    RUN_TEST(test_products_of_extremes);
    RUN_TEST(test_products_against_128_bit);
    RUN_TEST(test_high_word_is_the_floor);
    RUN_TEST(test_round_shift);
    RUN_TEST(test_wide_product_is_the_floor_within_one_unit);
    RUN_TEST(test_reciprocal);
    return UNITY_END();
}
