/* A stream of bytes to and from the machine outside: what every program of this port runs on. */
#ifndef HAL_STREAM_STREAM_H
#define HAL_STREAM_STREAM_H

#include <stdbool.h>
#include <stddef.h>

/* All `count` bytes, or false at the end of the stream. */
bool stream_read(void *bytes, size_t count);
bool stream_write(const void *bytes, size_t count);

#endif
