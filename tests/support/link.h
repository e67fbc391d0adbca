/* A bad wire between frame encoder and receiver: random frames, byte errors, and the account of what came through. */
#ifndef SUPPORT_LINK_H
#define SUPPORT_LINK_H

#include <stdint.h>

struct link_result {
    uint64_t frames;          /* sent */
    uint64_t bytes;           /* sent */
    uint64_t errors;          /* bytes replaced, lost, or followed by one too many */
    uint64_t intact;          /* frames whose bytes all went through unharmed, with a delimiter before them */
    uint64_t recovered;       /* of these, received */
    uint64_t harmed_received; /* not intact, but received as sent: an error at a border that left the frame whole */
    uint64_t wrong;           /* received, but not what was sent */
    uint64_t refused;         /* packets that the receiver counted as damaged */
};

/* `frames` frames of 0 to 64 bytes of payload (a few up to the longest), each byte hit with the probability. */
struct link_result link_run(uint64_t frames, double byte_error_probability, uint64_t seed);

#endif
