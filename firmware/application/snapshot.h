/* The complete configuration and state of the signal processing as bytes: whoever restores them continues bit by bit. */
#ifndef WINEGLASS_APPLICATION_SNAPSHOT_H
#define WINEGLASS_APPLICATION_SNAPSHOT_H

#include <stddef.h>
#include <stdint.h>

#include "application/reason.h"
#include "core/gyro.h"

#define SNAPSHOT_VERSION      4
#define SNAPSHOT_HEADER_BYTES 12 /* version u16, size u16, sample counter u64 */

struct snapshot {
    uint64_t sample_counter; /* samples done */
    struct gyro_cfg cfg;
    struct gyro_state state;
};

size_t snapshot_bytes(void);

/* Bytes position .. position + count - 1, as far as there are any; returns how many were written. */
size_t snapshot_write(const struct snapshot *snapshot, size_t position, uint8_t *out, size_t count);

/* Refused, with *snapshot unchanged, when version or size are not the present ones, or when a number is none that the signal processing could
 * have left there (application/snapshot_check.h). */
enum reason snapshot_read(const uint8_t *bytes, size_t size, struct snapshot *snapshot);

#endif
