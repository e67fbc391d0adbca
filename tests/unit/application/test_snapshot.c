/* A snapshot holds everything: whoever restores it continues bit by bit. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "unity.h"

#include "application/calibration.h"
#include "application/snapshot.h"
#include "support/gyro_fixture.h"
#include "support/random.h"

#define SNAPSHOT_MAX 2048

void setUp(void)
{
}

void tearDown(void)
{
}

static void write_whole(const struct snapshot *snapshot, uint8_t *bytes)
{
    TEST_ASSERT_TRUE(snapshot_bytes() <= SNAPSHOT_MAX);
    TEST_ASSERT_EQUAL_size_t(snapshot_bytes(), snapshot_write(snapshot, 0, bytes, SNAPSHOT_MAX));
}

/* Every byte of both structures is either padding or makes a difference. Booleans are bytes of 0 or 1. */
#if defined(__has_builtin)
#if __has_builtin(__builtin_clear_padding)
#define CAN_FIND_PADDING
#endif
#endif

#ifdef CAN_FIND_PADDING
static void expect_every_byte_counts(struct snapshot *snapshot, unsigned char *part, const unsigned char *is_value, size_t size)
{
    uint8_t before[SNAPSHOT_MAX], after[SNAPSHOT_MAX];
    for (size_t i = 0; i < size; i++) {
        write_whole(snapshot, before);
        part[i] ^= 1;
        write_whole(snapshot, after);
        part[i] ^= 1;
        bool counts = memcmp(before, after, snapshot_bytes()) != 0;
        char message[80];
        snprintf(message, sizeof message, "byte %zu of %zu is not in the table of snapshot.c", i, size);
        TEST_ASSERT_EQUAL_MESSAGE(is_value[i] != 0, counts, message);
    }
}
#endif

static void no_field_is_forgotten(void)
{
#ifdef CAN_FIND_PADDING
    static struct snapshot snapshot;
    static struct gyro_cfg cfg_values;
    static struct gyro_state state_values;
    memset(&snapshot, 0, sizeof snapshot);
    memset(&cfg_values, 0xFF, sizeof cfg_values);
    memset(&state_values, 0xFF, sizeof state_values);
    __builtin_clear_padding(&cfg_values);
    __builtin_clear_padding(&state_values);
    expect_every_byte_counts(&snapshot, (unsigned char *)&snapshot.cfg, (unsigned char *)&cfg_values, sizeof cfg_values);
    expect_every_byte_counts(&snapshot, (unsigned char *)&snapshot.state, (unsigned char *)&state_values, sizeof state_values);
#else
    TEST_IGNORE_MESSAGE("this compiler cannot tell padding from fields");
#endif
}

/* ---- a gyro on a small plant ------------------------------------------------------------------------------------------- */

struct run {
    struct fixture_device device;
    struct fixture_plant plant;
    struct random_state noise;
    uint64_t sample;
    struct snapshot gyro;
};

static struct run *run_create(uint32_t compensation)
{
    struct run *run = calloc(1, sizeof *run);
    TEST_ASSERT_NOT_NULL(run);
    run->device = fixture_default();
    run->device.bias_rad_s = 2e-3;
    run->device.rate_rad_s = 0.05;
    run->device.freq_hz = 5020.0;
    run->device.compensation = compensation;
    run->noise.counter = 99;
    fixture_plant_init(&run->plant, &run->device);
    run->gyro.cfg = fixture_cfg(&run->device);
    run->gyro.cfg.thermometer.shift_min_q20 = -(100 << 20); /* like from a block */
    run->gyro.cfg.thermometer.shift_max_q20 = 100 << 20;
    run->gyro.cfg.drive.freq_min_u64 = run->gyro.cfg.acquisition.freq_start_u64;
    run->gyro.cfg.drive.freq_max_u64 = run->gyro.cfg.acquisition.freq_end_u64;
    run->gyro.cfg.bias_rad_s_q31.coef[1] = 1 << 24;
    run->gyro.cfg.bias_rad_s_q31.order = 1;
    gyro_reset(&run->gyro.cfg, &run->gyro.state);
    return run;
}

/* A thermometer that moves, and fails now and then. */
static int32_t thermometer_at(uint64_t sample)
{
    return sample % 70000 > 65000 ? GYRO_THERMOMETER_INVALID : (int32_t)(sample / 37);
}

static struct gyro_input next_input(struct run *run)
{
    struct gyro_input input = {
        fixture_adc_q31(&run->device, run->plant.x1, random_gauss(&run->noise)),
        fixture_adc_q31(&run->device, run->plant.x2, random_gauss(&run->noise)),
        thermometer_at(run->sample++),
    };
    return input;
}

/* Both gyros get the inputs of the first one's plant; they must agree in every output and every published signal. */
static void expect_equal_for(struct run *run, struct snapshot *other, int samples)
{
    for (int i = 0; i < samples; i++) {
        struct gyro_input input = next_input(run);
        struct gyro_output a = gyro_step(&run->gyro.cfg, &run->gyro.state, &input);
        struct gyro_output b = gyro_step(&other->cfg, &other->state, &input);
        TEST_ASSERT_EQUAL_INT32(a.drive_q31, b.drive_q31);
        TEST_ASSERT_EQUAL_INT32(a.rebalance_q31, b.rebalance_q31);
        TEST_ASSERT_EQUAL(a.slow_tick, b.slow_tick);
        fixture_plant_step(&run->plant, a.drive_q31, a.rebalance_q31);
    }
    uint8_t mine[SNAPSHOT_MAX], theirs[SNAPSHOT_MAX];
    write_whole(&run->gyro, mine);
    write_whole(other, theirs);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(mine, theirs, snapshot_bytes());
}

static void advance(struct run *run, int samples)
{
    for (int i = 0; i < samples; i++) {
        struct gyro_input input = next_input(run);
        struct gyro_output output = gyro_step(&run->gyro.cfg, &run->gyro.state, &input);
        fixture_plant_step(&run->plant, output.drive_q31, output.rebalance_q31);
    }
}

/* Taken in the chirp, while listening, in the ring-up and in lock, at odd samples of the slow period; the restored one lives in
 * memory that was full of something else. */
static void restored_gyros_continue_bit_by_bit(void)
{
    static const int pauses[] = {3, 4011, 5003, 6007, 9013, 30017};
    for (uint32_t compensation = 0; compensation < GYRO_COMPENSATION_COUNT; compensation++) {
        struct run *run = run_create(compensation);
        for (size_t i = 0; i < sizeof pauses / sizeof pauses[0]; i++) {
            static struct snapshot restored;
            uint8_t bytes[SNAPSHOT_MAX];
            advance(run, pauses[i]);
            run->gyro.sample_counter = run->sample;
            write_whole(&run->gyro, bytes);
            memset(&restored, 0xA5, sizeof restored);
            TEST_ASSERT_EQUAL_INT(0, snapshot_read(bytes, snapshot_bytes(), &restored));
            TEST_ASSERT_EQUAL_UINT64(run->sample, restored.sample_counter);
            expect_equal_for(run, &restored, 2000);
        }
        TEST_ASSERT_TRUE((run->gyro.state.signals.status & GYRO_STATUS_ACQUIRING) == 0);
        free(run);
    }
}

static void chunks_are_the_whole(void)
{
    struct run *run = run_create(GYRO_COMPENSATION_G2);
    uint8_t whole[SNAPSHOT_MAX], chunked[SNAPSHOT_MAX];
    advance(run, 12345);
    write_whole(&run->gyro, whole);
    for (size_t size = 1; size < 300; size += 7) {
        size_t at = 0;
        while (at < snapshot_bytes()) {
            size_t count = snapshot_write(&run->gyro, at, chunked + at, size);
            TEST_ASSERT_TRUE(count > 0 && count <= size);
            at += count;
        }
        TEST_ASSERT_EQUAL_size_t(snapshot_bytes(), at);
        TEST_ASSERT_EQUAL_HEX8_ARRAY(whole, chunked, snapshot_bytes());
    }
    TEST_ASSERT_EQUAL_size_t(0, snapshot_write(&run->gyro, snapshot_bytes(), chunked, 10));
    free(run);
}

static void other_versions_and_sizes_are_refused(void)
{
    static struct snapshot snapshot;
    uint8_t bytes[SNAPSHOT_MAX] = {0};
    struct run *run = run_create(GYRO_COMPENSATION_G2);
    write_whole(&run->gyro, bytes);
    free(run);
    TEST_ASSERT_EQUAL_INT(0, snapshot_read(bytes, snapshot_bytes(), &snapshot));
    TEST_ASSERT_EQUAL_INT(REASON_SNAPSHOT_VERSION, snapshot_read(bytes, snapshot_bytes() - 1, &snapshot));
    TEST_ASSERT_EQUAL_INT(REASON_SNAPSHOT_VERSION, snapshot_read(bytes, snapshot_bytes() + 1, &snapshot));
    TEST_ASSERT_EQUAL_INT(REASON_SNAPSHOT_VERSION, snapshot_read(bytes, 0, &snapshot));
    bytes[0] ^= 1;
    TEST_ASSERT_EQUAL_INT(REASON_SNAPSHOT_VERSION, snapshot_read(bytes, snapshot_bytes(), &snapshot));
}

static void expect_refused(const struct snapshot *changed)
{
    static struct snapshot target;
    uint8_t bytes[SNAPSHOT_MAX], before[SNAPSHOT_MAX], after[SNAPSHOT_MAX];
    write_whole(&target, before);
    write_whole(changed, bytes);
    TEST_ASSERT_EQUAL_INT(REASON_SNAPSHOT_RANGE, snapshot_read(bytes, snapshot_bytes(), &target));
    write_whole(&target, after);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(before, after, snapshot_bytes());
}

/* A damaged file must not make the signal processing divide by zero, shift too far or leave a table. */
static void counts_shifts_and_choices_outside_their_range_are_refused(void)
{
    struct run *run = run_create(GYRO_COMPENSATION_G2);
    struct snapshot *gyro = &run->gyro;
    uint32_t *const words[] = {
        &gyro->cfg.lockin.decimation, &gyro->cfg.acquisition.decimation, &gyro->cfg.loops_per_slow, &gyro->cfg.acquisition.chirp_ticks_log2,
        &gyro->cfg.acquisition.listen_ticks_log2, &gyro->cfg.output_filter, &gyro->cfg.loop, &gyro->cfg.compensation, &gyro->cfg.dac_shift,
    };
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        uint32_t right = *words[i];
        *words[i] = 200;
        expect_refused(gyro);
        *words[i] = right;
    }
    gyro->cfg.lockin.decimation = gyro->cfg.acquisition.decimation = 0;
    expect_refused(gyro);
    free(run);
}

/* Each number alone, in a gyro that is in lock: one beyond the bound of the range proof that begins from it. */
static void numbers_that_no_range_proof_allows_are_refused(void)
{
    struct run *run = run_create(GYRO_COMPENSATION_G2);
    advance(run, 60000);
    struct gyro_state *state = &run->gyro.state;
    const struct {
        void *word;
        int64_t value;
        bool wide;
    } wrong[] = {
        {&state->primary_lockin.in_phase.sum, INT64_C(1) << 61, true},
        {&state->secondary_lockin.quadrature.sum, -(INT64_C(1) << 62), true},
        {&run->gyro.cfg.lockin.reference_shift, 4, false},
        {&state->decoupler.next_q61, INT64_C(1) << 62, true},
        {&state->decoupler.after_q61, INT64_C(1) << 61, true},
        {&state->decoupler_coefs.minus_gain_q48, INT32_MAX, false},
        {&state->decoupler_coefs.minus_r2_q30, 1, false},
        {&state->decoupler_coefs.a1_q30, INT32_MIN, false},
        {&state->dac_mask, 0xFFFE, false},
        {&state->drive.drive_integral_q54, -1, true},
        {&state->rebalance.in_phase.integral_q54, INT64_MAX, true},
        {&state->drive_shaper.error1, (1 << 23) + 1, false},
        {&state->rate.removed_rad_s_q46, INT64_C(1) << 60, true},
        {&state->filter.memory[1].after, INT64_MAX / 2, true},
        {&state->gain_step_q48, INT32_MIN, false},
        {&state->drive_lead.cosine_q30, INT32_MIN, false},
        {&state->demodulation.sine_q30, INT32_MAX, false},
        {&state->drive_force.cosine_q31, INT32_MIN, false},
        {&state->rebalance_force.sine_q31, INT32_MIN, false},
        {&state->primary_sum.i_q30, INT64_C(1) << 40, true},
        {&state->rebalance_sum.q_q30, -(INT64_C(1) << 33), true},
        {&state->acquisition.attempt, 7, false},
        {&state->acquisition.phase, 4, false},
        {&state->loop_slot, 10, false},
        {&state->slow_slot, 5, false},
        {&state->blank_ticks, -1, false},
        {&state->loop, 2, false},
        {&run->gyro.cfg.lockin.normalise_q31, INT32_MAX, false},
        {&run->gyro.cfg.tuning.center_2cos_q40, INT64_C(1) << 50, true},
        {&run->gyro.cfg.test_signal.in_phase_q31, INT32_MIN, false},
        {&run->gyro.cfg.drive.freq_min_u64, 0, true},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        const struct snapshot right = run->gyro;
        if (wrong[i].wide) {
            *(int64_t *)wrong[i].word = wrong[i].value;
        } else {
            *(int32_t *)wrong[i].word = (int32_t)wrong[i].value;
        }
        expect_refused(&run->gyro);
        run->gyro = right;
    }
    free(run);
}

/* While it listens the sums hang together: each of them is possible, one beside the others is not. */
static void a_ringing_that_cannot_have_been_heard_is_refused(void)
{
    struct run *run = run_create(GYRO_COMPENSATION_G2);
    static struct snapshot taken;
    uint8_t bytes[SNAPSHOT_MAX];
    while (run->gyro.state.acquisition.phase != ACQUISITION_LISTEN || run->gyro.state.acquisition.tick < 300) {
        advance(run, 1);
    }
    write_whole(&run->gyro, bytes);
    TEST_ASSERT_EQUAL_INT(REASON_OK, snapshot_read(bytes, snapshot_bytes(), &taken));
    struct acquisition_state *heard = &run->gyro.state.acquisition;
    int64_t most = (INT64_C(1) << 31) << 16; /* 2^31 M^2 with M = 2^8 */
    int64_t *const sums[] = {&heard->half_sum[0], &heard->half_sum[1], &heard->unwrapped};
    for (size_t i = 0; i < sizeof sums / sizeof sums[0]; i++) {
        int64_t right = *sums[i];
        *sums[i] += 2 * most;
        expect_refused(&run->gyro);
        *sums[i] = right - 2 * most;
        expect_refused(&run->gyro);
        *sums[i] = right;
    }
    heard->tick = 512; /* it would have ended by then */
    expect_refused(&run->gyro);
    free(run);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(no_field_is_forgotten);
    RUN_TEST(restored_gyros_continue_bit_by_bit);
    RUN_TEST(chunks_are_the_whole);
    RUN_TEST(other_versions_and_sizes_are_refused);
    RUN_TEST(counts_shifts_and_choices_outside_their_range_are_refused);
    RUN_TEST(numbers_that_no_range_proof_allows_are_refused);
    RUN_TEST(a_ringing_that_cannot_have_been_heard_is_refused);
    return UNITY_END();
}
