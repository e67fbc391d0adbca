/* Polynomial against long double. Promise `polynomial`: 3 units; exact rational arithmetic in tests/python/test_core_polynomial.py. */
#include "unity.h"

#include <math.h>
#include <stdio.h>

#include "core/thermal_polynomial.h"
#include "support/random.h"

void setUp(void)
{
}

void tearDown(void)
{
}

static long double exact(const struct thermal_polynomial *polynomial, int32_t argument_q31)
{
    long double value = 0.0L, t = ldexpl(argument_q31, -31);
    for (uint32_t i = polynomial->order + 1; i-- > 0;) {
        value = value * t + polynomial->coef[i];
    }
    return value;
}

static void test_argument(void)
{
    bool overflow = false;
    TEST_ASSERT_EQUAL_INT32(0, thermal_polynomial_argument(0, &overflow));
    TEST_ASSERT_EQUAL_INT32(INT32_C(1) << 30, thermal_polynomial_argument(64 << 20, &overflow));
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, thermal_polynomial_argument(-(128 << 20), &overflow));
    TEST_ASSERT_FALSE(overflow);
}

static void test_argument_saturates_beyond_its_span(void)
{
    const int32_t outside[] = {128 << 20, INT32_MAX, -(128 << 20) - 1, INT32_MIN};
    for (int k = 0; k < 4; k++) {
        bool overflow = false;
        TEST_ASSERT_EQUAL_INT32(outside[k] < 0 ? INT32_MIN : INT32_MAX, thermal_polynomial_argument(outside[k], &overflow));
        TEST_ASSERT_TRUE(overflow);
    }
}

/* Coefficients whose partial sums cannot leave 32 bit. */
static void test_random_polynomials(void)
{
    struct random_state random = random_begin(__func__, 1);
    double worst = 0.0;
    for (int n = 0; n < 500000; n++) {
        struct thermal_polynomial polynomial = {.order = (uint32_t)(random_u64(&random) % 6)};
        for (uint32_t i = 0; i <= polynomial.order; i++) {
            polynomial.coef[i] = random_wide_i32(&random) / 6;
        }
        bool overflow = false;
        int32_t argument = random_wide_i32(&random);
        int32_t value = thermal_polynomial_eval(&polynomial, argument, &overflow);
        worst = fmax(worst, (double)fabsl(value - exact(&polynomial, argument)));
        TEST_ASSERT_FALSE(overflow);
    }
    printf("worst error %.3f units\n", worst);
    TEST_ASSERT_TRUE(worst <= 3.0);
}

static void test_the_papers_polynomial(void)
{
    const double alpha[4] = {1.0792e-3, -4.631e-5, 7.7044e-7, -5.8598e-9};
    struct thermal_polynomial polynomial = {.order = 3};
    for (int i = 0; i < 4; i++) {
        polynomial.coef[i] = (int32_t)lrint(ldexp(alpha[i] * pow(128.0, i), 31));
    }
    double worst = 0.0;
    for (double t = -50.0; t <= 50.0; t += 0.25) {
        bool overflow = false;
        int32_t argument = thermal_polynomial_argument((int32_t)ldexp(t, 20), &overflow);
        double value = ldexp(thermal_polynomial_eval(&polynomial, argument, &overflow), -31);
        worst = fmax(worst, fabs(value - (alpha[0] + t * (alpha[1] + t * (alpha[2] + t * alpha[3])))));
        TEST_ASSERT_FALSE(overflow);
    }
    printf("worst error %.3g rad/s over -50 to 50 degC\n", worst);
    TEST_ASSERT_TRUE(worst < 1e-9); /* 2e-4 deg/h */
}

static void test_every_partial_sum_saturates_and_flags(void)
{
    const int32_t extremes[] = {INT32_MIN, INT32_MAX};
    for (unsigned pattern = 0; pattern < 128; pattern++) {
        struct thermal_polynomial polynomial = {.order = 5};
        for (unsigned i = 0; i <= 5; i++) {
            polynomial.coef[i] = extremes[(pattern >> i) & 1];
        }
        bool overflow = false;
        int32_t argument = extremes[(pattern >> 6) & 1];
        (void)thermal_polynomial_eval(&polynomial, argument, &overflow);
        if (fabsl(exact(&polynomial, argument)) > 3e9L) {
            TEST_ASSERT_TRUE(overflow);
        }
    }
    bool overflow = false;
    struct thermal_polynomial steep = {{INT32_MAX, INT32_MAX, 0, 0, 0, 0}, 1};
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, thermal_polynomial_eval(&steep, INT32_MAX, &overflow));
    TEST_ASSERT_TRUE(overflow);
}

static void test_order_beyond_five_counts_as_five(void)
{
    struct thermal_polynomial polynomial = {{1, 2, 3, 4, 5, 1 << 20}, 5};
    bool overflow = false;
    int32_t expected = thermal_polynomial_eval(&polynomial, INT32_C(1) << 30, &overflow);
    polynomial.order = UINT32_MAX;
    TEST_ASSERT_EQUAL_INT32(expected, thermal_polynomial_eval(&polynomial, INT32_C(1) << 30, &overflow));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_argument);
    RUN_TEST(test_argument_saturates_beyond_its_span);
    RUN_TEST(test_random_polynomials);
    RUN_TEST(test_the_papers_polynomial);
    RUN_TEST(test_every_partial_sum_saturates_and_flags);
    RUN_TEST(test_order_beyond_five_counts_as_five);
    return UNITY_END();
}
