/* One record in two flash sectors that survives the loss of power at any moment.
 *
 *   sector: | record bytes, padded with 0xFF | ... | seal in the sector's last 32 bytes |
 *   seal:   magic, sequence, size, 0xFF …, and in the last word the CRC-32 of the record bytes and of the first three words
 *
 * A new record goes to the sector that does not hold the newest sound one; its seal is programmed last, and the seal's
 * last word last of all, so until then the old record stays the newest. */
#ifndef WINEGLASS_APPLICATION_STORE_H
#define WINEGLASS_APPLICATION_STORE_H

#include <stdbool.h>
#include <stdint.h>

#include "hal/hal.h"

#define STORE_MAGIC      UINT32_C(0x53474C57) /* "WLGS" */
#define STORE_SEAL_BYTES 32

struct store_record {
    uint32_t sector;
    uint32_t sequence; /* of writing; compared modulo 2^32 */
    uint32_t size;
};

/* Sound records, newest first; returns 0, 1 or 2. Records larger than max_size count as unsound. */
uint32_t store_find(const struct hal *hal, uint32_t max_size, struct store_record found[HAL_STORE_SECTORS]);

/* Copies a found record; HAL_OK or a negative error. */
int store_read(const struct hal *hal, const struct store_record *record, uint8_t *bytes);

/* Writes a record and reads it back: HAL_OK or a negative error, and then the previous record is still the newest. */
int store_write(const struct hal *hal, const uint8_t *bytes, uint32_t size);

#endif
