#include "fuzz_board.h"

#include <string.h>

#define POLL_SAMPLES 50

static int write_bytes(void *context, const uint8_t *bytes, size_t count)
{
    struct fuzz_board *board = context;
    struct frame_view frame;
    FUZZ_CHECK(count <= 512);
    for (size_t i = 0; i < count; i++) {
        if (frame_receive(&board->receiver, bytes[i], &frame)) {
            board->frames++;
            if (frame.header.type == FRAME_ACK) {
                FUZZ_CHECK(frame.payload_bytes == 4);
                board->acks++;
                board->ack_type = frame.payload[0];
                board->ack_reason = frame.payload[1];
                board->ack_sequence = (uint16_t)(frame.payload[2] | frame.payload[3] << 8);
            }
        }
    }
    FUZZ_CHECK(board->receiver.errors == 0 && board->receiver.count == 0);
    return HAL_OK;
}

static size_t read_bytes(void *context, uint8_t *bytes, size_t capacity)
{
    struct fuzz_board *board = context;
    size_t left = board->in_count - board->in_taken;
    size_t count = left < capacity ? left : capacity;
    memcpy(bytes, board->in + board->in_taken, count);
    board->in_taken += count;
    return count;
}

static uint64_t time_us(void *context)
{
    (void)context;
    return 42;
}

/* How much of an operation on `size` bytes still happens. */
static uint32_t powered_part(struct fuzz_board *board, uint32_t size)
{
    if (board->lost) {
        return 0;
    }
    if (board->operations_left != 0 && --board->operations_left == 0) {
        board->lost = true;
        return size / 2;
    }
    return size;
}

static int erase(void *context, uint32_t sector)
{
    struct fuzz_board *board = context;
    FUZZ_CHECK(sector < HAL_STORE_SECTORS);
    memset(board->sectors[sector], 0xFF, powered_part(board, FUZZ_SECTOR_BYTES));
    return board->lost ? HAL_ERROR_STORE : HAL_OK;
}

static int program(void *context, uint32_t sector, uint32_t offset, const uint8_t *bytes, uint32_t count)
{
    struct fuzz_board *board = context;
    uint32_t unit = board->properties.store_program_bytes;
    FUZZ_CHECK(sector < HAL_STORE_SECTORS && offset % unit == 0 && count % unit == 0 && offset + count <= FUZZ_SECTOR_BYTES);
    uint32_t part = powered_part(board, count);
    for (uint32_t i = 0; i < part; i++) {
        board->sectors[sector][offset + i] &= bytes[i];
    }
    return board->lost ? HAL_ERROR_STORE : HAL_OK;
}

static int read_store(void *context, uint32_t sector, uint32_t offset, uint8_t *bytes, uint32_t count)
{
    struct fuzz_board *board = context;
    FUZZ_CHECK(sector < HAL_STORE_SECTORS && offset <= FUZZ_SECTOR_BYTES && count <= FUZZ_SECTOR_BYTES - offset);
    memcpy(bytes, &board->sectors[sector][offset], count);
    return HAL_OK;
}

void fuzz_board_init(struct fuzz_board *board)
{
    memset(board, 0, sizeof *board);
    memset(board->sectors, 0xFF, sizeof board->sectors);
    board->properties = (struct hal_properties){
        .unique_id = 0x0123456789ABCDEF, .sample_rate_millihz = 50000000, .adc_bits = 16, .dac_bits = 16,
        .loop_delay_samples_q16 = 3 << 15, .store_sector_bytes = FUZZ_SECTOR_BYTES, .store_program_bytes = 4,
    };
    board->hal = (struct hal){
        .properties = &board->properties, .context = board, .bytes_write = write_bytes, .bytes_read = read_bytes, .time_us = time_us,
        .store_erase = erase, .store_program = program, .store_read = read_store,
    };
}

void fuzz_board_command(struct fuzz_board *board, uint8_t type, uint16_t sequence, const uint8_t *payload, size_t payload_bytes)
{
    struct frame_buffer buffer;
    struct frame_header header = {FRAME_VERSION, type, sequence, 0};
    if (payload_bytes > 0) {
        memcpy(frame_payload(&buffer), payload, payload_bytes);
    }
    board->in_count = frame_encode(&buffer, &header, payload_bytes);
    board->in_taken = 0;
    memcpy(board->in, buffer.encoded, board->in_count);
}

void fuzz_board_run(struct fuzz_board *board, struct application *app, struct fuzz_input *input, uint32_t samples)
{
    const int32_t dac_max = (int32_t)(UINT32_C(0x7FFFFFFF) >> (32 - board->properties.dac_bits));
    int32_t adc[2], dac[2];
    application_thermometer(app, (int32_t)fuzz_u32(input));
    int16_t pattern[4] = {(int16_t)fuzz_u16(input), (int16_t)fuzz_u16(input), (int16_t)fuzz_u16(input), (int16_t)fuzz_u16(input)};
    for (uint32_t i = 0; i < samples; i++) {
        adc[0] = pattern[i % 4];
        adc[1] = pattern[(i + 1) % 4];
        application_sample(app, adc, dac);
        FUZZ_CHECK(dac[0] >= -dac_max - 1 && dac[0] <= dac_max && dac[1] >= -dac_max - 1 && dac[1] <= dac_max);
        if (i % POLL_SAMPLES == POLL_SAMPLES - 1) {
            application_poll(app);
        }
    }
}
