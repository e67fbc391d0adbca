/* link FRAMES BYTE_ERROR_PROBABILITY SEED: frames over a bad wire, as JSON. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "support/link.h"

int main(int count, char **words)
{
    if (count != 4) {
        fprintf(stderr, "usage: link FRAMES BYTE_ERROR_PROBABILITY SEED\n");
        return 2;
    }
    struct link_result result = link_run(strtoull(words[1], NULL, 10), strtod(words[2], NULL), strtoull(words[3], NULL, 10));
    printf("{\"frames\": %" PRIu64 ", \"bytes\": %" PRIu64 ", \"errors\": %" PRIu64 ", \"intact\": %" PRIu64 ", \"recovered\": %" PRIu64
           ", \"harmed_received\": %" PRIu64 ", \"wrong\": %" PRIu64 ", \"refused\": %" PRIu64 "}\n",
           result.frames, result.bytes, result.errors, result.intact, result.recovered, result.harmed_received, result.wrong, result.refused);
    return result.wrong == 0 && result.recovered == result.intact ? 0 : 1;
}
