/* COBS: decoding anything stays inside its bytes; decoding what was encoded gives it back. */
#include <string.h>

#include "application/cobs.h"
#include "fuzz.h"

#define LONGEST 1024

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size > LONGEST) {
        return 0;
    }
    uint8_t *bytes = malloc(size + 1); /* on the heap: the sanitizer sees its ends */
    uint8_t *encoded = malloc(COBS_ENCODED_MAX(size));
    FUZZ_CHECK(bytes != NULL && encoded != NULL);
    memcpy(bytes, data, size);
    int32_t decoded = cobs_decode(bytes, size);
    FUZZ_CHECK(decoded >= -1 && decoded <= (int32_t)size);
    size_t count = cobs_encode(data, size, encoded);
    FUZZ_CHECK(count <= COBS_ENCODED_MAX(size) && memchr(encoded, 0, count) == NULL);
    FUZZ_CHECK(cobs_decode(encoded, count) == (int32_t)size && memcmp(encoded, data, size) == 0);
    free(bytes);
    free(encoded);
    return 0;
}
