#include "application/sync.h"

void sync_mark(struct sync *sync, uint64_t sample_counter, uint32_t since_sample_q16)
{
    uint32_t index;
    sync->pulses++;
    if (ring_slot(&sync->ring, SYNC_RECORDS, &index)) {
        sync->records[index] = (struct sync_record){sample_counter, since_sample_q16, sync->pulses};
        ring_put(&sync->ring);
    }
}

void sync_poll(struct sync *sync, struct sender *sender, const struct hal *hal)
{
    while (ring_waiting(&sync->ring) > 0) {
        const struct sync_record *record = &sync->records[ring_index(&sync->ring, SYNC_RECORDS, 0)];
        struct byte_writer writer = sender_payload(sender);
        put_u32(&writer, record->since_sample_q16);
        put_u32(&writer, record->number);
        sender_send(sender, hal, FRAME_SYNC, record->sample_counter, writer);
        ring_drop(&sync->ring, 1);
    }
}
