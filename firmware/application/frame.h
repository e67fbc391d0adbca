/* Frames in both directions: header, payload, CRC-32; COBS; a zero byte as delimiter. docs/SPEC.md has the bytes. */
#ifndef WINEGLASS_APPLICATION_FRAME_H
#define WINEGLASS_APPLICATION_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "application/cobs.h"

#define FRAME_VERSION      1
#define FRAME_HEADER_BYTES 12
#define FRAME_CRC_BYTES    4
#define FRAME_MAX_PAYLOAD  480
#define FRAME_MAX_PLAIN    (FRAME_HEADER_BYTES + FRAME_MAX_PAYLOAD + FRAME_CRC_BYTES)
#define FRAME_MAX_ENCODED  (COBS_ENCODED_MAX(FRAME_MAX_PLAIN) + 1) /* with the delimiter */

struct frame_header {
    uint8_t version;
    uint8_t type;
    uint16_t sequence;       /* counts the sender's frames, modulo 2^16 */
    uint64_t sample_counter; /* samples done, 0 in commands */
};

/* Builds one frame in place: reserve, write the payload, encode. */
struct frame_buffer {
    uint8_t plain[FRAME_MAX_PLAIN];
    uint8_t encoded[FRAME_MAX_ENCODED];
};

static inline uint8_t *frame_payload(struct frame_buffer *buffer)
{
    return &buffer->plain[FRAME_HEADER_BYTES];
}

/* The payload stands in frame_payload(); returns the number of bytes in buffer->encoded. */
size_t frame_encode(struct frame_buffer *buffer, const struct frame_header *header, size_t payload_bytes);

/* Collects received bytes up to a delimiter. Anything longer than a frame is dropped up to the next delimiter. */
struct frame_receiver {
    uint8_t bytes[FRAME_MAX_ENCODED];
    uint32_t count;
    bool too_long;
    uint32_t errors; /* packets that were no frame: too long, not COBS, too short, wrong CRC */
};

struct frame_view {
    struct frame_header header;
    const uint8_t *payload; /* valid until the next byte is received */
    size_t payload_bytes;
};

/* Next received byte; true when it completes a sound frame. */
bool frame_receive(struct frame_receiver *receiver, uint8_t byte, struct frame_view *frame);

#endif
