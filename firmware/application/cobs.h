/* Consistent overhead byte stuffing: a packet without a single zero byte, so that zero can delimit packets. */
#ifndef WINEGLASS_APPLICATION_COBS_H
#define WINEGLASS_APPLICATION_COBS_H

#include <stddef.h>
#include <stdint.h>

/* Worst encoded size of `count` bytes, without delimiter. */
#define COBS_ENCODED_MAX(count) ((count) + (count) / 254 + 1)

/* Returns the encoded size; `out` holds COBS_ENCODED_MAX(count) bytes and does not overlap `in`. */
size_t cobs_encode(const uint8_t *in, size_t count, uint8_t *out);

/* Decodes one packet (without its delimiter) in place. Returns the decoded size, or -1 if it is no valid packet. */
int32_t cobs_decode(uint8_t *bytes, size_t count);

#endif
