/* Magnitude and angle against hypot and atan2. Promise `polar`: 1e-6 rad and 1e-7 of full scale above 2^-10 of it. */
#include "unity.h"

#include <math.h>
#include <stdio.h>

#include "core/polar.h"
#include "support/random.h"

static double two_pi, worst_angle_rad, worst_magnitude;

void setUp(void)
{
    two_pi = 8.0 * atan(1.0);
    worst_angle_rad = worst_magnitude = 0.0;
}

void tearDown(void)
{
}

static void compare(int32_t i_q30, int32_t q_q30)
{
    struct polar result = polar_from_complex((struct complex_q30){i_q30, q_q30});
    double turns = atan2(q_q30, i_q30) / two_pi;
    int32_t difference = (int32_t)((uint32_t)result.angle_i32 - (uint32_t)(int64_t)llrint(ldexp(turns, 32)));
    double length = fmin(ldexp(hypot(i_q30, q_q30), -30), 2.0 - ldexp(1.0, -30));
    worst_angle_rad = fmax(worst_angle_rad, fabs(ldexp(difference, -32)) * two_pi);
    worst_magnitude = fmax(worst_magnitude, fabs(ldexp(result.magnitude_q30, -30) - length));
}

static void expect_promise(const char *where)
{
    printf("%s: worst angle %.3g rad, magnitude %.3g\n", where, worst_angle_rad, worst_magnitude);
    TEST_ASSERT_TRUE(worst_angle_rad <= 1e-6);
    TEST_ASSERT_TRUE(worst_magnitude <= 1e-7);
}

static void test_every_direction_at_every_length_above_2_to_the_minus_10(void)
{
    struct random_state random = random_begin(__func__, 1);
    for (int n = 0; n < 1000000; n++) {
        double length = ldexp(1.0, (int)(random_u64(&random) % 11) + 19) * random_uniform(&random, 1.0, 2.0);
        double angle = random_uniform(&random, 0.0, two_pi);
        compare((int32_t)(length * cos(angle)), (int32_t)(length * sin(angle)));
    }
    expect_promise("random");
}

static void test_around_the_axes_and_the_cut(void)
{
    static const int32_t lengths[] = {1 << 20, (1 << 20) + 1, 1 << 28, (1 << 29) - 1, 1 << 29, (1 << 30) - 1, 1 << 30, INT32_MAX};
    for (unsigned k = 0; k < sizeof lengths / sizeof lengths[0]; k++) {
        for (int32_t side = -300; side <= 300; side++) {
            compare(lengths[k], side);
            compare(-lengths[k], side);
            compare(side, lengths[k]);
            compare(side, -lengths[k]);
        }
    }
    expect_promise("axes");
}

static void test_extremes(void)
{
    static const int32_t values[] = {INT32_MIN, INT32_MIN + 1, INT32_MAX - 1, INT32_MAX};
    for (int a = 0; a < 4; a++) {
        for (int b = 0; b < 4; b++) {
            compare(values[a], values[b]);
        }
    }
    expect_promise("extremes");
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, polar_from_complex((struct complex_q30){INT32_MIN, INT32_MIN}).magnitude_q30);
}

static void test_zero_is_zero(void)
{
    struct polar result = polar_from_complex((struct complex_q30){0, 0});
    TEST_ASSERT_EQUAL_INT32(0, result.magnitude_q30);
    TEST_ASSERT_EQUAL_INT32(0, result.angle_i32);
}

/* Down to single units: the angle is that of the integers themselves, the magnitude rounds. */
static void test_faint_values(void)
{
    for (int32_t i = -40; i <= 40; i++) {
        for (int32_t q = -40; q <= 40; q++) {
            if (i != 0 || q != 0) {
                compare(i, q);
            }
        }
    }
    printf("faint: worst angle %.3g rad, magnitude %.3g units\n", worst_angle_rad, ldexp(worst_magnitude, 30));
    TEST_ASSERT_TRUE(worst_angle_rad <= 1e-6);
    TEST_ASSERT_TRUE(ldexp(worst_magnitude, 30) <= 0.51);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_every_direction_at_every_length_above_2_to_the_minus_10);
    RUN_TEST(test_around_the_axes_and_the_cut);
    RUN_TEST(test_extremes);
    RUN_TEST(test_zero_is_zero);
    RUN_TEST(test_faint_values);
    return UNITY_END();
}
