/* Linear systems over a step against their closed forms, for inputs that are parabolas, and the output filter against the firmware's. */
#include <math.h>

#include "core/output_filter.h"
#include "sim/envelope_filter.h"
#include "sim/linear_map.h"
#include "unity.h"

void setUp(void) {}
void tearDown(void) {}

/* x' = -r x + u, u = 1 + 2 t - 3 t^2 (t in steps of h): the particular solution is a parabola itself. */
static void one_pole_answers_a_parabola(void)
{
    const double r = 40.0, h = 0.02, x0 = 0.3;
    const struct linear_system system = {.states = 1, .inputs = 1, .m = {{-r}}, .b = {{1.0}}};
    struct linear_map map;
    linear_map_build(&system, h, &map);
    double state[1] = {x0};
    double mean[1];
    const struct span input = {1.0, 1.0 + 1.0 - 1.0, 1.0 + 2.0 - 3.0};
    linear_map_step(&map, 1, 1, state, &input, mean);
    double q = r * h; /* in steps: y' = -q y + h u, y = a + b s + c s^2 + d e^(-q s) */
    double c = -3.0 * h / q;
    double b = (2.0 * h - 2.0 * c) / q;
    double a = (1.0 * h - b) / q;
    double d = x0 - a;
    TEST_ASSERT_DOUBLE_WITHIN(1e-14, a + b + c + d * exp(-q), state[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-14, a + b / 2.0 + c / 3.0 + d * (1.0 - exp(-q)) / q, mean[0]);
}

/* An undamped oscillator over many turns. */
static void oscillator_turns_exactly(void)
{
    const double w = 700.0, h = 0.5;
    const struct linear_system system = {.states = 2, .inputs = 1, .m = {{0.0, -w}, {w, 0.0}}, .b = {{0.0}, {0.0}}};
    struct linear_map map;
    linear_map_build(&system, h, &map);
    double state[2] = {1.0, 0.0};
    double mean[2];
    const struct span none = {0.0, 0.0, 0.0};
    linear_map_step(&map, 2, 1, state, &none, mean);
    TEST_ASSERT_DOUBLE_WITHIN(1e-11, cos(w * h), state[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-11, sin(w * h), state[1]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-13, sin(w * h) / (w * h), mean[0]);
}

/* Two equal poles, which no diagonal form has. */
static void double_pole(void)
{
    const double r = 15.0, h = 0.03;
    const struct linear_system system = {.states = 2, .inputs = 1, .m = {{-r, 1.0}, {0.0, -r}}, .b = {{0.0}, {0.0}}};
    struct linear_map map;
    linear_map_build(&system, h, &map);
    double state[2] = {0.5, 2.0};
    double mean[2];
    const struct span none = {0.0, 0.0, 0.0};
    linear_map_step(&map, 2, 1, state, &none, mean);
    TEST_ASSERT_DOUBLE_WITHIN(1e-14, (0.5 + 2.0 * h) * exp(-r * h), state[0]);
}

static void two_inputs_do_not_mix(void)
{
    const struct linear_system system = {
        .states = 4, .inputs = 2, .m = {{-1.0}, {0.0, -2.0}, {0.0}, {0.0}}, .b = {{1.0, 0.0}, {0.0, 1.0}, {0.0}, {0.0}}};
    struct linear_map map;
    linear_map_build(&system, 1.0, &map);
    double state[4] = {0.0};
    double mean[4];
    const struct span input[2] = {{1.0, 1.0, 1.0}, {2.0, 2.0, 2.0}};
    linear_map_step(&map, 4, 2, state, input, mean);
    TEST_ASSERT_DOUBLE_WITHIN(1e-14, 1.0 - exp(-1.0), state[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-14, 1.0 - exp(-2.0), state[1]);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, state[2]);
}

/* What runs late loses nothing: the sum of delayed means of a course that ends at rest is the sum of the means. */
static void delay_keeps_areas(void)
{
    const double values[] = {0.0, 0.3, 1.0, 0.7, -0.2, 0.0, 0.0};
    double sum = 0.0, late_sum = 0.0;
    for (int i = 0; i < 6; i++) {
        struct span course = {values[i], 0.6 * values[i] + 0.3 * values[i + 1], values[i + 1]};
        sum += course.mean;
        late_sum += span_late(course, 0.2).mean;
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-15, sum, late_sum);
}

/* The firmware's filter, fed with the means of each slow tick, in integers of 2^-28. */
static void filter_is_the_firmware_s(uint32_t choice, uint32_t ticks)
{
    struct envelope_filter_map map;
    struct envelope_filter_state state = {{0.0}};
    struct output_filter_state firmware;
    bool overflow = false;
    envelope_filter_build(choice, ticks, &map);
    output_filter_reset(&firmware, 0);
    for (int step = 0; step < 6; step++) {
        double p0 = 0.1 * step, p1 = 0.3, p2 = -0.2; /* jumps from step to step: nothing has to fit together */
        const struct span input = {p0, p0 + p1 / 2.0 + p2 / 3.0, p0 + p1 + p2};
        double sum = 0.0;
        for (uint32_t i = 0; i < ticks; i++) {
            double s = (i + 0.5) / ticks;
            double mean = p0 + s * (p1 + s * p2) + p2 / (12.0 * ticks * ticks);
            sum += ldexp(output_filter_step(choice, &firmware, (int32_t)lround(ldexp(mean, 28)), &overflow), -28);
        }
        TEST_ASSERT_DOUBLE_WITHIN(1e-7, sum / ticks, envelope_filter_step(&map, &state, input));
    }
    TEST_ASSERT_FALSE(overflow);
}

static void every_filter_over_every_length(void)
{
    for (uint32_t choice = OUTPUT_FILTER_NONE; choice < OUTPUT_FILTER_COUNT; choice++) {
        filter_is_the_firmware_s(choice, 1);
        filter_is_the_firmware_s(choice, 20);
        filter_is_the_firmware_s(choice, 100);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(one_pole_answers_a_parabola);
    RUN_TEST(oscillator_turns_exactly);
    RUN_TEST(double_pole);
    RUN_TEST(two_inputs_do_not_mix);
    RUN_TEST(delay_keeps_areas);
    RUN_TEST(every_filter_over_every_length);
    return UNITY_END();
}
