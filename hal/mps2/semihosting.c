#include "hal/mps2/semihosting.h"

#include <string.h>

#define SYS_OPEN          0x01u
#define SYS_CLOSE         0x02u
#define SYS_WRITE         0x05u
#define SYS_READ          0x06u
#define SYS_GET_CMDLINE   0x15u
#define SYS_EXIT_EXTENDED 0x20u
#define APPLICATION_EXIT  0x20026u

static uint32_t call(uint32_t operation, const void *parameters)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = parameters;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static uint32_t word(const void *pointer)
{
    return (uint32_t)(uintptr_t)pointer;
}

int32_t semihosting_open(const char *path, enum semihosting_mode mode)
{
    const uint32_t parameters[] = {word(path), (uint32_t)mode, (uint32_t)strlen(path)};
    return (int32_t)call(SYS_OPEN, parameters);
}

void semihosting_close(int32_t handle)
{
    const uint32_t parameters[] = {(uint32_t)handle};
    call(SYS_CLOSE, parameters);
}

size_t semihosting_read(int32_t handle, void *bytes, size_t count)
{
    const uint32_t parameters[] = {(uint32_t)handle, word(bytes), (uint32_t)count};
    return count - call(SYS_READ, parameters); /* the answer is how many were not read */
}

size_t semihosting_write(int32_t handle, const void *bytes, size_t count)
{
    const uint32_t parameters[] = {(uint32_t)handle, word(bytes), (uint32_t)count};
    return count - call(SYS_WRITE, parameters);
}

size_t semihosting_arguments(char *text, size_t text_bytes, char *words[], size_t capacity)
{
    uint32_t parameters[] = {word(text), (uint32_t)text_bytes};
    size_t count = 0;
    if (call(SYS_GET_CMDLINE, parameters) != 0) {
        return 0;
    }
    for (char *found = strtok(text, " "); found != NULL && count < capacity; found = strtok(NULL, " ")) {
        words[count++] = found;
    }
    return count;
}

_Noreturn void semihosting_exit(int status)
{
    const uint32_t parameters[] = {APPLICATION_EXIT, (uint32_t)status};
    for (;;) {
        call(SYS_EXIT_EXTENDED, parameters);
    }
}
