/* The calibration block: anything may be refused; what is accepted must start a gyro that runs on any codes without leaving its formats.
 * First byte of the input: bit 0 sets magic, version and size right, bit 1 the CRC, bit 2 begins from the compiled-in block with words
 * replaced. The rest of the input after the block are pickoff codes. */
#include <string.h>

#include "application/bytes.h"
#include "application/crc32.h"
#include "application/store.h"
#include "fuzz_board.h"

static size_t build(struct fuzz_input *input, uint8_t block[CALIBRATION_BYTES])
{
    uint8_t how = fuzz_u8(input);
    const uint8_t *bytes;
    size_t size = CALIBRATION_BYTES;
    memcpy(block, calibration_default_block, CALIBRATION_BYTES);
    if ((how & 4) != 0) {
        for (unsigned words = fuzz_u8(input) % 16; words > 0; words--) {
            size_t at = fuzz_u8(input) % (CALIBRATION_BYTES / 4) * 4;
            struct byte_writer writer = {block + at};
            put_u32(&writer, fuzz_u32(input));
        }
    } else {
        size = fuzz_bytes(input, CALIBRATION_BYTES, &bytes);
        memcpy(block, bytes, size);
    }
    if ((how & 1) != 0) {
        memcpy(block, calibration_default_block, 8);
    }
    if ((how & 2) != 0) {
        struct byte_writer writer = {block + CALIBRATION_BYTES - 4};
        put_u32(&writer, crc32_update(0, block, CALIBRATION_BYTES - 4));
    }
    return size;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct fuzz_board board;
    static struct application app;
    struct fuzz_input input = {data, size};
    struct calibration calibration;
    uint8_t block[CALIBRATION_BYTES];
    size_t block_size = build(&input, block);
    fuzz_board_init(&board);
    struct calibration before;
    memset(&calibration, 0x5A, sizeof calibration);
    memset(&before, 0x5A, sizeof before);
    if (calibration_parse(block, block_size, &board.properties, &calibration) != REASON_OK) {
        FUZZ_CHECK(memcmp(&calibration, &before, sizeof before) == 0);
        return 0;
    }
    FUZZ_CHECK(store_write(&board.hal, block, CALIBRATION_BYTES) == HAL_OK);
    FUZZ_CHECK(application_init(&app, &board.hal) == 0 && app.calibration_source == CALIBRATION_STORED);
    fuzz_board_run(&board, &app, &input, 700);
    return 0;
}
