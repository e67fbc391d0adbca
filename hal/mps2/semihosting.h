/* Files and the exit status of the machine that emulates this one (ARM semihosting). */
#ifndef HAL_MPS2_SEMIHOSTING_H
#define HAL_MPS2_SEMIHOSTING_H

#include <stddef.h>
#include <stdint.h>

enum semihosting_mode { SEMIHOSTING_READ_BINARY = 1, SEMIHOSTING_WRITE_BINARY = 5 };

/* Handle of an open file, or -1. Also opens named pipes. */
int32_t semihosting_open(const char *path, enum semihosting_mode mode);
void semihosting_close(int32_t handle);

/* Bytes read, 0 at the end; may be fewer than asked for. */
size_t semihosting_read(int32_t handle, void *bytes, size_t count);

/* Bytes written. */
size_t semihosting_write(int32_t handle, const void *bytes, size_t count);

/* Splits the command line at spaces; returns the number of words, at most `capacity`. They live in `text`. */
size_t semihosting_arguments(char *text, size_t text_bytes, char *words[], size_t capacity);

/* Ends the emulation; `status` 0 .. 255 becomes the emulator's own. */
_Noreturn void semihosting_exit(int status);

#endif
