/* The receiver: any bytes in, and what it accepts encodes to a frame that says the same. Then the input as a payload: there and back. */
#include <string.h>

#include "application/frame.h"
#include "fuzz.h"

static void expect_same(const struct frame_view *a, const struct frame_view *b)
{
    FUZZ_CHECK(a->header.version == b->header.version && a->header.type == b->header.type);
    FUZZ_CHECK(a->header.sequence == b->header.sequence && a->header.sample_counter == b->header.sample_counter);
    FUZZ_CHECK(a->payload_bytes == b->payload_bytes && memcmp(a->payload, b->payload, a->payload_bytes) == 0);
}

static void there_and_back(const struct frame_view *sent)
{
    struct frame_buffer buffer;
    struct frame_receiver receiver = {.count = 0};
    struct frame_view received;
    memcpy(frame_payload(&buffer), sent->payload, sent->payload_bytes);
    size_t count = frame_encode(&buffer, &sent->header, sent->payload_bytes);
    FUZZ_CHECK(count <= FRAME_MAX_ENCODED);
    for (size_t i = 0; i < count; i++) {
        bool complete = frame_receive(&receiver, buffer.encoded[i], &received);
        FUZZ_CHECK(complete == (i == count - 1));
    }
    expect_same(sent, &received);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct frame_receiver receiver = {.count = 0};
    struct frame_view frame;
    for (size_t i = 0; i < size; i++) {
        if (frame_receive(&receiver, data[i], &frame)) {
            /* an accepted frame is no longer than the encoder's longest, but for blocks that a better encoder would have joined */
            FUZZ_CHECK(frame.payload_bytes <= FRAME_MAX_ENCODED);
            if (frame.payload_bytes <= FRAME_MAX_PAYLOAD) {
                there_and_back(&frame);
            }
        }
    }
    struct frame_view whole = {{1, 2, 3, 4}, data, size < FRAME_MAX_PAYLOAD ? size : FRAME_MAX_PAYLOAD};
    if (size > 0) {
        there_and_back(&whole);
    }
    return 0;
}
