/* Bytes on the wire: CRC-32, COBS, frames and finding back into step after damage. */
#include <string.h>

#include "unity.h"

#include "application/crc32.h"
#include "application/frame.h"
#include "support/random.h"

void setUp(void)
{
}

void tearDown(void)
{
}

/* Published check values: "123456789" of the CRC catalogue, RFC 3720 style runs, computed elsewhere with zlib. */
static void crc_of_known_strings(void)
{
    uint8_t zeros[32] = {0}, ones[32];
    memset(ones, 0xFF, sizeof ones);
    TEST_ASSERT_EQUAL_HEX32(0x00000000, crc32_update(0, zeros, 0));
    TEST_ASSERT_EQUAL_HEX32(0xCBF43926, crc32_update(0, (const uint8_t *)"123456789", 9));
    TEST_ASSERT_EQUAL_HEX32(0xE8B7BE43, crc32_update(0, (const uint8_t *)"a", 1));
    TEST_ASSERT_EQUAL_HEX32(0x414FA339, crc32_update(0, (const uint8_t *)"The quick brown fox jumps over the lazy dog", 43));
    TEST_ASSERT_EQUAL_HEX32(0x190A55AD, crc32_update(0, zeros, 32));
    TEST_ASSERT_EQUAL_HEX32(0xFF6CAB0B, crc32_update(0, ones, 32));
}

/* The definition, bit by bit. */
static uint32_t crc_by_definition(const uint8_t *bytes, size_t count)
{
    uint32_t crc = UINT32_MAX;
    for (size_t i = 0; i < 8 * count; i++) {
        uint32_t bit = (crc ^ (uint32_t)(bytes[i / 8] >> (i % 8))) & 1u;
        crc = (crc >> 1) ^ (bit != 0 ? UINT32_C(0xEDB88320) : 0);
    }
    return ~crc;
}

static void crc_in_pieces_is_the_crc_of_the_whole(void)
{
    struct random_state random = random_begin("crc", 1);
    uint8_t bytes[600];
    for (int round = 0; round < 200; round++) {
        size_t count = random_u64(&random) % sizeof bytes;
        for (size_t i = 0; i < count; i++) {
            bytes[i] = (uint8_t)random_u64(&random);
        }
        size_t cut = count > 0 ? random_u64(&random) % count : 0;
        uint32_t crc = crc32_update(crc32_update(0, bytes, cut), bytes + cut, count - cut);
        TEST_ASSERT_EQUAL_HEX32(crc_by_definition(bytes, count), crc);
    }
}

static void expect_cobs(const uint8_t *plain, size_t count, const uint8_t *encoded, size_t encoded_count)
{
    uint8_t out[COBS_ENCODED_MAX(600)];
    TEST_ASSERT_EQUAL_size_t(encoded_count, cobs_encode(plain, count, out));
    TEST_ASSERT_EQUAL_HEX8_ARRAY(encoded, out, encoded_count);
    TEST_ASSERT_EQUAL_INT32(count, cobs_decode(out, encoded_count));
    if (count > 0) {
        TEST_ASSERT_EQUAL_HEX8_ARRAY(plain, out, count);
    }
}

/* The examples that every description of COBS gives. */
static void cobs_examples(void)
{
    expect_cobs((const uint8_t *)"", 0, (const uint8_t[]){1}, 1);
    expect_cobs((const uint8_t[]){0}, 1, (const uint8_t[]){1, 1}, 2);
    expect_cobs((const uint8_t[]){0, 0}, 2, (const uint8_t[]){1, 1, 1}, 3);
    expect_cobs((const uint8_t[]){0x11, 0x22, 0, 0x33}, 4, (const uint8_t[]){3, 0x11, 0x22, 2, 0x33}, 5);
    expect_cobs((const uint8_t[]){0x11, 0, 0, 0}, 4, (const uint8_t[]){2, 0x11, 1, 1, 1}, 5);
}

/* Runs without a zero around the longest block, with and without a zero behind them. */
static void cobs_long_runs(void)
{
    uint8_t plain[600], encoded[COBS_ENCODED_MAX(600)];
    memset(plain, 7, sizeof plain);
    for (size_t count = 252; count <= 512; count++) {
        for (int zero_ends = 0; zero_ends < 2; zero_ends++) {
            plain[count - 1] = zero_ends ? 0 : 7;
            size_t size = cobs_encode(plain, count, encoded);
            TEST_ASSERT_TRUE(size <= COBS_ENCODED_MAX(count));
            TEST_ASSERT_NULL(memchr(encoded, 0, size));
            TEST_ASSERT_EQUAL_INT32(count, cobs_decode(encoded, size));
            TEST_ASSERT_EQUAL_HEX8_ARRAY(plain, encoded, count);
            plain[count - 1] = 7;
        }
    }
    uint8_t exact[255];
    memset(exact, 7, sizeof exact);
    exact[0] = 255;
    expect_cobs(plain, 254, exact, 255);
}

static void cobs_refuses_nonsense(void)
{
    TEST_ASSERT_EQUAL_INT32(-1, cobs_decode((uint8_t[]){5, 1, 2}, 3));
    TEST_ASSERT_EQUAL_INT32(-1, cobs_decode((uint8_t[]){0}, 1));
    TEST_ASSERT_EQUAL_INT32(-1, cobs_decode((uint8_t[]){3, 1, 0}, 3));
    TEST_ASSERT_EQUAL_INT32(0, cobs_decode((uint8_t[]){1}, 1));
}

static void cobs_decodes_any_noise_within_its_buffer(void)
{
    struct random_state random = random_begin("cobs noise", 2);
    uint8_t bytes[300];
    for (int round = 0; round < 20000; round++) {
        size_t count = random_u64(&random) % sizeof bytes;
        for (size_t i = 0; i < count; i++) {
            bytes[i] = (uint8_t)(random_u64(&random) >> (round % 8));
        }
        TEST_ASSERT_TRUE(cobs_decode(bytes, count) <= (int32_t)count);
    }
}

static size_t make_frame(struct frame_buffer *buffer, uint16_t sequence, size_t payload_bytes, struct random_state *random)
{
    struct frame_header header = {FRAME_VERSION, 3, sequence, UINT64_C(0x1122334455667788)};
    for (size_t i = 0; i < payload_bytes; i++) {
        frame_payload(buffer)[i] = (uint8_t)(random_u64(random) & random_u64(random));
    }
    return frame_encode(buffer, &header, payload_bytes);
}

static void frames_of_every_size_come_back(void)
{
    struct random_state random = random_begin("frames", 3);
    static struct frame_buffer buffer;
    static struct frame_receiver receiver;
    for (size_t size = 0; size <= FRAME_MAX_PAYLOAD; size++) {
        struct frame_view frame;
        size_t count = make_frame(&buffer, (uint16_t)size, size, &random);
        TEST_ASSERT_TRUE(count <= FRAME_MAX_ENCODED);
        for (size_t i = 0; i < count; i++) {
            TEST_ASSERT_EQUAL(i == count - 1, frame_receive(&receiver, buffer.encoded[i], &frame));
        }
        TEST_ASSERT_EQUAL_UINT8(FRAME_VERSION, frame.header.version);
        TEST_ASSERT_EQUAL_UINT16(size, frame.header.sequence);
        TEST_ASSERT_EQUAL_HEX64(UINT64_C(0x1122334455667788), frame.header.sample_counter);
        TEST_ASSERT_EQUAL_size_t(size, frame.payload_bytes);
        TEST_ASSERT_EQUAL_INT(0, memcmp(frame_payload(&buffer), frame.payload, size));
    }
    TEST_ASSERT_EQUAL_UINT32(0, receiver.errors);
}

static uint32_t receive_all(struct frame_receiver *receiver, const uint8_t *bytes, size_t count)
{
    struct frame_view frame;
    uint32_t frames = 0;
    for (size_t i = 0; i < count; i++) {
        frames += frame_receive(receiver, bytes[i], &frame) ? 1 : 0;
    }
    return frames;
}

/* Any single changed byte is noticed, and the next frame is received again. */
static void a_changed_byte_costs_its_frame_only(void)
{
    struct random_state random = random_begin("damage", 4);
    static struct frame_buffer damaged, sound;
    static struct frame_receiver receiver;
    size_t count = make_frame(&damaged, 1, 40, &random);
    size_t sound_count = make_frame(&sound, 2, 40, &random);
    for (size_t i = 0; i + 1 < count; i++) {
        for (unsigned bit = 0; bit < 8; bit++) {
            damaged.encoded[i] ^= (uint8_t)(1u << bit);
            uint32_t errors = receiver.errors;
            TEST_ASSERT_EQUAL_UINT32(0, receive_all(&receiver, damaged.encoded, count));
            TEST_ASSERT_TRUE(receiver.errors > errors);
            TEST_ASSERT_EQUAL_UINT32(1, receive_all(&receiver, sound.encoded, sound_count));
            damaged.encoded[i] ^= (uint8_t)(1u << bit);
        }
    }
}

static void endless_noise_is_dropped_and_forgotten(void)
{
    struct random_state random = random_begin("noise", 5);
    static struct frame_buffer sound;
    static struct frame_receiver receiver;
    size_t count = make_frame(&sound, 2, 40, &random);
    for (int i = 0; i < 10000; i++) {
        TEST_ASSERT_EQUAL_UINT32(0, receive_all(&receiver, (const uint8_t[]){0xAA}, 1));
    }
    TEST_ASSERT_EQUAL_UINT32(0, receive_all(&receiver, (const uint8_t[]){0}, 1));
    TEST_ASSERT_EQUAL_UINT32(1, receiver.errors);
    TEST_ASSERT_EQUAL_UINT32(1, receive_all(&receiver, sound.encoded, count));
    TEST_ASSERT_EQUAL_UINT32(0, receive_all(&receiver, (const uint8_t[]){0, 0, 0}, 3));
    TEST_ASSERT_EQUAL_UINT32(1, receiver.errors);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(crc_of_known_strings);
    RUN_TEST(crc_in_pieces_is_the_crc_of_the_whole);
    RUN_TEST(cobs_examples);
    RUN_TEST(cobs_long_runs);
    RUN_TEST(cobs_refuses_nonsense);
    RUN_TEST(cobs_decodes_any_noise_within_its_buffer);
    RUN_TEST(frames_of_every_size_come_back);
    RUN_TEST(a_changed_byte_costs_its_frame_only);
    RUN_TEST(endless_noise_is_dropped_and_forgotten);
    return UNITY_END();
}
