/* The two flash sectors with anything in them: a device starts, writes a calibration beside it, and starts with that one. First byte of the
 * input: bit n gives sector n a right seal over what stands in it. */
#include <string.h>

#include "application/bytes.h"
#include "application/crc32.h"
#include "application/store.h"
#include "fuzz_board.h"

static void seal(uint8_t sector[FUZZ_SECTOR_BYTES], uint32_t sequence, uint32_t size)
{
    uint8_t *at = sector + FUZZ_SECTOR_BYTES - STORE_SEAL_BYTES;
    struct byte_writer writer = {at};
    memset(at, 0xFF, STORE_SEAL_BYTES);
    put_u32(&writer, STORE_MAGIC);
    put_u32(&writer, sequence);
    put_u32(&writer, size);
    writer.next = at + STORE_SEAL_BYTES - 4;
    put_u32(&writer, crc32_update(crc32_update(0, sector, size), at, 12));
}

static void fill(struct fuzz_board *board, struct fuzz_input *input)
{
    uint8_t how = fuzz_u8(input);
    const uint8_t *bytes;
    for (unsigned i = 0; i < HAL_STORE_SECTORS; i++) {
        uint32_t sequence = fuzz_u32(input);
        uint32_t size = fuzz_u16(input) % (FUZZ_SECTOR_BYTES - STORE_SEAL_BYTES + 1);
        size_t count = fuzz_bytes(input, fuzz_u16(input) % (FUZZ_SECTOR_BYTES + 1), &bytes);
        memcpy(board->sectors[i], bytes, count);
        if ((how >> i & 1) != 0) {
            seal(board->sectors[i], sequence, size);
        }
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct fuzz_board board;
    static struct application app;
    struct fuzz_input input = {data, size};
    fuzz_board_init(&board);
    fill(&board, &input);
    FUZZ_CHECK(application_init(&app, &board.hal) == 0);
    FUZZ_CHECK(store_write(&board.hal, calibration_default_block, CALIBRATION_BYTES) == HAL_OK);
    FUZZ_CHECK(application_init(&app, &board.hal) == 0 && app.calibration_source == CALIBRATION_STORED);
    FUZZ_CHECK(memcmp(&app.calibration.crc, &(uint32_t){crc32_update(0, calibration_default_block, CALIBRATION_BYTES - 4)}, 4) == 0);
    return 0;
}
