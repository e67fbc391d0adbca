/* Little-endian numbers in byte buffers: a cursor that writes and one that reads. Callers size their buffers beforehand; a reader
 * that runs past its end returns zeros and says so in `short_of_bytes`. */
#ifndef WINEGLASS_APPLICATION_BYTES_H
#define WINEGLASS_APPLICATION_BYTES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct byte_writer {
    uint8_t *next;
};

static inline void put_u8(struct byte_writer *writer, uint8_t value)
{
    *writer->next++ = value;
}

static inline void put_little_endian(struct byte_writer *writer, uint64_t value, unsigned width)
{
    for (unsigned i = 0; i < width; i++) {
        put_u8(writer, (uint8_t)(value >> (8 * i)));
    }
}

static inline void put_u16(struct byte_writer *writer, uint16_t value)
{
    put_little_endian(writer, value, 2);
}

static inline void put_u32(struct byte_writer *writer, uint32_t value)
{
    put_little_endian(writer, value, 4);
}

static inline void put_i32(struct byte_writer *writer, int32_t value)
{
    put_little_endian(writer, (uint32_t)value, 4);
}

static inline void put_u64(struct byte_writer *writer, uint64_t value)
{
    put_little_endian(writer, value, 8);
}

static inline void put_bytes(struct byte_writer *writer, const uint8_t *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        put_u8(writer, bytes[i]);
    }
}

struct byte_reader {
    const uint8_t *next;
    size_t left;
    bool short_of_bytes;
};

static inline uint64_t get_little_endian(struct byte_reader *reader, unsigned width)
{
    uint64_t value = 0;
    if (reader->left < width) {
        reader->short_of_bytes = true;
        return 0;
    }
    for (unsigned i = 0; i < width; i++) {
        value |= (uint64_t)reader->next[i] << (8 * i);
    }
    reader->next += width;
    reader->left -= width;
    return value;
}

static inline uint8_t get_u8(struct byte_reader *reader)
{
    return (uint8_t)get_little_endian(reader, 1);
}

static inline uint16_t get_u16(struct byte_reader *reader)
{
    return (uint16_t)get_little_endian(reader, 2);
}

static inline uint32_t get_u32(struct byte_reader *reader)
{
    return (uint32_t)get_little_endian(reader, 4);
}

static inline int32_t get_i32(struct byte_reader *reader)
{
    return (int32_t)get_u32(reader);
}

static inline uint64_t get_u64(struct byte_reader *reader)
{
    return get_little_endian(reader, 8);
}

#endif
