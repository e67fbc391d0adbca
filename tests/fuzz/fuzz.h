/* What every harness in this folder shares. A harness is one C file with LLVMFuzzerTestOneInput(): libFuzzer calls it with bytes of its own
 * making (`wineglass fuzz`), replay.c with the files of corpus/NAME (ctest, every compiler). A broken promise ends the process. */
#ifndef FUZZ_FUZZ_H
#define FUZZ_FUZZ_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define FUZZ_CHECK(promise)                                                                                         \
    do {                                                                                                            \
        if (!(promise)) {                                                                                           \
            fprintf(stderr, "%s:%d: broken: %s\n", __FILE__, __LINE__, #promise);                                   \
            abort();                                                                                                \
        }                                                                                                           \
    } while (0)

/* The input as a list of numbers; zeros when it is used up. */
struct fuzz_input {
    const uint8_t *next;
    size_t left;
};

static inline uint8_t fuzz_u8(struct fuzz_input *input)
{
    if (input->left == 0) {
        return 0;
    }
    input->left--;
    return *input->next++;
}

static inline uint16_t fuzz_u16(struct fuzz_input *input)
{
    uint16_t low = fuzz_u8(input);
    return (uint16_t)(low | fuzz_u8(input) << 8);
}

static inline uint32_t fuzz_u32(struct fuzz_input *input)
{
    uint32_t low = fuzz_u16(input);
    return low | (uint32_t)fuzz_u16(input) << 16;
}

/* At most `wanted` bytes; returns how many there were. */
static inline size_t fuzz_bytes(struct fuzz_input *input, size_t wanted, const uint8_t **bytes)
{
    size_t count = wanted < input->left ? wanted : input->left;
    *bytes = input->next;
    input->next += count;
    input->left -= count;
    return count;
}

#endif
