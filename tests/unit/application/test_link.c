/* Frames over a bad wire. A receiver takes a damaged frame for a sound one only if its CRC-32 fits by chance, once in 2^32 damaged packets:
 * in the runs here that is expected less than 1e-5 times. */
#include "unity.h"

#include "support/link.h"
#include "support/random.h"

#define FRAMES 200000

void setUp(void)
{
}

void tearDown(void)
{
}

static void nothing_is_lost_without_errors(void)
{
    struct link_result result = link_run(20000, 0.0, 1);
    TEST_ASSERT_EQUAL_UINT64(0, result.errors);
    TEST_ASSERT_EQUAL_UINT64(20000, result.recovered);
    TEST_ASSERT_EQUAL_UINT64(0, result.wrong);
    TEST_ASSERT_EQUAL_UINT64(0, result.refused);
}

static void intact_frames_are_recovered_and_wrong_ones_refused(void)
{
    static const double probabilities[] = {1e-4, 1e-3, 1e-2, 0.1};
    struct random_state seeds = random_begin("link", 20241121);
    for (size_t i = 0; i < sizeof probabilities / sizeof probabilities[0]; i++) {
        struct link_result result = link_run(FRAMES / 4, probabilities[i], random_u64(&seeds));
        TEST_ASSERT_EQUAL_UINT64(0, result.wrong);
        TEST_ASSERT_EQUAL_UINT64(result.intact, result.recovered);
        TEST_ASSERT_TRUE(result.intact < result.frames && result.refused > 0);
    }
    struct link_result result = link_run(FRAMES, 1e-3, random_u64(&seeds));
    TEST_ASSERT_EQUAL_UINT64(0, result.wrong);
    TEST_ASSERT_EQUAL_UINT64(result.intact, result.recovered);
    TEST_ASSERT_UINT64_WITHIN(result.bytes / 1000 / 10, result.bytes / 1000, result.errors);
    TEST_ASSERT_TRUE(result.intact > FRAMES / 10 * 9);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(nothing_is_lost_without_errors);
    RUN_TEST(intact_frames_are_recovered_and_wrong_ones_refused);
    return UNITY_END();
}
