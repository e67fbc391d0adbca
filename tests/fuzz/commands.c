/* A whole device at the end of a wire: commands with right and wrong frames, samples in between, flash that loses its supply. Every sound
 * command frame is answered once and by its number, a refusal changes nothing and is counted, and the forces stay codes of the DAC. */
#include <string.h>

#include "application/bytes.h"
#include "application/commands.h"
#include "application/crc32.h"
#include "application/store.h"
#include "fuzz_board.h"

enum step { STEP_COMMAND, STEP_KNOWN_COMMAND, STEP_BYTES, STEP_SAMPLES, STEP_UNLOCK, STEP_BLOCK, STEP_SUPPLY, STEP_POWER, STEP_COUNT };
#define MAX_STEPS 24

static struct fuzz_board board;
static struct application app;
static uint16_t sequence;

static void command(uint8_t type, const uint8_t *payload, size_t payload_bytes)
{
    static struct calibration before;
    struct application_counters counters = app.counters;
    uint32_t acks = board.acks;
    before = app.calibration;
    sequence++;
    app.receiver.count = 0; /* a delimiter before the frame */
    app.receiver.too_long = false;
    fuzz_board_command(&board, type, sequence, payload, payload_bytes);
    application_poll(&app);
    FUZZ_CHECK(board.acks == acks + 1 && board.ack_type == type && board.ack_sequence == sequence);
    if (board.ack_reason == REASON_OK) {
        FUZZ_CHECK(app.counters.commands_accepted == counters.commands_accepted + 1);
    } else {
        FUZZ_CHECK(app.counters.commands_refused == counters.commands_refused + 1);
        FUZZ_CHECK(memcmp(&before, &app.calibration, sizeof before) == 0);
    }
}

static void any_command(struct fuzz_input *input, bool known)
{
    uint8_t type = fuzz_u8(input);
    const uint8_t *payload;
    size_t count = fuzz_bytes(input, fuzz_u8(input), &payload);
    command(known ? (uint8_t)(COMMAND_PING + type % 20) : type, payload, count);
}

static void any_bytes(struct fuzz_input *input)
{
    const uint8_t *bytes;
    size_t count = fuzz_bytes(input, fuzz_u16(input) % FUZZ_IN_BYTES, &bytes);
    memcpy(board.in, bytes, count);
    board.in_count = count;
    board.in_taken = 0;
    application_poll(&app);
}

static void unlock(void)
{
    uint8_t key[4];
    struct byte_writer writer = {key};
    put_u32(&writer, command_unlock_key(board.properties.unique_id));
    command(COMMAND_CALIBRATION_UNLOCK, key, sizeof key);
}

/* The compiled-in block with one word replaced and its CRC set right, over the wire. */
static void write_block(struct fuzz_input *input)
{
    uint8_t block[CALIBRATION_BYTES], message[2 + CALIBRATION_BYTES], size[4];
    memcpy(block, calibration_default_block, sizeof block);
    struct byte_writer word = {block + fuzz_u8(input) % (CALIBRATION_BYTES / 4) * 4};
    put_u32(&word, fuzz_u32(input));
    struct byte_writer crc = {block + CALIBRATION_BYTES - 4};
    put_u32(&crc, crc32_update(0, block, CALIBRATION_BYTES - 4));
    unlock();
    struct byte_writer writer = {message};
    put_u16(&writer, 0);
    memcpy(message + 2, block, sizeof block);
    command(COMMAND_CALIBRATION_WRITE, message, sizeof message);
    struct byte_writer size_writer = {size};
    put_u32(&size_writer, CALIBRATION_BYTES);
    command(COMMAND_CALIBRATION_COMMIT, size, sizeof size);
}

static void power_on(void)
{
    board.lost = false;
    board.operations_left = 0;
    board.receiver = (struct frame_receiver){.count = 0};
    FUZZ_CHECK(application_init(&app, &board.hal) == 0);
}

/* After a loss of the supply the device comes back with a sound block, if it ever had one. */
static void power_cycle(void)
{
    bool had_one = app.calibration_source != CALIBRATION_COMPILED_IN;
    power_on();
    FUZZ_CHECK(!had_one || app.calibration_source != CALIBRATION_COMPILED_IN);
}

static void step(struct fuzz_input *input)
{
    switch (fuzz_u8(input) % STEP_COUNT) {
    case STEP_COMMAND: any_command(input, false); break;
    case STEP_KNOWN_COMMAND: any_command(input, true); break;
    case STEP_BYTES: any_bytes(input); break;
    case STEP_SAMPLES: fuzz_board_run(&board, &app, input, fuzz_u8(input)); break;
    case STEP_UNLOCK: unlock(); break;
    case STEP_BLOCK: write_block(input); break;
    case STEP_SUPPLY: board.operations_left = fuzz_u8(input) % 20; break;
    default: power_cycle(); break;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct fuzz_board fresh_board;
    static struct application fresh_app;
    struct fuzz_input input = {data, size};
    if (fresh_app.hal == NULL) {
        fuzz_board_init(&board);
        power_on();
        fresh_board = board;
        memcpy(&fresh_app, &app, sizeof app);
    }
    board = fresh_board;
    memcpy(&app, &fresh_app, sizeof app);
    sequence = 0;
    for (unsigned steps = 0; steps < MAX_STEPS && input.left > 0; steps++) {
        step(&input);
    }
    return 0;
}
