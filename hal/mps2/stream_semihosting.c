/* The stream of the emulated board: standard input and output of the emulator, opened as files. */
#include "hal/mps2/semihosting.h"
#include "hal/stream/server.h"
#include "hal/stream/stream.h"

#define STATUS_NO_STREAM 98

static int32_t input, output;

bool stream_read(void *bytes, size_t count)
{
    unsigned char *next = bytes;
    while (count > 0) {
        size_t done = semihosting_read(input, next, count);
        if (done == 0) {
            return false;
        }
        next += done;
        count -= done;
    }
    return true;
}

bool stream_write(const void *bytes, size_t count)
{
    const unsigned char *next = bytes;
    while (count > 0) {
        size_t done = semihosting_write(output, next, count);
        if (done == 0) {
            return false;
        }
        next += done;
        count -= done;
    }
    return true;
}

int main(void)
{
    input = semihosting_open("/dev/stdin", SEMIHOSTING_READ_BINARY);
    output = semihosting_open("/dev/stdout", SEMIHOSTING_WRITE_BINARY);
    return input < 0 || output < 0 ? STATUS_NO_STREAM : server_run();
}
