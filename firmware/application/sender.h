/* Numbers frames and hands them to the port. */
#ifndef WINEGLASS_APPLICATION_SENDER_H
#define WINEGLASS_APPLICATION_SENDER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "application/bytes.h"
#include "application/frame.h"
#include "hal/hal.h"

enum frame_type {
    FRAME_IDENTITY = 1,
    FRAME_STATUS = 2,
    FRAME_BASEBAND = 3,
    FRAME_OUTPUT = 4,
    FRAME_RAW = 5,
    FRAME_SNAPSHOT = 6,
    FRAME_ACK = 7,
    FRAME_CALIBRATION = 8,
    FRAME_SELF_TEST = 9,
    FRAME_SYNC = 10,
    FRAME_PHASES = 11
};

struct sender {
    struct frame_buffer buffer;
    uint16_t sequence;
    uint32_t frames_lost; /* the port had no room */
};

/* Where the payload of the next frame goes. */
static inline struct byte_writer sender_payload(struct sender *sender)
{
    struct byte_writer writer = {frame_payload(&sender->buffer)};
    return writer;
}

/* A frame that is lost when the port has no room: its number is spent, so the receiver sees the gap. */
void sender_send(struct sender *sender, const struct hal *hal, enum frame_type type, uint64_t sample_counter,
                 struct byte_writer end);

/* A frame that will be built again when the port has no room: returns false and spends no number. */
bool sender_try(struct sender *sender, const struct hal *hal, enum frame_type type, uint64_t sample_counter,
                struct byte_writer end);

#endif
