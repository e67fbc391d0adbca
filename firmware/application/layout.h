/* Structures as explicit little-endian bytes, field by field from a table: no padding, the same on every machine. */
#ifndef WINEGLASS_APPLICATION_LAYOUT_H
#define WINEGLASS_APPLICATION_LAYOUT_H

#include <stddef.h>
#include <stdint.h>

struct layout_field {
    uint16_t offset; /* in the structure */
    uint8_t width;   /* bytes of one element: 1 (bool), 4 or 8 */
    uint8_t count;   /* elements */
};

/* Number of bytes of all fields. */
size_t layout_bytes(const struct layout_field *fields, size_t field_count);

/* Byte `position` of the serialised structure and the ones after it, at most `count`; returns how many were written. */
size_t layout_write(const struct layout_field *fields, size_t field_count, const void *structure, size_t position, uint8_t *out,
                    size_t count);

/* Fills the structure from layout_bytes() bytes. */
void layout_read(const struct layout_field *fields, size_t field_count, void *structure, const uint8_t *bytes);

/* One element, widened to 64 bit without sign, and back. */
uint64_t layout_load(const void *element, unsigned width);
void layout_store(void *element, unsigned width, uint64_t value);

#endif
