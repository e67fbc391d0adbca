#include "application/cobs.h"

/* A block is a code byte (1 .. 255) and code - 1 bytes that are not zero; a zero follows unless code = 255 or the packet ends. */
#define LONGEST_BLOCK 255

size_t cobs_encode(const uint8_t *in, size_t count, uint8_t *out)
{
    size_t code_at = 0;
    size_t at = 1;
    for (size_t i = 0; i < count; i++) {
        if (at - code_at == LONGEST_BLOCK) {
            out[code_at] = LONGEST_BLOCK;
            code_at = at++;
        }
        if (in[i] == 0) {
            out[code_at] = (uint8_t)(at - code_at);
            code_at = at++;
        } else {
            out[at++] = in[i];
        }
    }
    out[code_at] = (uint8_t)(at - code_at);
    return at;
}

int32_t cobs_decode(uint8_t *bytes, size_t count)
{
    size_t from = 0;
    size_t to = 0;
    while (from < count) {
        size_t code = bytes[from];
        if (code == 0 || from + code > count) {
            return -1;
        }
        for (size_t i = 1; i < code; i++) {
            if (bytes[from + i] == 0) {
                return -1;
            }
            bytes[to++] = bytes[from + i];
        }
        from += code;
        if (code < LONGEST_BLOCK && from < count) {
            bytes[to++] = 0;
        }
    }
    return (int32_t)to;
}
