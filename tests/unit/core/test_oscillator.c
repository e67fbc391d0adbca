/* Sine and cosine against the C library, over the whole turn; promise `oscillator`: 9e-6. */
#include "unity.h"

#include <math.h>
#include <stdio.h>

#include "core/oscillator.h"
#include "support/random.h"

#define PROMISE 9e-6

static double two_pi, worst_cosine, worst_sine, worst_length;

void setUp(void)
{
    two_pi = 8.0 * atan(1.0);
    worst_cosine = worst_sine = worst_length = 0.0;
}

void tearDown(void)
{
}

static void compare(uint32_t phase_u32)
{
    double angle = two_pi * ldexp(phase_u32, -32);
    struct phasor_q30 phasor = oscillator_phasor(phase_u32);
    double cosine = ldexp(phasor.cosine_q30, -30), sine = ldexp(phasor.sine_q30, -30);
    worst_cosine = fmax(worst_cosine, fabs(cosine - cos(angle)));
    worst_sine = fmax(worst_sine, fabs(sine - sin(angle)));
    worst_length = fmax(worst_length, hypot(cosine, sine));
}

static void expect_promise(const char *where)
{
    printf("%s: worst cosine %.3g, sine %.3g, length 1%+.2g\n", where, worst_cosine, worst_sine, worst_length - 1.0);
    TEST_ASSERT_TRUE(worst_cosine <= PROMISE);
    TEST_ASSERT_TRUE(worst_sine <= PROMISE);
    TEST_ASSERT_TRUE(worst_length <= 1.0 + 5e-6); /* what the range proofs of the forces build on */
}

static void test_whole_turn(void)
{
    for (uint32_t k = 0; k < UINT32_C(1) << 24; k++) {
        compare((k << 8) + (k * 37 & 255));
    }
    expect_promise("2^24 phases");
}

/* Table points, the middles between them, the axes and where the phase wraps. */
static void test_around_every_change_of_table_point(void)
{
    for (uint32_t point = 0; point < 2u << OSCILLATOR_TABLE_BITS; point++) {
        uint32_t center = point << (31 - OSCILLATOR_TABLE_BITS);
        for (uint32_t offset = 0; offset <= 2000; offset++) {
            compare(center + offset - 1000);
        }
    }
    expect_promise("around table points");
}

static void test_random_phases(void)
{
    struct random_state random = random_begin(__func__, 1);
    for (int i = 0; i < 1000000; i++) {
        compare((uint32_t)random_u64(&random));
    }
    expect_promise("random");
}

static void test_axes_are_exact(void)
{
    const uint32_t quarter = UINT32_C(1) << 30;
    const int32_t one = INT32_C(1) << 30;
    const int32_t expected[4][2] = {{one, 0}, {0, one}, {-one, 0}, {0, -one}};
    for (uint32_t k = 0; k < 4; k++) {
        TEST_ASSERT_EQUAL_INT32(expected[k][0], oscillator_phasor(k * quarter).cosine_q30);
        TEST_ASSERT_EQUAL_INT32(expected[k][1], oscillator_phasor(k * quarter).sine_q30);
    }
}

static void test_step_advances_and_wraps(void)
{
    struct oscillator_state state = {UINT64_MAX - 4, 10};
    TEST_ASSERT_EQUAL_UINT32(0, oscillator_step(&state));
    TEST_ASSERT_EQUAL_UINT64(5, state.phase_u64);
    state.freq_u64 = UINT64_C(1) << 63;
    TEST_ASSERT_EQUAL_HEX32(0x80000000, oscillator_step(&state));
}

/* 24 h at 50 kSa/s in one multiplication: the accumulator itself never drifts. */
static void test_phase_is_a_pure_sum(void)
{
    struct oscillator_state state = {123, UINT64_C(1844701116297637000)};
    uint64_t expected = 123 + UINT64_C(100000) * UINT64_C(1844701116297637000);
    for (int i = 0; i < 100000; i++) {
        (void)oscillator_step(&state);
    }
    TEST_ASSERT_EQUAL_UINT64(expected, state.phase_u64);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_whole_turn);
    RUN_TEST(test_around_every_change_of_table_point);
    RUN_TEST(test_random_phases);
    RUN_TEST(test_axes_are_exact);
    RUN_TEST(test_step_advances_and_wraps);
    RUN_TEST(test_phase_is_a_pure_sum);
    return UNITY_END();
}
