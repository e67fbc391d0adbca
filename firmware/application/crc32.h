/* CRC-32 of IEEE 802.3 (reflected polynomial 0xEDB88320, start and final inversion), the one of zlib and Ethernet. */
#ifndef WINEGLASS_APPLICATION_CRC32_H
#define WINEGLASS_APPLICATION_CRC32_H

#include <stddef.h>
#include <stdint.h>

/* Continue a checksum with more bytes; start with crc = 0. */
uint32_t crc32_update(uint32_t crc, const uint8_t *bytes, size_t count);

#endif
