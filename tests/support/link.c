#include "support/link.h"

#include <math.h>
#include <string.h>

#include "application/frame.h"
#include "support/random.h"

struct link {
    struct random_state random;
    struct link_result result;
    struct frame_receiver receiver;
    struct frame_buffer sent;
    struct frame_header header;
    size_t payload_bytes;
    double log_miss;         /* log(1 - probability of an error) */
    uint64_t to_next_error;  /* bytes that go through before it */
    bool harmed, received; /* the present frame */
};

/* Bytes between two errors: geometric. */
static uint64_t distance(struct link *link)
{
    double distance = log(random_uniform(&link->random, 1e-300, 1.0)) / link->log_miss;
    return distance < 1e18 ? (uint64_t)distance : UINT64_MAX;
}

static void compare(struct link *link, const struct frame_view *frame)
{
    const struct frame_header *sent = &link->header;
    bool same = frame->header.version == sent->version && frame->header.type == sent->type && frame->header.sequence == sent->sequence &&
                frame->header.sample_counter == sent->sample_counter && frame->payload_bytes == link->payload_bytes &&
                memcmp(frame->payload, frame_payload(&link->sent), link->payload_bytes) == 0;
    if (same && !link->received) {
        link->received = true;
    } else {
        link->result.wrong++;
    }
}

static void deliver(struct link *link, uint8_t byte)
{
    struct frame_view frame;
    if (frame_receive(&link->receiver, byte, &frame)) {
        compare(link, &frame);
    }
}

/* One third each: replaced by another byte, lost, one too many behind it. */
static void deliver_harmed(struct link *link, uint8_t byte)
{
    uint64_t dice = random_u64(&link->random);
    uint8_t wrong = (uint8_t)(byte + 1 + (dice >> 8) % 255);
    link->result.errors++;
    link->harmed = true;
    if (dice % 3 == 0) {
        deliver(link, wrong);
    } else if (dice % 3 == 1) {
        deliver(link, byte);
        deliver(link, wrong);
    }
}

static void transmit(struct link *link, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (link->to_next_error == 0) {
            deliver_harmed(link, link->sent.encoded[i]);
            link->to_next_error = distance(link);
        } else {
            deliver(link, link->sent.encoded[i]);
            link->to_next_error--;
        }
    }
    link->result.bytes += count;
}

/* In every other frame some bytes are zero, so that blocks of every length occur. */
static void make_payload(struct link *link)
{
    uint64_t dice = random_u64(&link->random);
    link->payload_bytes = dice % 64 == 0 ? (dice >> 8) % (FRAME_MAX_PAYLOAD + 1) : (dice >> 8) % 65;
    for (size_t i = 0; i < link->payload_bytes; i += 8) {
        uint64_t word = random_u64(&link->random) & (dice & (UINT64_C(1) << 32) ? UINT64_C(0xFF00FFFF00FF00FF) : UINT64_MAX);
        size_t left = link->payload_bytes - i;
        memcpy(frame_payload(&link->sent) + i, &word, left < 8 ? left : 8);
    }
}

static void send(struct link *link, uint64_t number)
{
    link->header = (struct frame_header){FRAME_VERSION, (uint8_t)(number % 9), (uint16_t)number, number * 500};
    make_payload(link);
    link->harmed = link->received = false;
    transmit(link, frame_encode(&link->sent, &link->header, link->payload_bytes));
}

struct link_result link_run(uint64_t frames, double byte_error_probability, uint64_t seed)
{
    struct link link = {.random = {seed}, .log_miss = log1p(-byte_error_probability)};
    link.to_next_error = distance(&link);
    for (uint64_t number = 0; number < frames; number++) {
        bool border = link.receiver.count == 0 && !link.receiver.too_long; /* a delimiter, or nothing, came last */
        send(&link, number);
        link.result.frames++;
        if (!link.harmed && border) {
            link.result.intact++;
            link.result.recovered += link.received ? 1 : 0;
        } else {
            link.result.harmed_received += link.received ? 1 : 0;
        }
    }
    link.result.refused = link.receiver.errors;
    return link.result;
}
