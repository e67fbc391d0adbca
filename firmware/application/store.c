#include "application/store.h"

#include "application/bytes.h"
#include "application/crc32.h"

#define WINDOW_BYTES 32 /* the largest program unit; a sector is read and programmed in such pieces */
#define SEAL_WORDS_BYTES 12 /* magic, sequence, size */

static uint32_t seal_offset(const struct hal *hal)
{
    return hal->properties->store_sector_bytes - STORE_SEAL_BYTES;
}

static uint32_t smaller(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

static void build_seal(uint32_t sequence, uint32_t size, uint32_t record_crc, uint8_t seal[STORE_SEAL_BYTES])
{
    struct byte_writer writer = {seal};
    put_u32(&writer, STORE_MAGIC);
    put_u32(&writer, sequence);
    put_u32(&writer, size);
    for (unsigned i = SEAL_WORDS_BYTES; i < STORE_SEAL_BYTES - 4; i++) {
        put_u8(&writer, 0xFF);
    }
    put_u32(&writer, crc32_update(record_crc, seal, SEAL_WORDS_BYTES));
}

static bool record_crc(const struct hal *hal, uint32_t sector, uint32_t size, uint32_t *crc)
{
    uint8_t window[WINDOW_BYTES];
    *crc = 0;
    for (uint32_t offset = 0; offset < size; offset += WINDOW_BYTES) {
        uint32_t count = smaller(WINDOW_BYTES, size - offset);
        if (hal->store_read(hal->context, sector, offset, window, count) != HAL_OK) {
            return false;
        }
        *crc = crc32_update(*crc, window, count);
    }
    return true;
}

static bool equal(const uint8_t *a, const uint8_t *b, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        if (a[i] != b[i]) {
            return false;
        }
    }
    return true;
}

/* The whole seal must read back as it would be written, padding included. */
static bool check_sector(const struct hal *hal, uint32_t sector, uint32_t max_size, struct store_record *record)
{
    uint8_t seal[STORE_SEAL_BYTES];
    uint8_t expected[STORE_SEAL_BYTES];
    uint32_t crc = 0;
    if (hal->store_read(hal->context, sector, seal_offset(hal), seal, STORE_SEAL_BYTES) != HAL_OK) {
        return false;
    }
    struct byte_reader reader = {seal + 4, STORE_SEAL_BYTES - 4, false};
    record->sector = sector;
    record->sequence = get_u32(&reader);
    record->size = get_u32(&reader);
    if (record->size > smaller(max_size, seal_offset(hal)) || !record_crc(hal, sector, record->size, &crc)) {
        return false;
    }
    build_seal(record->sequence, record->size, crc, expected);
    return equal(seal, expected, STORE_SEAL_BYTES);
}

static bool newer(uint32_t a, uint32_t b)
{
    return (int32_t)(a - b) > 0;
}

uint32_t store_find(const struct hal *hal, uint32_t max_size, struct store_record found[HAL_STORE_SECTORS])
{
    uint32_t count = 0;
    for (uint32_t sector = 0; sector < HAL_STORE_SECTORS; sector++) {
        if (check_sector(hal, sector, max_size, &found[count])) {
            count++;
        }
    }
    if (count == 2 && newer(found[1].sequence, found[0].sequence)) {
        struct store_record newest = found[1];
        found[1] = found[0];
        found[0] = newest;
    }
    return count;
}

int store_read(const struct hal *hal, const struct store_record *record, uint8_t *bytes)
{
    return hal->store_read(hal->context, record->sector, 0, bytes, record->size);
}

/* Whole program units: what is left over of the last window is filled with 0xFF. */
static int program(const struct hal *hal, uint32_t sector, uint32_t offset, const uint8_t *bytes, uint32_t size)
{
    uint32_t unit = hal->properties->store_program_bytes;
    uint8_t window[WINDOW_BYTES];
    int status = HAL_OK;
    for (uint32_t done = 0; done < size && status == HAL_OK; done += WINDOW_BYTES) {
        uint32_t count = smaller(WINDOW_BYTES, size - done);
        uint32_t padded = (count + unit - 1) / unit * unit;
        for (uint32_t i = 0; i < WINDOW_BYTES; i++) { /* the whole window: the compiler then sees the bound */
            window[i] = i < count ? bytes[done + i] : 0xFF;
        }
        status = hal->store_program(hal->context, sector, offset + done, window, padded);
    }
    return status;
}

int store_write(const struct hal *hal, const uint8_t *bytes, uint32_t size)
{
    struct store_record found[HAL_STORE_SECTORS];
    struct store_record written;
    uint8_t seal[STORE_SEAL_BYTES];
    uint32_t count = store_find(hal, seal_offset(hal), found);
    uint32_t sector = count > 0 ? 1 - found[0].sector : 0;
    uint32_t sequence = count > 0 ? found[0].sequence + 1 : 1;
    if (size > seal_offset(hal)) {
        return HAL_ERROR_ADDRESS;
    }
    int status = hal->store_erase(hal->context, sector);
    if (status == HAL_OK) {
        status = program(hal, sector, 0, bytes, size);
    }
    if (status == HAL_OK) {
        build_seal(sequence, size, crc32_update(0, bytes, size), seal);
        status = program(hal, sector, seal_offset(hal), seal, STORE_SEAL_BYTES);
    }
    if (status == HAL_OK && !(check_sector(hal, sector, size, &written) && written.sequence == sequence)) {
        status = HAL_ERROR_STORE;
    }
    return status;
}
