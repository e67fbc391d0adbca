#include "application/frame.h"

#include "application/bytes.h"
#include "application/crc32.h"

size_t frame_encode(struct frame_buffer *buffer, const struct frame_header *header, size_t payload_bytes)
{
    struct byte_writer writer = {buffer->plain};
    size_t checked = FRAME_HEADER_BYTES + payload_bytes;
    put_u8(&writer, header->version);
    put_u8(&writer, header->type);
    put_u16(&writer, header->sequence);
    put_u64(&writer, header->sample_counter);
    writer.next += payload_bytes;
    put_u32(&writer, crc32_update(0, buffer->plain, checked));
    size_t encoded = cobs_encode(buffer->plain, checked + FRAME_CRC_BYTES, buffer->encoded);
    buffer->encoded[encoded] = 0;
    return encoded + 1;
}

static bool open_frame(uint8_t *bytes, size_t count, struct frame_view *frame)
{
    int32_t decoded = cobs_decode(bytes, count);
    if (decoded < FRAME_HEADER_BYTES + FRAME_CRC_BYTES) {
        return false;
    }
    size_t checked = (size_t)decoded - FRAME_CRC_BYTES;
    struct byte_reader crc = {bytes + checked, FRAME_CRC_BYTES, false};
    if (get_u32(&crc) != crc32_update(0, bytes, checked)) {
        return false;
    }
    struct byte_reader reader = {bytes, checked, false};
    frame->header.version = get_u8(&reader);
    frame->header.type = get_u8(&reader);
    frame->header.sequence = get_u16(&reader);
    frame->header.sample_counter = get_u64(&reader);
    frame->payload = reader.next;
    frame->payload_bytes = reader.left;
    return true;
}

/* Two delimiters in a row are an empty packet: senders use them to flush, nothing is counted. */
static bool close_packet(struct frame_receiver *receiver, struct frame_view *frame)
{
    uint32_t count = receiver->count;
    bool too_long = receiver->too_long;
    receiver->count = 0;
    receiver->too_long = false;
    if (count == 0) {
        return false;
    }
    if (too_long || !open_frame(receiver->bytes, count, frame)) {
        receiver->errors++;
        return false;
    }
    return true;
}

bool frame_receive(struct frame_receiver *receiver, uint8_t byte, struct frame_view *frame)
{
    if (byte == 0) {
        return close_packet(receiver, frame);
    }
    if (receiver->count < sizeof receiver->bytes) {
        receiver->bytes[receiver->count++] = byte;
    } else {
        receiver->too_long = true;
    }
    return false;
}
