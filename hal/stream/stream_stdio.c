/* The stream of a process: standard input and standard output. */
#include <stdio.h>

#include "hal/stream/server.h"
#include "hal/stream/stream.h"

bool stream_read(void *bytes, size_t count)
{
    return fread(bytes, 1, count, stdin) == count;
}

bool stream_write(const void *bytes, size_t count)
{
    return fwrite(bytes, 1, count, stdout) == count && fflush(stdout) == 0;
}

int main(void)
{
    return server_run();
}
