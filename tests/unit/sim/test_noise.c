/* Generator against its published sequence; Gaussian numbers against moments and tail probabilities. */
#include <math.h>
#include <string.h>

#include "sim/noise.h"
#include "support/random.h"
#include "unity.h"

enum { COUNT = 4000000 };

static double values[COUNT];
static struct noise_table table;
static uint64_t seed;

void setUp(void) {}
void tearDown(void) {}

static void fill(uint64_t from_seed, uint32_t stream, size_t n, double *to)
{
    struct noise_state state;
    noise_init(&state, from_seed, stream);
    noise_gaussian(&table, &state, n, to);
}

/* The authors' generator from the state 1, 2, 3, 4. */
static void generator_gives_the_published_sequence(void)
{
    static const uint64_t expected[] = {
        UINT64_C(41943041), UINT64_C(58720359), UINT64_C(3588806011781223), UINT64_C(3591011842654386),
        UINT64_C(9228616714210784205), UINT64_C(9973669472204895162), UINT64_C(14011001112246962877),
    };
    struct noise_state state = {{1, 2, 3, 4}};
    for (size_t i = 0; i < sizeof expected / sizeof *expected; i++) {
        TEST_ASSERT_EQUAL_HEX64(expected[i], noise_next(&state));
    }
}

/* Layers: equal area, and the last one reaches the top of the curve. */
static void layers_have_equal_area(void)
{
    double area = table.layer[0].inner * table.density[1] + sqrt(asin(1.0)) * erfc(table.layer[0].inner / sqrt(2.0));
    for (int i = 1; i < NOISE_LAYERS; i++) {
        double outer = table.layer[i].width * 0x1p52;
        TEST_ASSERT_DOUBLE_WITHIN(2e-9 * area, area, outer * (table.density[i + 1] - table.density[i]));
        TEST_ASSERT_EQUAL_DOUBLE(outer, table.layer[i - 1].inner);
    }
    TEST_ASSERT_EQUAL_DOUBLE(0.0, table.layer[NOISE_LAYERS - 1].inner);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, table.density[NOISE_LAYERS]);
}

/* Within 4.5 standard deviations of the estimates: variance of the moments 1, 2, 15 - 9 + ..., of the fourth 96. */
static void moments_are_those_of_a_gaussian(void)
{
    double m1 = 0.0, m2 = 0.0, m3 = 0.0, m4 = 0.0;
    for (int i = 0; i < COUNT; i++) {
        double x = values[i];
        m1 += x;
        m2 += x * x;
        m3 += x * x * x;
        m4 += x * x * x * x;
    }
    double deviation = 4.5 / sqrt(COUNT);
    TEST_ASSERT_DOUBLE_WITHIN(deviation, 0.0, m1 / COUNT);
    TEST_ASSERT_DOUBLE_WITHIN(deviation * sqrt(2.0), 1.0, m2 / COUNT);
    TEST_ASSERT_DOUBLE_WITHIN(deviation * sqrt(15.0), 0.0, m3 / COUNT);
    TEST_ASSERT_DOUBLE_WITHIN(deviation * sqrt(96.0), 3.0, m4 / COUNT);
}

static void tails_have_the_right_weight_on_both_sides(void)
{
    const double limits[] = {0.1, 0.5, 1.0, 2.0, 3.0, 3.5, 3.6541528853610088, 3.8, 4.2};
    for (size_t k = 0; k < sizeof limits / sizeof *limits; k++) {
        double above = 0.0, below = 0.0;
        for (int i = 0; i < COUNT; i++) {
            above += values[i] > limits[k];
            below += values[i] < -limits[k];
        }
        double expected = COUNT * 0.5 * erfc(limits[k] / sqrt(2.0));
        TEST_ASSERT_DOUBLE_WITHIN(4.5 * sqrt(expected), expected, above);
        TEST_ASSERT_DOUBLE_WITHIN(4.5 * sqrt(expected), expected, below);
    }
}

static double correlation(const double *a, const double *b, size_t n)
{
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) {
        sum += a[i] * b[i];
    }
    return sum / (double)n;
}

static void neighbours_streams_and_seeds_are_uncorrelated(void)
{
    enum { N = 1000000 };
    static double other[N];
    double limit = 4.5 / sqrt(N);
    TEST_ASSERT_DOUBLE_WITHIN(limit, 0.0, correlation(values, values + 1, N));
    TEST_ASSERT_DOUBLE_WITHIN(limit, 0.0, correlation(values, values + 2, N));
    fill(seed, 1, N, other);
    TEST_ASSERT_DOUBLE_WITHIN(limit, 0.0, correlation(values, other, N));
    fill(seed + 1, 0, N, other);
    TEST_ASSERT_DOUBLE_WITHIN(limit, 0.0, correlation(values, other, N));
}

/* Neither the splitting into calls nor anything else but seed and stream matters. */
static void same_seed_same_numbers(void)
{
    static double pieces[10000];
    struct noise_state state;
    noise_init(&state, seed, 0);
    for (size_t done = 0, n = 1; done < 10000; done += n, n = n % 97 + 1) {
        n = n < 10000 - done ? n : 10000 - done;
        noise_gaussian(&table, &state, n, pieces + done);
    }
    TEST_ASSERT_EQUAL_MEMORY(values, pieces, sizeof pieces);
}

/* Bytes of the first million numbers of seed 1, computed once; they must never change, on any machine. Some 260 are from the tail. */
static void first_numbers_of_seed_one_never_change(void)
{
    enum { N = 1000000 };
    static double first[N];
    uint64_t hash = UINT64_C(14695981039346656037);
    fill(1, 0, N, first);
    for (size_t i = 0; i < N; i++) {
        uint64_t bits;
        memcpy(&bits, &first[i], sizeof bits);
        hash = (hash ^ bits) * UINT64_C(1099511628211);
    }
    TEST_ASSERT_EQUAL_HEX64(UINT64_C(0x0F554DDBD4976951), hash);
}

int main(void)
{
    struct random_state random = random_begin("noise", 1);
    seed = random_u64(&random);
    noise_table_init(&table);
    fill(seed, 0, COUNT, values);
    UNITY_BEGIN();
    RUN_TEST(generator_gives_the_published_sequence);
    RUN_TEST(layers_have_equal_area);
    RUN_TEST(moments_are_those_of_a_gaussian);
    RUN_TEST(tails_have_the_right_weight_on_both_sides);
    RUN_TEST(neighbours_streams_and_seeds_are_uncorrelated);
    RUN_TEST(same_seed_same_numbers);
    RUN_TEST(first_numbers_of_seed_one_never_change);
    return UNITY_END();
}
