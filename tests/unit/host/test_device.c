/* The C interface: a device in its life, as a plant sees it. */
#include <stdlib.h>
#include <string.h>

#include "unity.h"

#include "hal/host/wineglass_device.h"

#include "application/bytes.h"
#include "application/commands.h"
#include "application/frame.h"
#include "support/board.h"
#include "support/gyro_fixture.h"
#include "support/random.h"

static const struct wg_device_cfg cfg_16 = {.sample_rate_millihz = 50000000, .adc_bits = 16, .dac_bits = 16, .serial = 5};
static uint8_t block[CALIBRATION_BYTES];

void setUp(void)
{
    block_default(block);
    block_set(block, BLOCK_SERIAL, 1234, 4);
    block_seal(block);
}

void tearDown(void)
{
}

static void command(struct wg_device *device, uint8_t type, const uint8_t *payload, size_t payload_bytes)
{
    struct frame_buffer buffer;
    struct frame_header header = {FRAME_VERSION, type, 0, 0};
    if (payload_bytes > 0) {
        memcpy(frame_payload(&buffer), payload, payload_bytes);
    }
    size_t count = frame_encode(&buffer, &header, payload_bytes);
    TEST_ASSERT_EQUAL_INT32(0, wg_device_command_write(device, buffer.encoded, count));
}

/* Codes that look like pickoffs, the same every time. */
static void fill_codes(int32_t *adc, size_t n, uint64_t seed)
{
    struct random_state random = {seed};
    for (size_t i = 0; i < 2 * n; i++) {
        adc[i] = random_i32(&random) >> (i % 2 == 0 ? 17 : 24);
    }
}

static void only_sound_configurations_make_a_device(void)
{
    struct wg_device_cfg cfg = cfg_16;
    struct wg_device *device = wg_device_create(&cfg, NULL, 0);
    TEST_ASSERT_NOT_NULL(device);
    wg_device_destroy(device);
    wg_device_destroy(NULL);
    TEST_ASSERT_EQUAL_INT32(REASON_OK, wg_calibration_check(&cfg, block, sizeof block));
    TEST_ASSERT_EQUAL_INT32(REASON_CALIBRATION_SIZE, wg_calibration_check(&cfg, block, 10));
    TEST_ASSERT_NULL(wg_device_create(&cfg, block, 10));
    block[50] ^= 1;
    TEST_ASSERT_EQUAL_INT32(REASON_CALIBRATION_CRC, wg_calibration_check(&cfg, block, sizeof block));
    TEST_ASSERT_NULL(wg_device_create(&cfg, block, sizeof block));
    cfg.adc_bits = 40;
    TEST_ASSERT_NULL(wg_device_create(&cfg, NULL, 0));
    cfg = cfg_16;
    cfg.sample_rate_millihz = 48000000;
    TEST_ASSERT_NULL(wg_device_create(&cfg, NULL, 0));
    TEST_ASSERT_EQUAL_STRING("accepted", wg_reason_text(0));
    TEST_ASSERT_EQUAL_STRING("unknown reason", wg_reason_text(99));
    TEST_ASSERT_EQUAL_size_t(CALIBRATION_BYTES, wg_calibration_size());
}

/* One call or many, and sample by sample: the same codes and the same telemetry. */
static void splitting_a_run_changes_nothing(void)
{
    enum { N = 40000 };
    int32_t *adc = malloc(2 * N * sizeof *adc), *whole = malloc(2 * N * sizeof *whole), *parts = malloc(2 * N * sizeof *parts);
    struct wg_device *a = wg_device_create(&cfg_16, block, sizeof block), *b = wg_device_create(&cfg_16, block, sizeof block);
    fill_codes(adc, N, 1);
    wg_device_run(a, N, adc, whole);
    struct random_state random = random_begin("split", 2);
    for (size_t at = 0; at < N;) {
        size_t n = 1 + random_u64(&random) % 300;
        n = n < N - at ? n : N - at;
        wg_device_run(b, n, adc + 2 * at, parts + 2 * at);
        at += n;
    }
    TEST_ASSERT_EQUAL_INT(0, memcmp(whole, parts, 2 * N * sizeof *whole));
    size_t pending = wg_device_telemetry_pending(a);
    TEST_ASSERT_EQUAL_size_t(pending, wg_device_telemetry_pending(b));
    uint8_t *bytes_a = malloc(pending), *bytes_b = malloc(pending);
    TEST_ASSERT_EQUAL_size_t(pending, wg_device_telemetry_read(a, bytes_a, pending));
    for (size_t at = 0; at < pending;) {
        at += wg_device_telemetry_read(b, bytes_b + at, 77);
    }
    TEST_ASSERT_EQUAL_INT(0, memcmp(bytes_a, bytes_b, pending));
    TEST_ASSERT_EQUAL_size_t(0, wg_device_telemetry_read(a, bytes_a, pending));
    wg_device_destroy(a);
    wg_device_destroy(b);
    free(adc);
    free(whole);
    free(parts);
    free(bytes_a);
    free(bytes_b);
}

static void codes_beyond_the_converter_are_clamped(void)
{
    struct wg_device *a = wg_device_create(&cfg_16, block, sizeof block), *b = wg_device_create(&cfg_16, block, sizeof block);
    for (int i = 0; i < 2000; i++) {
        const int32_t wild[2] = {i % 2 == 0 ? INT32_MAX : INT32_MIN, 40000}, tame[2] = {i % 2 == 0 ? 32767 : -32768, 32767};
        int32_t dac_a[2], dac_b[2];
        wg_device_run(a, 1, wild, dac_a);
        wg_device_run(b, 1, tame, dac_b);
        TEST_ASSERT_EQUAL_INT32_ARRAY(dac_b, dac_a, 2);
    }
    struct wg_device_signals signals;
    wg_device_get_signals(a, &signals);
    TEST_ASSERT_EQUAL_UINT64(2000, signals.sample_counter);
    TEST_ASSERT_TRUE((signals.status & GYRO_STATUS_ADC_SATURATED) != 0);
    wg_device_destroy(a);
    wg_device_destroy(b);
}

static void snapshots_move_a_gyro_to_another_device(void)
{
    enum { N = 7777 };
    static int32_t adc[2 * N], first[2 * N], second[2 * N];
    struct wg_device *a = wg_device_create(&cfg_16, block, sizeof block), *b = wg_device_create(&cfg_16, NULL, 0);
    uint8_t *bytes = malloc(wg_device_snapshot_size());
    fill_codes(adc, N, 3);
    wg_device_set_thermometer(a, 100);
    wg_device_set_thermometer(b, 100);
    wg_device_run(a, N, adc, first);
    TEST_ASSERT_EQUAL_INT64(-1, wg_device_snapshot(a, bytes, wg_device_snapshot_size() - 1));
    TEST_ASSERT_EQUAL_INT64(wg_device_snapshot_size(), wg_device_snapshot(a, bytes, wg_device_snapshot_size()));
    TEST_ASSERT_EQUAL_INT32(REASON_SNAPSHOT_VERSION, wg_device_restore(b, bytes, wg_device_snapshot_size() - 1));
    TEST_ASSERT_EQUAL_INT32(0, wg_device_restore(b, bytes, wg_device_snapshot_size()));
    fill_codes(adc, N, 4);
    wg_device_run(a, N, adc, first);
    wg_device_run(b, N, adc, second);
    TEST_ASSERT_EQUAL_INT(0, memcmp(first, second, sizeof first));
    struct wg_device_cfg cfg_12 = cfg_16;
    cfg_12.dac_bits = 12;
    struct wg_device *c = wg_device_create(&cfg_12, NULL, 0);
    TEST_ASSERT_EQUAL_INT32(REASON_SNAPSHOT_BOARD, wg_device_restore(c, bytes, wg_device_snapshot_size()));
    wg_device_destroy(a);
    wg_device_destroy(b);
    wg_device_destroy(c);
    free(bytes);
}

static void commit_over_the_wire(struct wg_device *device, const uint8_t *wanted)
{
    uint8_t payload[2 + CALIBRATION_BYTES];
    struct byte_writer writer = {payload};
    put_u32(&writer, command_unlock_key(5));
    command(device, COMMAND_CALIBRATION_UNLOCK, payload, 4);
    writer.next = payload;
    put_u16(&writer, 0);
    put_bytes(&writer, wanted, CALIBRATION_BYTES);
    command(device, COMMAND_CALIBRATION_WRITE, payload, sizeof payload);
    writer.next = payload;
    put_u32(&writer, CALIBRATION_BYTES);
    command(device, COMMAND_CALIBRATION_COMMIT, payload, 4);
    wg_device_poll(device);
}

static uint32_t serial_after_power_cycle(struct wg_device *device)
{
    TEST_ASSERT_EQUAL_INT32(0, wg_device_power_cycle(device));
    return device->board.app.calibration.serial;
}

/* The supply goes at every flash operation of a calibration over the wire: after it, the device has the old block or the new one. */
static void power_cuts_during_a_calibration(void)
{
    uint8_t wanted[CALIBRATION_BYTES];
    block_default(wanted);
    block_set(wanted, BLOCK_SERIAL, 4321, 4);
    block_seal(wanted);
    uint32_t last_cut = 0;
    for (uint32_t cut = 1; last_cut == 0; cut++) {
        struct wg_device *device = wg_device_create(&cfg_16, block, sizeof block);
        wg_device_cut_power_after(device, cut);
        commit_over_the_wire(device, wanted);
        bool stored = device->board.app.counters.store_errors == 0;
        TEST_ASSERT_EQUAL_UINT32(stored ? 4321 : 1234, serial_after_power_cycle(device));
        last_cut = stored ? cut : 0;
        commit_over_the_wire(device, wanted);
        TEST_ASSERT_EQUAL_UINT32(4321, serial_after_power_cycle(device));
        wg_device_destroy(device);
    }
    TEST_ASSERT_TRUE(last_cut > 10);
}

static void the_store_can_be_read_and_replaced(void)
{
    struct wg_device *a = wg_device_create(&cfg_16, block, sizeof block), *b = wg_device_create(&cfg_16, NULL, 0);
    uint8_t *store = malloc(wg_device_store_size());
    TEST_ASSERT_EQUAL_size_t(wg_device_store_size(), wg_device_store_get(a, store, wg_device_store_size()));
    TEST_ASSERT_EQUAL_UINT32(0, serial_after_power_cycle(b));
    TEST_ASSERT_EQUAL_INT32(0, wg_device_store_set(b, store, wg_device_store_size()));
    TEST_ASSERT_EQUAL_UINT32(1234, serial_after_power_cycle(b));
    TEST_ASSERT_EQUAL_INT32(-1, wg_device_store_set(b, store, wg_device_store_size() + 1));
    wg_device_destroy(a);
    wg_device_destroy(b);
    free(store);
}

/* A device that finds nothing to start from stays off, and comes back when its store does. */
static void a_device_without_a_calibration_for_its_board_stays_off(void)
{
    struct wg_device_cfg cfg = cfg_16;
    cfg.sample_rate_millihz = 40000000;
    block_set(block, BLOCK_SAMPLE_RATE, 40000000, 4);
    block_set(block, BLOCK_SAMPLE_PERIOD, 1759218604, 4);
    block_seal(block);
    struct wg_device *device = wg_device_create(&cfg, block, sizeof block);
    TEST_ASSERT_NOT_NULL(device);
    uint8_t *store = malloc(wg_device_store_size()), *empty = calloc(1, wg_device_store_size());
    wg_device_store_get(device, store, wg_device_store_size());
    wg_device_store_set(device, empty, wg_device_store_size());
    TEST_ASSERT_EQUAL_INT32(-1, wg_device_power_cycle(device));
    int32_t adc[4] = {1, 2, 3, 4}, dac[4] = {9, 9, 9, 9};
    wg_device_run(device, 2, adc, dac);
    TEST_ASSERT_EACH_EQUAL_INT32(0, dac, 4);
    wg_device_store_set(device, store, wg_device_store_size());
    TEST_ASSERT_EQUAL_INT32(0, wg_device_power_cycle(device));
    free(store);
    free(empty);
    wg_device_destroy(device);
}

/* A queue against the obvious model. */
static void the_queue_is_first_in_first_out(void)
{
    struct random_state random = random_begin("queue", 6);
    struct host_queue queue = {NULL, 0, 0, 0};
    uint8_t next_in = 0, next_out = 0, bytes[5000];
    size_t held = 0;
    for (int round = 0; round < 5000; round++) {
        size_t count = random_u64(&random) % (round % 1000 < 500 ? 5000 : 50);
        for (size_t i = 0; i < count; i++) {
            bytes[i] = next_in++;
        }
        TEST_ASSERT_TRUE(host_queue_put(&queue, bytes, count));
        held += count;
        size_t taken = host_queue_take(&queue, bytes, random_u64(&random) % 5000);
        for (size_t i = 0; i < taken; i++) {
            TEST_ASSERT_EQUAL_UINT8(next_out++, bytes[i]);
        }
        held -= taken;
        TEST_ASSERT_EQUAL_size_t(held, queue.count);
    }
    host_queue_free(&queue);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(only_sound_configurations_make_a_device);
    RUN_TEST(splitting_a_run_changes_nothing);
    RUN_TEST(codes_beyond_the_converter_are_clamped);
    RUN_TEST(snapshots_move_a_gyro_to_another_device);
    RUN_TEST(power_cuts_during_a_calibration);
    RUN_TEST(the_store_can_be_read_and_replaced);
    RUN_TEST(a_device_without_a_calibration_for_its_board_stays_off);
    RUN_TEST(the_queue_is_first_in_first_out);
    return UNITY_END();
}
