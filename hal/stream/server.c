#include "hal/stream/server.h"

#include <string.h>

#include "application/bytes.h"
#include "application/snapshot.h"
#include "hal/stream/device.h"
#include "hal/stream/stream.h"

#define WORD_BYTES   4u
#define PAIR_BYTES   8u
#define HEADER_BYTES 8u
#define START_BYTES  32u
#define REFUSED      (-1)

static struct device device;
static uint8_t payload[SERVER_MAX_BYTES];
static uint8_t answer[WORD_BYTES + SERVER_MAX_BYTES];
static int32_t codes[SERVER_MAX_BYTES / WORD_BYTES];

static const int32_t failed = -1; /* instead of an answer's size: the request broke the rules */;

/* The answer's bytes stand behind room for their number. */
static int32_t status_answer(int32_t status)
{
    struct byte_writer writer = {answer + WORD_BYTES};
    put_i32(&writer, status);
    return (int32_t)WORD_BYTES;
}

static int32_t start(const uint8_t *bytes, size_t count)
{
    struct byte_reader reader = {bytes, count, false};
    struct hal_properties properties = {.unique_id = get_u64(&reader)};
    properties.sample_rate_millihz = get_u32(&reader);
    properties.adc_bits = get_u32(&reader);
    properties.dac_bits = get_u32(&reader);
    properties.loop_delay_samples_q16 = get_u32(&reader);
    properties.store_program_bytes = get_u32(&reader);
    uint32_t poll_interval = get_u32(&reader);
    if (reader.short_of_bytes) {
        return failed;
    }
    return status_answer(device_start(&device, &properties, poll_interval, reader.next, reader.left));
}

static int32_t run(const uint8_t *bytes, size_t count)
{
    struct byte_reader reader = {bytes, count, false};
    if (device.board.app.cfg == NULL || count % PAIR_BYTES != WORD_BYTES) {
        return failed;
    }
    application_thermometer(&device.board.app, get_i32(&reader));
    size_t pairs = count / PAIR_BYTES;
    for (size_t i = 0; i < 2 * pairs; i++) {
        codes[i] = get_i32(&reader);
    }
    device_run(&device, pairs, codes, codes);
    struct byte_writer writer = {answer + WORD_BYTES};
    for (size_t i = 0; i < 2 * pairs; i++) {
        put_i32(&writer, codes[i]);
    }
    return (int32_t)(pairs * PAIR_BYTES);
}

static int32_t poll(void)
{
    if (device.board.app.cfg == NULL) {
        return failed;
    }
    application_poll(&device.board.app);
    return status_answer(0);
}

static int32_t snapshot(void)
{
    static struct snapshot taken;
    if (device.board.app.cfg == NULL) {
        return failed;
    }
    taken = (struct snapshot){device.board.app.sample_counter, *device.board.app.cfg, device.board.app.gyro};
    return (int32_t)snapshot_write(&taken, 0, answer + WORD_BYTES, SERVER_MAX_BYTES);
}

static int32_t serve(uint32_t kind, size_t count)
{
    switch (kind) {
    case SERVER_START:
        return start(payload, count);
    case SERVER_RUN:
        return run(payload, count);
    case SERVER_COMMAND:
        return status_answer(device_queue_put(&device.commands, payload, count) ? 0 : REFUSED);
    case SERVER_POLL:
        return poll();
    case SERVER_DRAIN:
        return (int32_t)device_queue_take(&device.telemetry, answer + WORD_BYTES, SERVER_MAX_BYTES);
    case SERVER_SNAPSHOT:
        return snapshot();
    default:
        return failed;
    }
}

int server_run(void)
{
    uint8_t header[HEADER_BYTES];
    while (stream_read(header, HEADER_BYTES)) {
        struct byte_reader reader = {header, HEADER_BYTES, false};
        uint32_t kind = get_u32(&reader);
        uint32_t count = get_u32(&reader);
        if (count > SERVER_MAX_BYTES || !stream_read(payload, count)) {
            return SERVER_BAD_REQUEST;
        }
        int32_t answered = serve(kind, count);
        if (answered < 0) {
            return SERVER_BAD_REQUEST;
        }
        struct byte_writer writer = {answer};
        put_i32(&writer, answered);
        if (!stream_write(answer, WORD_BYTES + (size_t)answered)) {
            return SERVER_BAD_REQUEST;
        }
    }
    return 0;
}
