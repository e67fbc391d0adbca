#include "support/board.h"

#include <stdlib.h>
#include <string.h>

#include "unity.h"

#include "application/bytes.h"
#include "application/crc32.h"

static int write_bytes(void *context, const uint8_t *bytes, size_t count)
{
    struct board *board = context;
    if (board->link_busy || board->out_count + count > BOARD_OUT_BYTES) {
        return HAL_ERROR_BUSY;
    }
    memcpy(board->out + board->out_count, bytes, count);
    board->out_count += count;
    return HAL_OK;
}

static size_t read_bytes(void *context, uint8_t *bytes, size_t capacity)
{
    struct board *board = context;
    size_t left = board->in_count - board->in_taken;
    size_t count = left < capacity ? left : capacity;
    memcpy(bytes, board->in + board->in_taken, count);
    board->in_taken += count;
    return count;
}

static bool read_thermometer(void *context, int32_t *raw)
{
    struct board *board = context;
    *raw = board->thermometer_raw;
    return board->thermometer_answers;
}

static uint64_t time_us(void *context)
{
    (void)context;
    return 42;
}

static void kick(void *context)
{
    struct board *board = context;
    board->kicks++;
}

static uint32_t powered_part(struct board *board, uint32_t size)
{
    if (!board->powered) {
        return 0;
    }
    board->operations++;
    if (board->operations == board->cut_at) {
        board->powered = false;
        return size / 2;
    }
    return size;
}

static int erase(void *context, uint32_t sector)
{
    struct board *board = context;
    TEST_ASSERT_LESS_THAN_UINT32(HAL_STORE_SECTORS, sector);
    uint32_t part = powered_part(board, BOARD_SECTOR_BYTES);
    memset(board->sectors[sector], 0xFF, part);
    memset(board->programmed[sector], 0, part * sizeof(bool));
    return board->powered ? HAL_OK : HAL_ERROR_STORE;
}

static int program(void *context, uint32_t sector, uint32_t offset, const uint8_t *bytes, uint32_t count)
{
    struct board *board = context;
    uint32_t unit = board->properties.store_program_bytes;
    bool outside = sector >= HAL_STORE_SECTORS || offset + count > BOARD_SECTOR_BYTES;
    if (outside || offset % unit != 0 || count % unit != 0) {
        board->bad_manners++;
        return HAL_ERROR_ADDRESS;
    }
    uint32_t part = powered_part(board, count);
    for (uint32_t i = 0; i < part; i++) {
        board->bad_manners += board->programmed[sector][offset + i] ? 1 : 0;
        board->programmed[sector][offset + i] = true;
        board->sectors[sector][offset + i] &= bytes[i];
    }
    return board->powered ? HAL_OK : HAL_ERROR_STORE;
}

static int read_store(void *context, uint32_t sector, uint32_t offset, uint8_t *bytes, uint32_t count)
{
    struct board *board = context;
    if (sector >= HAL_STORE_SECTORS || offset + count > BOARD_SECTOR_BYTES) {
        board->bad_manners++;
        return HAL_ERROR_ADDRESS;
    }
    memcpy(bytes, &board->sectors[sector][offset], count);
    return HAL_OK;
}

struct board *board_create(void)
{
    struct board *board = calloc(1, sizeof *board);
    TEST_ASSERT_NOT_NULL(board);
    board->out = malloc(BOARD_OUT_BYTES);
    TEST_ASSERT_NOT_NULL(board->out);
    board->properties = (struct hal_properties){
        .unique_id = 0x0123456789ABCDEF,
        .sample_rate_millihz = 50000000,
        .adc_bits = 16,
        .dac_bits = 16,
        .loop_delay_samples_q16 = 3 << 15,
        .store_sector_bytes = BOARD_SECTOR_BYTES,
        .store_program_bytes = 4,
    };
    board->hal = (struct hal){
        .properties = &board->properties, .context = board, .bytes_write = write_bytes, .bytes_read = read_bytes,
        .thermometer_read_raw = read_thermometer, .time_us = time_us, .store_erase = erase, .store_program = program,
        .store_read = read_store, .watchdog_kick = kick,
    };
    memset(board->sectors, 0xFF, sizeof board->sectors);
    board->powered = true;
    return board;
}

void board_destroy(struct board *board)
{
    free(board->out);
    free(board);
}

void board_power_up(struct board *board)
{
    board->powered = true;
    board->cut_at = 0;
    board->operations = 0;
}

void board_command(struct board *board, uint8_t type, uint16_t sequence, const uint8_t *payload, size_t payload_bytes)
{
    struct frame_buffer buffer;
    struct frame_header header = {FRAME_VERSION, type, sequence, 0};
    if (payload_bytes > 0) {
        memcpy(frame_payload(&buffer), payload, payload_bytes);
    }
    size_t count = frame_encode(&buffer, &header, payload_bytes);
    if (board->in_taken == board->in_count) {
        board->in_taken = board->in_count = 0;
    }
    TEST_ASSERT_TRUE(board->in_count + count <= BOARD_IN_BYTES);
    memcpy(board->in + board->in_count, buffer.encoded, count);
    board->in_count += count;
}

bool board_next_frame(struct board *board, size_t *from, struct frame_receiver *receiver, struct frame_view *frame)
{
    while (*from < board->out_count) {
        uint8_t byte = board->out[(*from)++];
        bool complete = frame_receive(receiver, byte, frame);
        TEST_ASSERT_EQUAL_UINT32(0, receiver->errors);
        if (complete) {
            return true;
        }
    }
    return false;
}

bool board_last_frame(struct board *board, uint8_t type, struct frame_receiver *receiver, struct frame_view *frame)
{
    struct frame_view each;
    size_t from = 0, last_begin = 0, begin = 0;
    bool found = false;
    *receiver = (struct frame_receiver){.count = 0};
    while (board_next_frame(board, &from, receiver, &each)) {
        if (each.header.type == type) {
            found = true;
            last_begin = begin;
        }
        begin = from;
    }
    return found && board_next_frame(board, &last_begin, receiver, frame);
}

uint64_t board_field(const struct frame_view *frame, size_t offset, unsigned width)
{
    TEST_ASSERT_TRUE(offset + width <= frame->payload_bytes);
    struct byte_reader reader = {frame->payload + offset, width, false};
    return get_little_endian(&reader, width);
}

void block_default(uint8_t block[CALIBRATION_BYTES])
{
    memcpy(block, calibration_default_block, CALIBRATION_BYTES);
}

void block_set(uint8_t block[CALIBRATION_BYTES], size_t offset, uint64_t value, unsigned width)
{
    struct byte_writer writer = {block + offset};
    put_little_endian(&writer, value, width);
}

void block_seal(uint8_t block[CALIBRATION_BYTES])
{
    block_set(block, BLOCK_CRC, crc32_update(0, block, CALIBRATION_BYTES - 4), 4);
}
