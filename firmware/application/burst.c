#include "application/burst.h"

#define RAW_HEADER_BYTES      16
#define SNAPSHOT_CHUNK_HEADER 12
#define SNAPSHOT_CHUNK_BYTES  (FRAME_MAX_PAYLOAD - SNAPSHOT_CHUNK_HEADER)

#define RAW_FLAG_FIRST 1u
#define RAW_FLAG_LAST  2u
#define RAW_FLAG_CUT   4u

bool burst_idle(struct burst *burst)
{
    return atomic_load_explicit(&burst->phase, memory_order_acquire) == BURST_IDLE;
}

bool burst_ask(struct burst *burst, uint32_t samples)
{
    if (!burst_idle(burst)) {
        return false;
    }
    burst->asked = samples;
    burst->snapshot_sent = 0;
    atomic_store_explicit(&burst->phase, BURST_ASKED, memory_order_release);
    return true;
}

/* ---- interrupt --------------------------------------------------------------------------------------------------------- */

void burst_begin(struct burst *burst, const struct gyro_cfg *cfg, const struct gyro_state *state, uint64_t sample_counter)
{
    if (atomic_load_explicit(&burst->phase, memory_order_acquire) != BURST_ASKED) {
        return;
    }
    burst->snapshot.sample_counter = sample_counter;
    burst->snapshot.cfg = *cfg;
    burst->snapshot.state = *state;
    burst->remaining = burst->asked;
    burst->missing = 0;
    atomic_store_explicit(&burst->phase, BURST_RECORDING, memory_order_release);
}

void burst_add(struct burst *burst, const int32_t adc_raw[2], const int32_t dac_raw[2], int32_t thermometer_raw)
{
    uint32_t index;
    if (ring_slot(&burst->ring, BURST_RING, &index)) {
        burst->samples[index] = (struct burst_sample){{adc_raw[0], adc_raw[1], dac_raw[0], dac_raw[1]}, thermometer_raw};
        ring_put(&burst->ring);
        burst->remaining--;
    } else {
        burst->missing = burst->remaining;
        burst->remaining = 0;
    }
    if (burst->remaining == 0) {
        atomic_store_explicit(&burst->phase, BURST_ENDED, memory_order_release);
    }
}

/* ---- background -------------------------------------------------------------------------------------------------------- */

/* Returns true when the whole snapshot is out. */
static bool send_snapshot(struct burst *burst, struct sender *sender, const struct hal *hal)
{
    uint32_t total = (uint32_t)snapshot_bytes();
    while (burst->snapshot_sent < total) {
        struct byte_writer writer = sender_payload(sender);
        put_u64(&writer, burst->snapshot.sample_counter);
        put_u16(&writer, (uint16_t)burst->snapshot_sent);
        put_u16(&writer, (uint16_t)total);
        size_t count = snapshot_write(&burst->snapshot, burst->snapshot_sent, writer.next, SNAPSHOT_CHUNK_BYTES);
        writer.next += count;
        if (!sender_try(sender, hal, FRAME_SNAPSHOT, burst->snapshot.sample_counter, writer)) {
            return false;
        }
        burst->snapshot_sent += (uint32_t)count;
    }
    return true;
}

static const struct burst_sample *waiting_sample(struct burst *burst, uint32_t ahead)
{
    return &burst->samples[ring_index(&burst->ring, BURST_RING, ahead)];
}

/* Samples of the next chunk: as many as fit and share one thermometer code. 0: not enough yet. One sample stays behind until the
 * burst has ended, so that there is a last chunk to say so. */
static uint32_t next_chunk(struct burst *burst, uint32_t capacity, bool ended)
{
    uint32_t waiting = ring_waiting(&burst->ring);
    uint32_t count = 0;
    while (count < waiting && count < capacity) {
        if (waiting_sample(burst, count)->thermometer_raw != waiting_sample(burst, 0)->thermometer_raw) {
            return count;
        }
        count++;
    }
    return ended || (count == capacity && count < waiting) ? count : 0;
}

static uint32_t chunk_flags(struct burst *burst, uint32_t count, bool ended)
{
    bool last = ended && ring_waiting(&burst->ring) == count;
    return (burst->next_sample == burst->snapshot.sample_counter ? RAW_FLAG_FIRST : 0) | (last ? RAW_FLAG_LAST : 0) |
           (last && burst->missing > 0 ? RAW_FLAG_CUT : 0);
}

static bool send_chunk(struct burst *burst, struct sender *sender, const struct hal *hal, uint32_t count, uint32_t code_bytes,
                       bool ended)
{
    struct byte_writer writer = sender_payload(sender);
    put_u64(&writer, burst->next_sample);
    put_i32(&writer, waiting_sample(burst, 0)->thermometer_raw);
    put_u16(&writer, (uint16_t)count);
    put_u8(&writer, (uint8_t)code_bytes);
    put_u8(&writer, (uint8_t)chunk_flags(burst, count, ended));
    for (uint32_t i = 0; i < count; i++) {
        for (unsigned channel = 0; channel < 4; channel++) {
            put_little_endian(&writer, (uint32_t)waiting_sample(burst, i)->code[channel], code_bytes);
        }
    }
    return sender_try(sender, hal, FRAME_RAW, burst->next_sample, writer);
}

static void finish(struct burst *burst)
{
    burst->bursts_cut += burst->missing > 0 ? 1 : 0;
    atomic_store_explicit(&burst->phase, BURST_IDLE, memory_order_release);
}

void burst_poll(struct burst *burst, struct sender *sender, const struct hal *hal, uint32_t code_bytes)
{
    uint32_t phase = atomic_load_explicit(&burst->phase, memory_order_acquire);
    uint32_t capacity = (FRAME_MAX_PAYLOAD - RAW_HEADER_BYTES) / (4 * code_bytes);
    bool ended = phase == BURST_ENDED;
    if (phase != BURST_RECORDING && !ended) {
        return;
    }
    if (burst->snapshot_sent == 0) {
        burst->next_sample = burst->snapshot.sample_counter;
    }
    if (!send_snapshot(burst, sender, hal)) {
        return;
    }
    for (uint32_t count = next_chunk(burst, capacity, ended); count > 0; count = next_chunk(burst, capacity, ended)) {
        if (!send_chunk(burst, sender, hal, count, code_bytes, ended)) {
            return;
        }
        burst->next_sample += count;
        ring_drop(&burst->ring, count);
    }
    if (ended) {
        finish(burst);
    }
}
