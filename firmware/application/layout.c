#include "application/layout.h"

#include <stdbool.h>

#include "application/bytes.h"

size_t layout_bytes(const struct layout_field *fields, size_t field_count)
{
    size_t bytes = 0;
    for (size_t i = 0; i < field_count; i++) {
        bytes += (size_t)fields[i].width * fields[i].count;
    }
    return bytes;
}

uint64_t layout_load(const void *element, unsigned width)
{
    switch (width) {
    case 1:
        return *(const bool *)element ? 1 : 0;
    case 4:
        return *(const uint32_t *)element;
    default:
        return *(const uint64_t *)element;
    }
}

void layout_store(void *element, unsigned width, uint64_t value)
{
    switch (width) {
    case 1:
        *(bool *)element = value != 0;
        break;
    case 4:
        *(uint32_t *)element = (uint32_t)value;
        break;
    default:
        *(uint64_t *)element = value;
        break;
    }
}

/* Bytes of one field from `skip` on, at most `count`. */
static size_t write_field(const struct layout_field *field, const uint8_t *base, size_t skip, uint8_t *out, size_t count)
{
    size_t bytes = (size_t)field->width * field->count - skip;
    bytes = bytes < count ? bytes : count;
    for (size_t i = 0; i < bytes; i++) {
        size_t element = (skip + i) / field->width;
        size_t byte = (skip + i) % field->width;
        out[i] = (uint8_t)(layout_load(base + field->offset + element * field->width, field->width) >> (8 * byte));
    }
    return bytes;
}

size_t layout_write(const struct layout_field *fields, size_t field_count, const void *structure, size_t position, uint8_t *out,
                    size_t count)
{
    size_t written = 0;
    for (size_t i = 0; i < field_count && written < count; i++) {
        size_t bytes = (size_t)fields[i].width * fields[i].count;
        if (position >= bytes) {
            position -= bytes;
            continue;
        }
        written += write_field(&fields[i], structure, position, out + written, count - written);
        position = 0;
    }
    return written;
}

void layout_read(const struct layout_field *fields, size_t field_count, void *structure, const uint8_t *bytes)
{
    uint8_t *base = structure;
    for (size_t i = 0; i < field_count; i++) {
        for (size_t element = 0; element < fields[i].count; element++) {
            struct byte_reader reader = {bytes, fields[i].width, false};
            layout_store(base + fields[i].offset + element * fields[i].width, fields[i].width,
                         get_little_endian(&reader, fields[i].width));
            bytes += fields[i].width;
        }
    }
}
