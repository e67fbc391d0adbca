/* The application as a whole: start-up, frame rates, means, bursts and their replay, many applications in one process. */
#include <stdlib.h>
#include <string.h>

#include "unity.h"

#include "application/application.h"
#include "application/bytes.h"
#include "application/commands.h"
#include "application/store.h"
#include "support/board.h"
#include "support/gyro_fixture.h"
#include "support/random.h"

#define SLOW_PERIOD 50

/* A device on its bench: plant, board, application. */
struct bench {
    struct board *board;
    struct application app;
    struct fixture_device device;
    struct fixture_plant plant;
    struct random_state noise;
};

static struct bench *bench_create(uint64_t seed)
{
    struct bench *bench = calloc(1, sizeof *bench);
    TEST_ASSERT_NOT_NULL(bench);
    bench->board = board_create();
    bench->device = fixture_default();
    bench->device.rate_rad_s = 0.02 * (double)(seed % 7);
    bench->device.freq_hz = 5000.0 + 3.0 * (double)(seed % 11);
    bench->noise.counter = seed;
    fixture_plant_init(&bench->plant, &bench->device);
    TEST_ASSERT_EQUAL_INT(0, application_init(&bench->app, &bench->board->hal));
    return bench;
}

static void bench_destroy(struct bench *bench)
{
    TEST_ASSERT_EQUAL_UINT32(0, bench->board->bad_manners);
    board_destroy(bench->board);
    free(bench);
}

static void bench_codes(struct bench *bench, int32_t adc[2])
{
    adc[0] = fixture_adc_q31(&bench->device, bench->plant.x1, random_gauss(&bench->noise)) >> 16;
    adc[1] = fixture_adc_q31(&bench->device, bench->plant.x2, random_gauss(&bench->noise)) >> 16;
}

/* One sample, and the background after every slow period. */
static void bench_sample(struct bench *bench)
{
    int32_t adc[2], dac[2];
    bench_codes(bench, adc);
    application_sample(&bench->app, adc, dac);
    fixture_plant_step(&bench->plant, dac[0] * 65536, dac[1] * 65536);
    if (bench->app.sample_counter % SLOW_PERIOD == 0) {
        application_poll(&bench->app);
    }
}

static void bench_run(struct bench *bench, int samples)
{
    for (int i = 0; i < samples; i++) {
        bench_sample(bench);
    }
}

static void set_divisors(struct bench *bench, uint16_t baseband, uint16_t output)
{
    uint8_t payload[4];
    struct byte_writer writer = {payload};
    put_u16(&writer, baseband);
    put_u16(&writer, output);
    board_command(bench->board, COMMAND_DIVISORS, 1, payload, 4);
    application_poll(&bench->app);
}

static void ask_burst(struct bench *bench, uint32_t samples)
{
    uint8_t payload[4];
    struct byte_writer writer = {payload};
    put_u32(&writer, samples);
    board_command(bench->board, COMMAND_RAW_BURST, 2, payload, 4);
    application_poll(&bench->app);
}

static uint32_t count_frames(struct bench *bench, uint8_t type)
{
    static struct frame_receiver receiver;
    struct frame_view frame;
    size_t from = 0;
    uint32_t count = 0;
    receiver.count = 0;
    while (board_next_frame(bench->board, &from, &receiver, &frame)) {
        count += frame.header.type == type ? 1 : 0;
    }
    return count;
}

void setUp(void)
{
}

void tearDown(void)
{
}

/* ---- start-up ---------------------------------------------------------------------------------------------------------- */

static void store_block(struct board *board, uint32_t serial)
{
    uint8_t block[CALIBRATION_BYTES];
    block_default(block);
    block_set(block, BLOCK_SERIAL, serial, 4);
    block_seal(block);
    TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, block, sizeof block));
}

static void starts_with_the_newest_sound_calibration(void)
{
    struct board *board = board_create();
    static struct application app;
    TEST_ASSERT_EQUAL_INT(0, application_init(&app, &board->hal));
    TEST_ASSERT_EQUAL_INT(CALIBRATION_COMPILED_IN, app.calibration_source);
    TEST_ASSERT_FALSE(app.cfg->calibration_valid);
    for (uint32_t serial = 1; serial < 5; serial++) {
        store_block(board, serial);
        TEST_ASSERT_EQUAL_INT(0, application_init(&app, &board->hal));
        TEST_ASSERT_EQUAL_INT(CALIBRATION_STORED, app.calibration_source);
        TEST_ASSERT_EQUAL_UINT32(serial, app.calibration.serial);
        TEST_ASSERT_TRUE(app.cfg->calibration_valid);
    }
    board_destroy(board);
}

/* A record that the store finds sound but the firmware refuses (here: another sampling rate) is passed over for its predecessor. */
static void falls_back_to_the_predecessor(void)
{
    struct board *board = board_create();
    static struct application app;
    uint8_t block[CALIBRATION_BYTES];
    store_block(board, 1);
    block_default(block);
    block_set(block, BLOCK_SAMPLE_RATE, 50000001, 4);
    block_seal(block);
    TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, block, sizeof block));
    TEST_ASSERT_EQUAL_INT(0, application_init(&app, &board->hal));
    TEST_ASSERT_EQUAL_INT(CALIBRATION_STORED_PREDECESSOR, app.calibration_source);
    TEST_ASSERT_EQUAL_UINT32(1, app.calibration.serial);
    TEST_ASSERT_EQUAL_UINT32(1, app.counters.store_errors);
    board_destroy(board);
}

static void refuses_boards_outside_the_contract(void)
{
    struct board *board = board_create();
    static struct application app;
    const struct hal_properties sound = board->properties;
    board->properties.adc_bits = 33;
    TEST_ASSERT_EQUAL_INT(APPLICATION_ERROR_BOARD, application_init(&app, &board->hal));
    board->properties = sound;
    board->properties.dac_bits = 7;
    TEST_ASSERT_EQUAL_INT(APPLICATION_ERROR_BOARD, application_init(&app, &board->hal));
    board->properties = sound;
    board->properties.store_program_bytes = 3;
    TEST_ASSERT_EQUAL_INT(APPLICATION_ERROR_BOARD, application_init(&app, &board->hal));
    board->properties = sound;
    board->properties.store_sector_bytes = 256;
    TEST_ASSERT_EQUAL_INT(APPLICATION_ERROR_BOARD, application_init(&app, &board->hal));
    board->properties = sound;
    board->properties.sample_rate_millihz = 60000000;
    TEST_ASSERT_EQUAL_INT(APPLICATION_ERROR_CALIBRATION, application_init(&app, &board->hal));
    board_destroy(board);
}

static void the_first_frame_is_the_identity(void)
{
    static struct frame_receiver receiver;
    struct bench *bench = bench_create(1);
    struct frame_view frame;
    size_t from = 0;
    TEST_ASSERT_TRUE(board_next_frame(bench->board, &from, &receiver, &frame));
    TEST_ASSERT_EQUAL_UINT8(FRAME_IDENTITY, frame.header.type);
    TEST_ASSERT_EQUAL_UINT16(0, frame.header.sequence);
    bench_destroy(bench);
}

static void a_self_test_follows_the_identity(void)
{
    static struct frame_receiver receiver;
    static struct application app;
    static const struct hal_self_test result = {0xFFF, HAL_PART_THERMOMETER, 168000000, 0x08001234, 7};
    struct board *board = board_create();
    struct frame_view frame;
    size_t from = 0;
    board->hal.self_test = &result;
    TEST_ASSERT_EQUAL_INT(0, application_init(&app, &board->hal));
    TEST_ASSERT_TRUE(board_next_frame(board, &from, &receiver, &frame));
    TEST_ASSERT_EQUAL_UINT8(FRAME_IDENTITY, frame.header.type);
    TEST_ASSERT_TRUE(board_next_frame(board, &from, &receiver, &frame));
    TEST_ASSERT_EQUAL_UINT8(FRAME_SELF_TEST, frame.header.type);
    TEST_ASSERT_EQUAL_UINT32(20, frame.payload_bytes);
    TEST_ASSERT_EQUAL_UINT64(0xFFF, board_field(&frame, 0, 4));
    TEST_ASSERT_EQUAL_UINT64(HAL_PART_THERMOMETER, board_field(&frame, 4, 4));
    TEST_ASSERT_EQUAL_UINT64(168000000, board_field(&frame, 8, 4));
    TEST_ASSERT_EQUAL_UINT64(0x08001234, board_field(&frame, 12, 4));
    TEST_ASSERT_EQUAL_UINT64(7, board_field(&frame, 16, 4));
    board_destroy(board);
}

/* ---- telemetry --------------------------------------------------------------------------------------------------------- */

static void frames_come_at_the_chosen_rates(void)
{
    static const uint16_t divisors[][2] = {{1, 1}, {0, 3}, {7, 0}, {10, 20}};
    for (size_t i = 0; i < sizeof divisors / sizeof divisors[0]; i++) {
        struct bench *bench = bench_create(1);
        set_divisors(bench, divisors[i][0], divisors[i][1]);
        bench_run(bench, 420 * SLOW_PERIOD);
        TEST_ASSERT_EQUAL_UINT32(divisors[i][0] ? 420 / divisors[i][0] : 0, count_frames(bench, FRAME_BASEBAND));
        TEST_ASSERT_EQUAL_UINT32(divisors[i][1] ? 420 / divisors[i][1] : 0, count_frames(bench, FRAME_OUTPUT));
        TEST_ASSERT_EQUAL_UINT32(0, bench->app.sender.frames_lost);
        bench_destroy(bench);
    }
}

/* |n mean - sum| <= n / 2 says that the mean is rounded to the nearest integer. */
static void expect_mean(int64_t sum, int64_t n, const struct frame_view *frame, size_t offset)
{
    int64_t off = (int32_t)board_field(frame, offset, 4) * n - sum;
    TEST_ASSERT_TRUE(2 * (off < 0 ? -off : off) <= n);
}

static void means_are_those_of_the_published_signals(void)
{
    enum { TICKS = 13 };
    static struct frame_receiver receiver;
    struct bench *bench = bench_create(3);
    struct frame_view frame;
    set_divisors(bench, TICKS, TICKS);
    int64_t primary_q = 0, secondary_i = 0, drive = 0, rate = 0, freq_off = 0;
    uint32_t status_or = 0, status_and = UINT32_MAX;
    uint64_t freq = 0, tick_counter = 0;
    for (int tick = 0; tick < 60 * TICKS; tick++) {
        if (tick % TICKS == 0) {
            primary_q = secondary_i = drive = rate = freq_off = 0;
            status_or = 0;
            status_and = UINT32_MAX;
        }
        for (int i = 0; i < SLOW_PERIOD; i++) {
            uint64_t before = atomic_load(&bench->app.live.turn);
            bench_sample(bench);
            if (atomic_load(&bench->app.live.turn) == before) {
                continue;
            }
            const struct gyro_signals *signals = &bench->app.gyro.signals;
            freq = tick % TICKS == 0 ? signals->freq_u64 : freq;
            freq_off += (int64_t)(signals->freq_u64 - freq);
            primary_q += signals->primary.q_q30;
            secondary_i += signals->secondary.i_q30;
            drive += signals->drive_level_q31;
            rate += signals->rate_rad_s_q28;
            status_or |= signals->status;
            status_and &= signals->status;
            tick_counter = bench->app.sample_counter;
        }
    }
    TEST_ASSERT_TRUE(board_last_frame(bench->board, FRAME_BASEBAND, &receiver, &frame));
    TEST_ASSERT_EQUAL_UINT64(tick_counter, frame.header.sample_counter);
    TEST_ASSERT_EQUAL_UINT32(TICKS * SLOW_PERIOD, board_field(&frame, 0, 4));
    expect_mean(primary_q, TICKS, &frame, 8);
    expect_mean(secondary_i, TICKS, &frame, 12);
    expect_mean(drive, TICKS, &frame, 28);
    int64_t off = (int64_t)(board_field(&frame, 20, 8) - freq) * TICKS - freq_off;
    TEST_ASSERT_TRUE(2 * (off < 0 ? -off : off) <= TICKS);
    TEST_ASSERT_EQUAL_HEX32(status_or, board_field(&frame, 44, 4));
    TEST_ASSERT_EQUAL_HEX32(status_and, board_field(&frame, 48, 4));
    TEST_ASSERT_TRUE(board_last_frame(bench->board, FRAME_OUTPUT, &receiver, &frame));
    expect_mean(rate, TICKS, &frame, 16);
    TEST_ASSERT_EQUAL_UINT64(bench->app.gyro.signals.angle_u64, board_field(&frame, 28, 8));
    bench_destroy(bench);
}

/* Sums at the ends of their range: the largest divisor, signals at the limits of 32 bit. */
static void means_of_extreme_signals(void)
{
    static struct frame_receiver receiver;
    static struct telemetry telemetry;
    static struct sender sender;
    struct board *board = board_create();
    struct frame_view frame;
    struct gyro_signals signals = {
        .primary = {INT32_MIN, INT32_MAX}, .freq_u64 = UINT64_MAX, .drive_level_q31 = INT32_MIN, .rate_rad_s_q28 = INT32_MIN, .bias_rad_s_q31 = INT32_MAX,
    };
    telemetry_init(&telemetry);
    telemetry_set_divisors(&telemetry, 65535, 65535);
    for (uint32_t i = 0; i < 65535; i++) {
        telemetry_add(&telemetry, &signals, 5, i, 2048);
    }
    telemetry_poll(&telemetry, &sender, &board->hal);
    TEST_ASSERT_TRUE(board_last_frame(board, FRAME_BASEBAND, &receiver, &frame));
    TEST_ASSERT_EQUAL_UINT32(65535 * 2048, board_field(&frame, 0, 4));
    TEST_ASSERT_EQUAL_HEX32(0x80000000, board_field(&frame, 4, 4));
    TEST_ASSERT_EQUAL_HEX32(0x7FFFFFFF, board_field(&frame, 8, 4));
    TEST_ASSERT_EQUAL_HEX64(UINT64_MAX, board_field(&frame, 20, 8));
    TEST_ASSERT_TRUE(board_last_frame(board, FRAME_OUTPUT, &receiver, &frame));
    TEST_ASSERT_EQUAL_INT32(5, board_field(&frame, 4, 4));
    TEST_ASSERT_EQUAL_HEX32(0x7FFFFFFF, board_field(&frame, 12, 4));
    TEST_ASSERT_EQUAL_HEX32(0x80000000, board_field(&frame, 16, 4));
    board_destroy(board);
}

/* A link without room loses means, says how many, and its numbering shows the gap. */
static void a_busy_link_loses_whole_frames_and_counts_them(void)
{
    static struct frame_receiver receiver;
    struct bench *bench = bench_create(1);
    struct frame_view frame;
    set_divisors(bench, 1, 0);
    bench_run(bench, 10 * SLOW_PERIOD);
    bench->board->link_busy = true;
    bench_run(bench, 7 * SLOW_PERIOD);
    bench->board->link_busy = false;
    bench_run(bench, SLOW_PERIOD);
    TEST_ASSERT_EQUAL_UINT32(7, bench->app.sender.frames_lost);
    TEST_ASSERT_TRUE(board_last_frame(bench->board, FRAME_BASEBAND, &receiver, &frame));
    TEST_ASSERT_EQUAL_UINT16(1 + 1 + 10 + 7, frame.header.sequence);
    bench_destroy(bench);
}

/* A background that does not come round loses intervals beyond the queue. */
static void a_slow_background_loses_intervals_and_counts_them(void)
{
    struct bench *bench = bench_create(1);
    int32_t adc[2] = {0, 0}, dac[2];
    set_divisors(bench, 1, 0);
    for (int i = 0; i < (TELEMETRY_RECORDS + 3) * SLOW_PERIOD; i++) {
        application_sample(&bench->app, adc, dac);
    }
    application_poll(&bench->app);
    TEST_ASSERT_EQUAL_UINT32(3, atomic_load(&bench->app.telemetry.records_lost));
    TEST_ASSERT_EQUAL_UINT32(TELEMETRY_RECORDS, count_frames(bench, FRAME_BASEBAND));
    bench_destroy(bench);
}

static void thermometer_and_watchdog_are_served_by_the_background(void)
{
    struct bench *bench = bench_create(1);
    bench->board->thermometer_answers = true;
    bench->board->thermometer_raw = 777;
    bench_run(bench, 2 * SLOW_PERIOD);
    TEST_ASSERT_EQUAL_INT32(777, atomic_load(&bench->app.thermometer_raw));
    bench->board->thermometer_answers = false;
    bench_run(bench, SLOW_PERIOD);
    TEST_ASSERT_EQUAL_INT32(GYRO_THERMOMETER_INVALID, atomic_load(&bench->app.thermometer_raw));
    TEST_ASSERT_EQUAL_UINT32(3, bench->board->kicks);
    bench->board->hal.thermometer_read_raw = NULL;
    bench->board->hal.watchdog_kick = NULL;
    application_thermometer(&bench->app, 5);
    bench_run(bench, SLOW_PERIOD);
    TEST_ASSERT_EQUAL_INT32(5, atomic_load(&bench->app.thermometer_raw));
    bench_destroy(bench);
}

/* ---- converters -------------------------------------------------------------------------------------------------------- */

/* Codes of every width mean parts of full scale: a 12-bit device sees what a 24-bit one sees, four thousand times coarser. */
static void codes_are_justified_to_their_bits(void)
{
    static const uint32_t bits[] = {8, 12, 16, 24, 32};
    for (size_t i = 0; i < sizeof bits / sizeof bits[0]; i++) {
        struct board *board = board_create();
        static struct application app;
        board->properties.adc_bits = board->properties.dac_bits = bits[i];
        TEST_ASSERT_EQUAL_INT(0, application_init(&app, &board->hal));
        int32_t lowest = (int32_t)(-(INT64_C(1) << (bits[i] - 1)));
        TEST_ASSERT_EQUAL_INT32(INT32_MIN, application_pickoff_q31(&app, lowest));
        int32_t adc[2] = {lowest, -1 - lowest}, dac[2], largest = 0;
        for (int sample = 0; sample < 5000; sample++) {
            application_sample(&app, adc, dac);
            TEST_ASSERT_TRUE(dac[0] >= lowest && dac[0] <= -1 - lowest);
            largest = dac[0] > largest ? dac[0] : largest;
        }
        TEST_ASSERT_TRUE(largest > -(lowest / 4) * 3); /* the chirp drives at full force */
        board_destroy(board);
    }
}

/* ---- bursts ------------------------------------------------------------------------------------------------------------ */

struct collected {
    uint8_t snapshot[2048];
    size_t snapshot_count;
    int32_t codes[4000][4];
    int32_t thermometer[4000];
    size_t count;
    uint64_t first_sample;
    uint8_t flags; /* all of them */
};

static void collect_raw(struct collected *burst, const struct frame_view *frame)
{
    size_t count = board_field(frame, 12, 2), width = board_field(frame, 14, 1);
    TEST_ASSERT_EQUAL_size_t(16 + 4 * width * count, frame->payload_bytes);
    if (burst->count == 0) {
        burst->first_sample = board_field(frame, 0, 8);
    }
    TEST_ASSERT_EQUAL_UINT64(burst->first_sample + burst->count, board_field(frame, 0, 8));
    for (size_t i = 0; i < count; i++, burst->count++) {
        for (size_t channel = 0; channel < 4; channel++) {
            uint32_t bits = (uint32_t)board_field(frame, 16 + width * (4 * i + channel), (unsigned)width);
            burst->codes[burst->count][channel] = width == 2 ? (int16_t)bits : (int32_t)bits;
        }
        burst->thermometer[burst->count] = (int32_t)board_field(frame, 8, 4);
    }
    burst->flags |= (uint8_t)board_field(frame, 15, 1);
}

static void collect(struct bench *bench, struct collected *burst)
{
    static struct frame_receiver receiver;
    struct frame_view frame;
    size_t from = 0;
    memset(burst, 0, sizeof *burst);
    receiver.count = 0;
    while (board_next_frame(bench->board, &from, &receiver, &frame)) {
        if (frame.header.type == FRAME_SNAPSHOT) {
            TEST_ASSERT_EQUAL_UINT64(burst->snapshot_count, board_field(&frame, 8, 2));
            memcpy(burst->snapshot + burst->snapshot_count, frame.payload + 12, frame.payload_bytes - 12);
            burst->snapshot_count += frame.payload_bytes - 12;
        } else if (frame.header.type == FRAME_RAW) {
            collect_raw(burst, &frame);
        }
    }
}

static void expect_replay(const struct collected *burst)
{
    static struct snapshot gyro;
    TEST_ASSERT_EQUAL_INT(0, snapshot_read(burst->snapshot, burst->snapshot_count, &gyro));
    TEST_ASSERT_EQUAL_UINT64(burst->first_sample, gyro.sample_counter);
    for (size_t i = 0; i < burst->count; i++) {
        struct gyro_input input = {burst->codes[i][0] * 65536, burst->codes[i][1] * 65536, burst->thermometer[i]};
        struct gyro_output output = gyro_step(&gyro.cfg, &gyro.state, &input);
        TEST_ASSERT_EQUAL_INT32(burst->codes[i][2], output.drive_q31 >> 16);
        TEST_ASSERT_EQUAL_INT32(burst->codes[i][3], output.rebalance_q31 >> 16);
    }
}

/* Bursts of any length, with a thermometer that changes within them, replay to the last bit. */
static void bursts_replay_bit_by_bit(void)
{
    static const uint32_t lengths[] = {1, 2, 56, 57, 58, 112, 113, 3333};
    static struct collected burst;
    for (size_t i = 0; i < sizeof lengths / sizeof lengths[0]; i++) {
        struct bench *bench = bench_create(i);
        bench->board->hal.thermometer_read_raw = NULL;
        set_divisors(bench, 0, 0);
        bench_run(bench, 12345);
        ask_burst(bench, lengths[i]);
        for (int sample = 0; sample < 4000; sample++) {
            application_thermometer(&bench->app, sample / 333 % 5 == 4 ? GYRO_THERMOMETER_INVALID : sample / 333);
            bench_sample(bench);
        }
        collect(bench, &burst);
        TEST_ASSERT_EQUAL_size_t(lengths[i], burst.count);
        TEST_ASSERT_EQUAL_HEX8(3, burst.flags);
        TEST_ASSERT_TRUE(burst_idle(&bench->app.burst));
        expect_replay(&burst);
        bench_destroy(bench);
    }
}

static void codes_wider_than_16_bit_go_out_whole(void)
{
    static struct collected burst;
    struct board *board = board_create();
    static struct application app;
    struct bench shell = {.board = board};
    board->properties.adc_bits = 24;
    TEST_ASSERT_EQUAL_INT(0, application_init(&app, &board->hal));
    TEST_ASSERT_TRUE(burst_ask(&app.burst, 200));
    for (int i = 0; i < 400; i++) {
        int32_t adc[2] = {-8388608 + i, 8388607 - i}, dac[2];
        application_sample(&app, adc, dac);
        if (i % 20 == 0) {
            application_poll(&app);
        }
    }
    collect(&shell, &burst);
    TEST_ASSERT_EQUAL_size_t(200, burst.count);
    TEST_ASSERT_EQUAL_INT32(-8388608 + (int32_t)burst.first_sample, burst.codes[0][0]);
    TEST_ASSERT_EQUAL_INT32(8388607 - (int32_t)burst.first_sample - 199, burst.codes[199][1]);
    board_destroy(board);
}

/* Too slow a link ends the burst early; what came is sound, and the end says so. */
static void a_full_ring_cuts_the_burst(void)
{
    static struct collected burst;
    struct bench *bench = bench_create(2);
    set_divisors(bench, 0, 0);
    bench_run(bench, 1000);
    ask_burst(bench, 3000);
    bench->board->link_busy = true;
    bench_run(bench, 1000);
    bench->board->link_busy = false;
    bench_run(bench, 1000);
    collect(bench, &burst);
    TEST_ASSERT_EQUAL_size_t(BURST_RING, burst.count);
    TEST_ASSERT_EQUAL_HEX8(7, burst.flags);
    TEST_ASSERT_EQUAL_UINT32(1, bench->app.burst.bursts_cut);
    TEST_ASSERT_TRUE(burst_idle(&bench->app.burst));
    expect_replay(&burst);
    bench_destroy(bench);
}

/* ---- many in one process ----------------------------------------------------------------------------------------------- */

static void script(struct bench *bench, int step)
{
    if (step == 2000) {
        set_divisors(bench, 3, 2);
    } else if (step == 9000) {
        ask_burst(bench, 700);
    } else if (step == 20000) {
        board_command(bench->board, COMMAND_RESTART, 3, NULL, 0);
    }
}

static void devices_interleaved_equal_devices_alone(void)
{
    enum { DEVICES = 5, SAMPLES = 30000 };
    struct bench *alone[DEVICES], *together[DEVICES];
    for (uint64_t i = 0; i < DEVICES; i++) {
        alone[i] = bench_create(i + 1);
        together[i] = bench_create(i + 1);
        for (int step = 0; step < SAMPLES; step++) {
            script(alone[i], step);
            bench_sample(alone[i]);
        }
    }
    struct random_state order = random_begin("interleaving", 21);
    int steps[DEVICES] = {0};
    for (int left = DEVICES * SAMPLES; left > 0;) {
        size_t i = random_u64(&order) % DEVICES;
        if (steps[i] < SAMPLES) {
            script(together[i], steps[i]);
            bench_sample(together[i]);
            steps[i]++;
            left--;
        }
    }
    for (size_t i = 0; i < DEVICES; i++) {
        TEST_ASSERT_EQUAL_size_t(alone[i]->board->out_count, together[i]->board->out_count);
        TEST_ASSERT_EQUAL_INT(0, memcmp(alone[i]->board->out, together[i]->board->out, alone[i]->board->out_count));
        TEST_ASSERT_TRUE(i == 0 || alone[i]->board->out_count != alone[0]->board->out_count ||
                         memcmp(alone[i]->board->out, alone[0]->board->out, alone[0]->board->out_count) != 0);
    }
    for (size_t i = 0; i < DEVICES; i++) {
        bench_destroy(alone[i]);
        bench_destroy(together[i]);
    }
}

/* The signal processing depends on when a setting is taken over, not on when the background runs in between. */
static void polls_in_between_do_not_touch_the_sample_path(void)
{
    struct bench *rare = bench_create(4), *often = bench_create(4);
    for (int i = 0; i < 20000; i++) {
        int32_t adc[2], a[2], b[2];
        bench_codes(rare, adc);
        application_sample(&rare->app, adc, a);
        application_sample(&often->app, adc, b);
        TEST_ASSERT_EQUAL_INT32_ARRAY(a, b, 2);
        fixture_plant_step(&rare->plant, a[0] * 65536, a[1] * 65536);
        if (i % 7 == 0) {
            application_poll(&often->app);
        }
        if (i % 400 == 0) {
            application_poll(&rare->app);
        }
    }
    application_poll(&often->app);
    application_poll(&rare->app);
    TEST_ASSERT_EQUAL_size_t(often->board->out_count, rare->board->out_count);
    bench_destroy(rare);
    bench_destroy(often);
}

static void the_application_fits_a_small_board(void)
{
    TEST_ASSERT_TRUE(sizeof(struct application) <= 10 * 1024);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(starts_with_the_newest_sound_calibration);
    RUN_TEST(falls_back_to_the_predecessor);
    RUN_TEST(refuses_boards_outside_the_contract);
    RUN_TEST(the_first_frame_is_the_identity);
    RUN_TEST(a_self_test_follows_the_identity);
    RUN_TEST(frames_come_at_the_chosen_rates);
    RUN_TEST(means_are_those_of_the_published_signals);
    RUN_TEST(means_of_extreme_signals);
    RUN_TEST(a_busy_link_loses_whole_frames_and_counts_them);
    RUN_TEST(a_slow_background_loses_intervals_and_counts_them);
    RUN_TEST(thermometer_and_watchdog_are_served_by_the_background);
    RUN_TEST(codes_are_justified_to_their_bits);
    RUN_TEST(bursts_replay_bit_by_bit);
    RUN_TEST(codes_wider_than_16_bit_go_out_whole);
    RUN_TEST(a_full_ring_cuts_the_burst);
    RUN_TEST(devices_interleaved_equal_devices_alone);
    RUN_TEST(polls_in_between_do_not_touch_the_sample_path);
    RUN_TEST(the_application_fits_a_small_board);
    return UNITY_END();
}
