/* Output filter against the same recursion in long double. Its coefficients are held to scipy in tests/python/test_core_output_filter.py. */
#include "unity.h"

#include <math.h>
#include <stdio.h>

#include "core/output_filter.h"
#include "support/random.h"

void setUp(void)
{
}

void tearDown(void)
{
}

static const int32_t levels[] = {0, 1, -1, 12345, -987654321, 1 << 30, INT32_MAX, INT32_MIN};
#define LEVELS (sizeof levels / sizeof levels[0])

/* Long enough for the slowest filter to settle to far below one unit. */
static int32_t settled(uint32_t choice, int32_t from, int32_t to, bool *overflow)
{
    struct output_filter_state state;
    int32_t out = 0;
    output_filter_reset(&state, from);
    for (int n = 0; n < 2000; n++) {
        out = output_filter_step(choice, &state, to, overflow);
    }
    return out;
}

static void test_gain_at_rest_is_one_within_a_unit(void)
{
    for (uint32_t choice = 0; choice < OUTPUT_FILTER_COUNT; choice++) {
        for (unsigned from = 0; from < LEVELS; from++) {
            for (unsigned to = 0; to < LEVELS; to++) {
                bool overflow = false;
                TEST_ASSERT_INT64_WITHIN(1, levels[to], settled(choice, levels[from], levels[to], &overflow));
            }
        }
    }
}

static void test_reset_holds_the_value_at_once(void)
{
    for (uint32_t choice = 0; choice < OUTPUT_FILTER_COUNT; choice++) {
        for (unsigned k = 0; k < LEVELS; k++) {
            struct output_filter_state state;
            bool overflow = false;
            output_filter_reset(&state, levels[k]);
            TEST_ASSERT_INT64_WITHIN(1, levels[k], output_filter_step(choice, &state, levels[k], &overflow));
            TEST_ASSERT_FALSE(overflow);
        }
    }
}

static void test_none_and_unknown_choices_pass_through(void)
{
    const uint32_t choices[] = {OUTPUT_FILTER_NONE, OUTPUT_FILTER_COUNT, UINT32_MAX};
    for (int k = 0; k < 3; k++) {
        struct output_filter_state state;
        bool overflow = false;
        output_filter_reset(&state, 0);
        TEST_ASSERT_EQUAL_INT32(INT32_MIN, output_filter_step(choices[k], &state, INT32_MIN, &overflow));
        TEST_ASSERT_EQUAL_INT32(INT32_MAX, output_filter_step(choices[k], &state, INT32_MAX, &overflow));
        TEST_ASSERT_FALSE(overflow);
    }
}

/* Switching a filter on continues from the last value, without a step from zero. */
static void test_switching_on_is_smooth(void)
{
    struct output_filter_state state;
    bool overflow = false;
    output_filter_reset(&state, 0);
    (void)output_filter_step(OUTPUT_FILTER_NONE, &state, 1000000, &overflow);
    TEST_ASSERT_INT32_WITHIN(1, 1000000, output_filter_step(OUTPUT_FILTER_0_01, &state, 1000000, &overflow));
}

struct reference {
    long double x1[OUTPUT_FILTER_SECTIONS], x2[OUTPUT_FILTER_SECTIONS], y1[OUTPUT_FILTER_SECTIONS], y2[OUTPUT_FILTER_SECTIONS];
};

static long double reference_step(uint32_t choice, struct reference *state, long double x)
{
    for (int k = 0; k < OUTPUT_FILTER_SECTIONS; k++) {
        const struct output_filter_section *section = &output_filter_table[choice][k];
        long double y = section->gain_q29 * (x + 2.0L * state->x1[k] + state->x2[k]) - section->a1_q29 * state->y1[k] -
                        section->a2_q29 * state->y2[k];
        y = ldexpl(y, -29);
        state->x2[k] = state->x1[k];
        state->x1[k] = x;
        state->y2[k] = state->y1[k];
        state->y1[k] = y;
        x = y;
    }
    return x;
}

static void test_random_input_against_long_double(void)
{
    struct random_state random = random_begin(__func__, 1);
    double worst = 0.0;
    for (uint32_t choice = OUTPUT_FILTER_0_01; choice < OUTPUT_FILTER_COUNT; choice++) {
        struct output_filter_state state;
        struct reference reference = {{0}, {0}, {0}, {0}};
        bool overflow = false;
        output_filter_reset(&state, 0);
        for (int n = 0; n < 100000; n++) {
            int32_t x = random_wide_i32(&random);
            int32_t y = output_filter_step(choice, &state, x, &overflow);
            long double expected = fminl(fmaxl(reference_step(choice, &reference, x), INT32_MIN), INT32_MAX);
            worst = fmax(worst, (double)fabsl(y - expected));
        }
    }
    printf("random input: worst difference %.3f units\n", worst);
    TEST_ASSERT_TRUE(worst <= 0.52);
}

/* Drives each filter with the input that makes its output and its inner states largest: the time-reversed sign of the response. */
static void worst_input(uint32_t choice, int sections, double *largest_state, double *largest_out, bool *overflow)
{
    enum { LENGTH = 1000 };
    static double response[LENGTH];
    struct reference impulse = {{0}, {0}, {0}, {0}};
    struct output_filter_state state;
    for (int n = 0; n < LENGTH; n++) {
        long double out = reference_step(choice, &impulse, n == 0 ? 1.0L : 0.0L);
        response[n] = (double)(sections == 1 ? impulse.y1[0] : out);
    }
    output_filter_reset(&state, 0);
    for (int n = 0; n < LENGTH; n++) {
        int32_t x = response[LENGTH - 1 - n] < 0.0 ? INT32_MIN : INT32_MAX;
        *largest_out = fmax(*largest_out, fabs((double)output_filter_step(choice, &state, x, overflow)));
        *largest_state = fmax(*largest_state, fmax(fabs((double)state.memory[0].next), fabs((double)state.memory[1].next)));
        *largest_state = fmax(*largest_state, fmax(fabs((double)state.memory[0].after), fabs((double)state.memory[1].after)));
    }
}

static void test_extremes_saturate_and_flag(void)
{
    double largest_state = 0.0, largest_out = 0.0;
    for (uint32_t choice = OUTPUT_FILTER_0_01; choice < OUTPUT_FILTER_COUNT; choice++) {
        bool overflow = false;
        worst_input(choice, 2, &largest_state, &largest_out, &overflow);
        TEST_ASSERT_TRUE(overflow);
        worst_input(choice, 1, &largest_state, &largest_out, &overflow);
    }
    printf("worst input: inner states reach %.4f x 2^57\n", ldexp(largest_state, -57));
    TEST_ASSERT_TRUE(largest_state < ldexp(1.0, 59));
    TEST_ASSERT_TRUE(largest_out <= 2147483648.0);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_gain_at_rest_is_one_within_a_unit);
    RUN_TEST(test_reset_holds_the_value_at_once);
    RUN_TEST(test_none_and_unknown_choices_pass_through);
    RUN_TEST(test_switching_on_is_smooth);
    RUN_TEST(test_random_input_against_long_double);
    RUN_TEST(test_extremes_saturate_and_flag);
    return UNITY_END();
}
