/* Every command, and every way to refuse it: a reason comes back, nothing changes, it is counted. */
#include <string.h>

#include "unity.h"

#include "application/application.h"
#include "application/bytes.h"
#include "application/commands.h"
#include "application/limits.h"
#include "support/board.h"

static struct board *board;
static struct application app;
static uint16_t sequence;

void setUp(void)
{
    board = board_create();
    TEST_ASSERT_EQUAL_INT(0, application_init(&app, &board->hal));
    sequence = 100;
}

void tearDown(void)
{
    TEST_ASSERT_EQUAL_UINT32(0, board->bad_manners);
    board_destroy(board);
}

static void run_samples(uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        int32_t adc[2] = {(int32_t)(i % 7) * 1000, (int32_t)(i % 5) * 10}, dac[2];
        application_sample(&app, adc, dac);
    }
}

/* Sends one command, polls, and returns the reason of its acknowledgement. */
static enum reason send(uint8_t type, const uint8_t *payload, size_t payload_bytes)
{
    static struct frame_receiver receiver;
    struct frame_view ack;
    board_command(board, type, ++sequence, payload, payload_bytes);
    application_poll(&app);
    TEST_ASSERT_TRUE(board_last_frame(board, FRAME_ACK, &receiver, &ack));
    TEST_ASSERT_EQUAL_size_t(4, ack.payload_bytes);
    TEST_ASSERT_EQUAL_HEX8(type, board_field(&ack, 0, 1));
    TEST_ASSERT_EQUAL_UINT16(sequence, board_field(&ack, 2, 2));
    return (enum reason)board_field(&ack, 1, 1);
}

static enum reason send_words(uint8_t type, size_t words, const uint32_t *values)
{
    uint8_t payload[16];
    struct byte_writer writer = {payload};
    for (size_t i = 0; i < words; i++) {
        put_u32(&writer, values[i]);
    }
    return send(type, payload, 4 * words);
}

static enum reason send_word(uint8_t type, uint32_t value)
{
    return send_words(type, 1, &value);
}

static void expect_accepted(enum reason reason)
{
    TEST_ASSERT_EQUAL_INT(REASON_OK, reason);
}

/* Refused with this reason, and neither the wanted nor the active configuration has changed. */
static void expect_refused(enum reason expected, uint8_t type, const uint8_t *payload, size_t payload_bytes)
{
    static struct calibration before;
    uint32_t refused = app.counters.commands_refused;
    memcpy(&before, &app.calibration, sizeof before);
    TEST_ASSERT_EQUAL_INT(expected, send(type, payload, payload_bytes));
    TEST_ASSERT_EQUAL_UINT32(refused + 1, app.counters.commands_refused);
    TEST_ASSERT_EQUAL_INT(0, memcmp(&before, &app.calibration, sizeof before));
    TEST_ASSERT_FALSE(app.cfg_changed);
    TEST_ASSERT_EQUAL_UINT32(0, atomic_load(&app.requests));
}

static void expect_words_refused(enum reason expected, uint8_t type, size_t words, const uint32_t *values)
{
    uint8_t payload[16];
    struct byte_writer writer = {payload};
    for (size_t i = 0; i < words; i++) {
        put_u32(&writer, values[i]);
    }
    expect_refused(expected, type, payload, 4 * words);
}

static void settle(void)
{
    run_samples(100);
    application_poll(&app);
}

static void ping_is_answered_by_an_identity(void)
{
    static struct frame_receiver receiver;
    struct frame_view identity;
    board->out_count = 0;
    expect_accepted(send(COMMAND_PING, NULL, 0));
    TEST_ASSERT_TRUE(board_last_frame(board, FRAME_IDENTITY, &receiver, &identity));
    TEST_ASSERT_EQUAL_HEX64(board->properties.unique_id, board_field(&identity, 14, 8));
    TEST_ASSERT_EQUAL_UINT32(50000000, board_field(&identity, 22, 4));
    TEST_ASSERT_EQUAL_UINT32(16, board_field(&identity, 26, 1));
}

static void status_counts_and_latches(void)
{
    static struct frame_receiver receiver;
    struct frame_view status;
    int32_t full[2] = {32767, 0}, dac[2];
    for (int i = 0; i < 100; i++) {
        application_sample(&app, full, dac);
    }
    run_samples(100);
    expect_accepted(send(COMMAND_STATUS, NULL, 0));
    TEST_ASSERT_TRUE(board_last_frame(board, FRAME_STATUS, &receiver, &status));
    TEST_ASSERT_EQUAL_UINT64(42, board_field(&status, 0, 8));
    TEST_ASSERT_EQUAL_HEX32(0, board_field(&status, 8, 4) & GYRO_STATUS_ADC_SATURATED);
    TEST_ASSERT_EQUAL_HEX32(GYRO_STATUS_ADC_SATURATED, board_field(&status, 12, 4) & GYRO_STATUS_ADC_SATURATED);
    TEST_ASSERT_EQUAL_HEX32(GYRO_STATUS_ACQUIRING, board_field(&status, 16, 4) & GYRO_STATUS_ACQUIRING);
    run_samples(100);
    expect_accepted(send(COMMAND_STATUS, NULL, 0));
    TEST_ASSERT_TRUE(board_last_frame(board, FRAME_STATUS, &receiver, &status));
    TEST_ASSERT_EQUAL_HEX32(0, board_field(&status, 12, 4) & GYRO_STATUS_ADC_SATURATED);
    TEST_ASSERT_EQUAL_UINT32(1, board_field(&status, 46, 4)); /* the first status command */
}

static void frames_that_are_no_commands(void)
{
    uint8_t zeros[16] = {0};
    expect_refused(REASON_UNKNOWN_COMMAND, 0x80, NULL, 0);
    expect_refused(REASON_UNKNOWN_COMMAND, FRAME_OUTPUT, NULL, 0);
    expect_refused(REASON_LENGTH, COMMAND_PING, zeros, 1);
    expect_refused(REASON_LENGTH, COMMAND_STATUS, zeros, 1);
    expect_refused(REASON_LENGTH, COMMAND_COMPENSATION, zeros, 3);
    expect_refused(REASON_LENGTH, COMMAND_AMPLITUDE, zeros, 5);
    expect_refused(REASON_LENGTH, COMMAND_PLL_GAINS, zeros, 4);
    expect_refused(REASON_LENGTH, COMMAND_AGC_GAINS, zeros, 12);
    expect_refused(REASON_LENGTH, COMMAND_OUTPUT_FILTER, zeros, 0);
    expect_refused(REASON_LENGTH, COMMAND_DIVISORS, zeros, 2);
    expect_refused(REASON_LENGTH, COMMAND_RAW_BURST, zeros, 0);
    expect_refused(REASON_LENGTH, COMMAND_RESTART, zeros, 1);
    expect_refused(REASON_LENGTH, COMMAND_LOOP, zeros, 1);
    expect_refused(REASON_LENGTH, COMMAND_REBALANCE, zeros, 12);
    expect_refused(REASON_LENGTH, COMMAND_TEST_SIGNAL, zeros, 8);
    expect_refused(REASON_LENGTH, COMMAND_PHASE_SET_POINT, zeros, 8);
    expect_refused(REASON_LENGTH, COMMAND_DRIVE, zeros, 3);
    expect_refused(REASON_LENGTH, COMMAND_CALIBRATION_UNLOCK, zeros, 0);
    expect_refused(REASON_LENGTH, COMMAND_CALIBRATION_COMMIT, zeros, 0);
    expect_refused(REASON_LENGTH, COMMAND_CALIBRATION_READ, zeros, 1);
}

static void another_frame_version_is_refused(void)
{
    static struct frame_buffer buffer;
    static struct frame_receiver receiver;
    struct frame_view ack;
    struct frame_header header = {FRAME_VERSION + 1, COMMAND_PING, 9, 0};
    size_t count = frame_encode(&buffer, &header, 0);
    memcpy(board->in, buffer.encoded, count);
    board->in_count = count;
    application_poll(&app);
    TEST_ASSERT_TRUE(board_last_frame(board, FRAME_ACK, &receiver, &ack));
    TEST_ASSERT_EQUAL_INT(REASON_FRAME_VERSION, board_field(&ack, 1, 1));
}

/* Nobody can tell whom a damaged frame was meant for: it is counted, and not answered. */
static void damaged_frames_are_counted_and_not_answered(void)
{
    static struct frame_receiver receiver;
    struct frame_view ack;
    board_command(board, COMMAND_RESTART, 1, NULL, 0);
    board->in[3] ^= 0x10;
    application_poll(&app);
    TEST_ASSERT_FALSE(board_last_frame(board, FRAME_ACK, &receiver, &ack));
    TEST_ASSERT_EQUAL_UINT32(1, app.receiver.errors);
    TEST_ASSERT_EQUAL_UINT32(0, app.restart_wanted);
}

static void settings_take_effect_at_a_slow_tick(void)
{
    expect_accepted(send_word(COMMAND_COMPENSATION, GYRO_COMPENSATION_G2));
    TEST_ASSERT_EQUAL_UINT32(GYRO_COMPENSATION_NONE, app.cfg->compensation);
    run_samples(50);
    TEST_ASSERT_EQUAL_UINT32(GYRO_COMPENSATION_G2, app.cfg->compensation);
    expect_accepted(send_word(COMMAND_OUTPUT_FILTER, OUTPUT_FILTER_0_1));
    expect_accepted(send_word(COMMAND_AMPLITUDE, 1 << 29));
    expect_accepted(send_words(COMMAND_PLL_GAINS, 2, (uint32_t[]){1000, 20}));
    expect_accepted(send_words(COMMAND_AGC_GAINS, 2, (uint32_t[]){3000, 40}));
    expect_accepted(send_word(COMMAND_PHASE_SET_POINT, (uint32_t)-1000));
    expect_accepted(send_word(COMMAND_DRIVE, 0));
    settle();
    settle();
    TEST_ASSERT_EQUAL_UINT32(GYRO_COMPENSATION_G2, app.cfg->compensation);
    TEST_ASSERT_EQUAL_UINT32(OUTPUT_FILTER_0_1, app.cfg->output_filter);
    TEST_ASSERT_EQUAL_INT32(1 << 29, app.cfg->drive.amplitude_q30);
    TEST_ASSERT_EQUAL_UINT32(1000, app.cfg->drive.pll_proportional_q32);
    TEST_ASSERT_EQUAL_UINT32(20, app.cfg->drive.pll_integral_q32);
    TEST_ASSERT_EQUAL_INT32(3000, app.cfg->drive.agc_proportional_q16);
    TEST_ASSERT_EQUAL_INT32(40, app.cfg->drive.agc_integral_q24);
    TEST_ASSERT_EQUAL_INT32(-1000, app.cfg->drive.phase_set_point_i32);
    TEST_ASSERT_TRUE(app.cfg->drive.off);
    TEST_ASSERT_EQUAL_UINT32(7, app.counters.commands_accepted);
    expect_accepted(send_word(COMMAND_DRIVE, 1));
    settle();
    settle();
    TEST_ASSERT_FALSE(app.cfg->drive.off);
}

/* The amplitude limit is a part of the set-point: it moves with it and comes back exactly. */
static void amplitude_limit_follows_the_set_point(void)
{
    int32_t amplitude = app.calibration.gyro.drive.amplitude_q30, limit = app.calibration.gyro.monitor.amplitude_limit_q30;
    for (int i = 0; i < 5; i++) {
        expect_accepted(send_word(COMMAND_AMPLITUDE, AMPLITUDE_MIN_Q30));
        TEST_ASSERT_INT_WITHIN(1, (int64_t)limit * AMPLITUDE_MIN_Q30 / amplitude, app.calibration.gyro.monitor.amplitude_limit_q30);
        expect_accepted(send_word(COMMAND_AMPLITUDE, (uint32_t)amplitude));
        TEST_ASSERT_EQUAL_INT32(limit, app.calibration.gyro.monitor.amplitude_limit_q30);
    }
}

static void parameters_out_of_range_are_refused(void)
{
    settle();
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_COMPENSATION, 1, (uint32_t[]){GYRO_COMPENSATION_COUNT});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_OUTPUT_FILTER, 1, (uint32_t[]){OUTPUT_FILTER_COUNT});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_AMPLITUDE, 1, (uint32_t[]){AMPLITUDE_MIN_Q30 - 1});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_AMPLITUDE, 1, (uint32_t[]){AMPLITUDE_MAX_Q30 + 1});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_AMPLITUDE, 1, (uint32_t[]){0x80000000});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_PLL_GAINS, 2, (uint32_t[]){0, 0});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_PLL_GAINS, 2, (uint32_t[]){PLL_PROPORTIONAL_MAX_Q32 + 1, 0});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_PLL_GAINS, 2, (uint32_t[]){1, UINT32_MAX});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_AGC_GAINS, 2, (uint32_t[]){0, 0});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_AGC_GAINS, 2, (uint32_t[]){AGC_PROPORTIONAL_MAX_Q16 + 1, 0});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_AGC_GAINS, 2, (uint32_t[]){1, (uint32_t)-1});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_RAW_BURST, 1, (uint32_t[]){0});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_RAW_BURST, 1, (uint32_t[]){BURST_MAX_SAMPLES + 1});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_LOOP, 1, (uint32_t[]){GYRO_LOOP_REBALANCE}); /* no gains yet */
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_LOOP, 1, (uint32_t[]){GYRO_LOOP_COUNT});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_REBALANCE, 4, (uint32_t[]){0, 0, 1, 0});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_REBALANCE, 4, (uint32_t[]){1, (uint32_t)-1, 1, 0});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_REBALANCE, 4, (uint32_t[]){1, 0, DRIVE_MAX_Q31, DRIVE_MAX_Q31});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_TEST_SIGNAL, 3, (uint32_t[]){0x80000000, 0, 0});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_TEST_SIGNAL, 3, (uint32_t[]){0, DRIVE_MAX_Q31 + 1, 0});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_TEST_SIGNAL, 3, (uint32_t[]){0, 0, UINT32_MAX});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_PHASE_SET_POINT, 1, (uint32_t[]){PHASE_SET_POINT_MAX_I32 + 1});
    expect_words_refused(REASON_OUT_OF_RANGE, COMMAND_DRIVE, 1, (uint32_t[]){2});
    settle();
    TEST_ASSERT_EQUAL_UINT32(0, app.counters.commands_accepted);
}

static void rebalance_and_test_force(void)
{
    app.calibration.gyro.rebalance_scale_rad_s_q28.coef[0] = 1000;
    expect_accepted(send_words(COMMAND_REBALANCE, 4, (uint32_t[]){65536, 100, 0x40000000, 0x20000000}));
    expect_accepted(send_word(COMMAND_LOOP, GYRO_LOOP_REBALANCE));
    expect_accepted(send_words(COMMAND_TEST_SIGNAL, 3, (uint32_t[]){(uint32_t)-5, 6, 7}));
    settle();
    settle();
    TEST_ASSERT_EQUAL_UINT32(GYRO_LOOP_REBALANCE, app.cfg->loop);
    TEST_ASSERT_EQUAL_INT32(0x20000000, app.cfg->rebalance.quadrature_limit_q31);
    TEST_ASSERT_EQUAL_INT32(-5, app.cfg->test_signal.in_phase_q31);
    TEST_ASSERT_EQUAL_UINT32(7, app.cfg->test_signal.freq_u32);
}

static void restart_begins_acquisition_again(void)
{
    run_samples(10000);
    TEST_ASSERT_NOT_EQUAL(ACQUISITION_CHIRP, app.gyro.acquisition.phase);
    uint64_t samples = app.sample_counter;
    expect_accepted(send(COMMAND_RESTART, NULL, 0));
    run_samples(50);
    TEST_ASSERT_EQUAL_UINT32(ACQUISITION_CHIRP, app.gyro.acquisition.phase);
    TEST_ASSERT_EQUAL_UINT64(samples + 50, app.sample_counter);
}

static void nothing_changes_during_a_burst(void)
{
    expect_accepted(send_word(COMMAND_RAW_BURST, 1000));
    settle();
    TEST_ASSERT_TRUE(app.burst.remaining > 0);
    expect_words_refused(REASON_BUSY, COMMAND_COMPENSATION, 1, (uint32_t[]){GYRO_COMPENSATION_G2});
    expect_words_refused(REASON_BUSY, COMMAND_AMPLITUDE, 1, (uint32_t[]){1 << 29});
    expect_words_refused(REASON_BUSY, COMMAND_PLL_GAINS, 2, (uint32_t[]){1, 1});
    expect_words_refused(REASON_BUSY, COMMAND_AGC_GAINS, 2, (uint32_t[]){1, 1});
    expect_words_refused(REASON_BUSY, COMMAND_OUTPUT_FILTER, 1, (uint32_t[]){0});
    expect_words_refused(REASON_BUSY, COMMAND_RAW_BURST, 1, (uint32_t[]){10});
    expect_refused(REASON_BUSY, COMMAND_RESTART, NULL, 0);
    expect_accepted(send_words(COMMAND_DIVISORS, 1, (uint32_t[]){0}));
    expect_accepted(send(COMMAND_PING, NULL, 0));
}

/* ---- calibration ------------------------------------------------------------------------------------------------------- */

static void unlock(void)
{
    expect_accepted(send_word(COMMAND_CALIBRATION_UNLOCK, command_unlock_key(board->properties.unique_id)));
}

static enum reason write_part(const uint8_t *block, uint16_t offset, size_t count)
{
    uint8_t payload[2 + CALIBRATION_BYTES];
    struct byte_writer writer = {payload};
    put_u16(&writer, offset);
    put_bytes(&writer, block + offset, count);
    return send(COMMAND_CALIBRATION_WRITE, payload, 2 + count);
}

static enum reason write_and_commit(const uint8_t *block)
{
    unlock();
    for (uint16_t at = 0; at < CALIBRATION_BYTES; at = (uint16_t)(at + 56)) {
        expect_accepted(write_part(block, at, 56));
    }
    return send_word(COMMAND_CALIBRATION_COMMIT, CALIBRATION_BYTES);
}

/* CRC-32 of EF CD AB 89 67 45 23 01 by zlib. */
static void the_key_is_the_checksum_of_the_id(void)
{
    TEST_ASSERT_EQUAL_HEX32(0x443BE247, command_unlock_key(UINT64_C(0x0123456789ABCDEF)));
}

static void calibration_is_locked_at_first(void)
{
    uint8_t block[CALIBRATION_BYTES], payload[3] = {0};
    block_default(block);
    expect_refused(REASON_LOCKED, COMMAND_CALIBRATION_WRITE, payload, 3);
    expect_words_refused(REASON_LOCKED, COMMAND_CALIBRATION_COMMIT, 1, (uint32_t[]){CALIBRATION_BYTES});
    expect_words_refused(REASON_WRONG_KEY, COMMAND_CALIBRATION_UNLOCK, 1, (uint32_t[]){12345});
    unlock();
    expect_words_refused(REASON_WRONG_KEY, COMMAND_CALIBRATION_UNLOCK, 1, (uint32_t[]){12345});
    expect_refused(REASON_LOCKED, COMMAND_CALIBRATION_WRITE, payload, 3);
    TEST_ASSERT_EQUAL_UINT32(0, board->operations);
}

static void chunks_outside_the_block_are_refused(void)
{
    uint8_t payload[200] = {0};
    unlock();
    expect_refused(REASON_LENGTH, COMMAND_CALIBRATION_WRITE, payload, 0);
    expect_refused(REASON_LENGTH, COMMAND_CALIBRATION_WRITE, payload, 2);
    payload[0] = CALIBRATION_BYTES & 0xFF;
    payload[1] = CALIBRATION_BYTES >> 8;
    expect_refused(REASON_OUT_OF_RANGE, COMMAND_CALIBRATION_WRITE, payload, 3);
    payload[0] = payload[1] = 0xFF;
    expect_refused(REASON_OUT_OF_RANGE, COMMAND_CALIBRATION_WRITE, payload, 200);
}

static void a_sound_block_is_stored_and_activated(void)
{
    static struct frame_receiver receiver;
    struct frame_view frame;
    uint8_t block[CALIBRATION_BYTES];
    run_samples(10000);
    block_default(block);
    block_set(block, BLOCK_SERIAL, 77, 4);
    block_set(block, BLOCK_COMPENSATION, GYRO_COMPENSATION_STATIC, 4);
    block_seal(block);
    expect_accepted(write_and_commit(block));
    TEST_ASSERT_TRUE(board_last_frame(board, FRAME_IDENTITY, &receiver, &frame));
    TEST_ASSERT_EQUAL_UINT32(77, board_field(&frame, 36, 4));
    run_samples(50);
    TEST_ASSERT_EQUAL_UINT32(GYRO_COMPENSATION_STATIC, app.cfg->compensation);
    TEST_ASSERT_TRUE(app.cfg->calibration_valid);
    TEST_ASSERT_EQUAL_UINT32(ACQUISITION_CHIRP, app.gyro.acquisition.phase);
    TEST_ASSERT_FALSE(app.calibration_unlocked);
    expect_accepted(send(COMMAND_CALIBRATION_READ, NULL, 0));
    TEST_ASSERT_TRUE(board_last_frame(board, FRAME_CALIBRATION, &receiver, &frame));
    TEST_ASSERT_EQUAL_size_t(CALIBRATION_BYTES, frame.payload_bytes);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(block, frame.payload, CALIBRATION_BYTES);
}

/* Every check comes before the flash is touched. */
static void an_unsound_block_is_refused_before_it_is_stored(void)
{
    uint8_t block[CALIBRATION_BYTES];
    static const struct {
        size_t offset;
        uint64_t value;
        unsigned width;
        enum reason reason;
    } faults[] = {
        {BLOCK_MAGIC, 0, 4, REASON_CALIBRATION_MAGIC},
        {BLOCK_VERSION, 9, 2, REASON_CALIBRATION_VERSION},
        {BLOCK_CHIRP, 99, 4, REASON_CALIBRATION_RANGE},
        {BLOCK_DECIMATION, 16, 4, REASON_CALIBRATION_CONFLICT},
    };
    for (size_t i = 0; i < sizeof faults / sizeof faults[0]; i++) {
        block_default(block);
        block_set(block, faults[i].offset, faults[i].value, faults[i].width);
        block_seal(block);
        TEST_ASSERT_EQUAL_INT(faults[i].reason, write_and_commit(block));
    }
    block_default(block);
    block[100] ^= 1;
    TEST_ASSERT_EQUAL_INT(REASON_CALIBRATION_CRC, write_and_commit(block));
    expect_words_refused(REASON_CALIBRATION_SIZE, COMMAND_CALIBRATION_COMMIT, 1, (uint32_t[]){CALIBRATION_BYTES - 1});
    TEST_ASSERT_EQUAL_UINT32(0, board->operations);
    TEST_ASSERT_EQUAL_INT(CALIBRATION_COMPILED_IN, app.calibration_source);
    expect_refused(REASON_NOTHING_STORED, COMMAND_CALIBRATION_READ, NULL, 0);
}

static void a_failing_store_keeps_the_old_calibration(void)
{
    uint8_t block[CALIBRATION_BYTES];
    block_default(block);
    board->cut_at = 3;
    TEST_ASSERT_EQUAL_INT(REASON_STORE_FAILED, write_and_commit(block));
    TEST_ASSERT_EQUAL_UINT32(1, app.counters.store_errors);
    TEST_ASSERT_EQUAL_INT(CALIBRATION_COMPILED_IN, app.calibration_source);
    TEST_ASSERT_FALSE(app.cfg_changed);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(ping_is_answered_by_an_identity);
    RUN_TEST(status_counts_and_latches);
    RUN_TEST(frames_that_are_no_commands);
    RUN_TEST(another_frame_version_is_refused);
    RUN_TEST(damaged_frames_are_counted_and_not_answered);
    RUN_TEST(settings_take_effect_at_a_slow_tick);
    RUN_TEST(amplitude_limit_follows_the_set_point);
    RUN_TEST(parameters_out_of_range_are_refused);
    RUN_TEST(rebalance_and_test_force);
    RUN_TEST(restart_begins_acquisition_again);
    RUN_TEST(nothing_changes_during_a_burst);
    RUN_TEST(the_key_is_the_checksum_of_the_id);
    RUN_TEST(calibration_is_locked_at_first);
    RUN_TEST(chunks_outside_the_block_are_refused);
    RUN_TEST(a_sound_block_is_stored_and_activated);
    RUN_TEST(an_unsound_block_is_refused_before_it_is_stored);
    RUN_TEST(a_failing_store_keeps_the_old_calibration);
    return UNITY_END();
}
