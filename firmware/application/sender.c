#include "application/sender.h"

bool sender_try(struct sender *sender, const struct hal *hal, enum frame_type type, uint64_t sample_counter,
                struct byte_writer end)
{
    struct frame_header header = {FRAME_VERSION, (uint8_t)type, sender->sequence, sample_counter};
    size_t payload_bytes = (size_t)(end.next - frame_payload(&sender->buffer));
    size_t count = frame_encode(&sender->buffer, &header, payload_bytes);
    if (hal->bytes_write(hal->context, sender->buffer.encoded, count) != HAL_OK) {
        return false;
    }
    sender->sequence++;
    return true;
}

void sender_send(struct sender *sender, const struct hal *hal, enum frame_type type, uint64_t sample_counter,
                 struct byte_writer end)
{
    if (!sender_try(sender, hal, type, sample_counter, end)) {
        sender->sequence++;
        sender->frames_lost++;
    }
}
