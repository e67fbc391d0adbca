/* Synchronisation pulses from outside: which sample was the last one before each, and how long before. */
#ifndef WINEGLASS_APPLICATION_SYNC_H
#define WINEGLASS_APPLICATION_SYNC_H

#include <stdint.h>

#include "application/ring.h"
#include "application/sender.h"

#define SYNC_RECORDS 8 /* pulses that may wait for the background */

struct sync_record {
    uint64_t sample_counter;   /* samples done when the pulse came */
    uint32_t since_sample_q16; /* time from that sample to the pulse, of a sample period */
    uint32_t number;           /* counts the pulses; a gap says that the background was too slow */
};

struct sync {
    uint32_t pulses; /* interrupt */
    struct ring ring;
    struct sync_record records[SYNC_RECORDS];
};

/* interrupt */
void sync_mark(struct sync *sync, uint64_t sample_counter, uint32_t since_sample_q16);

/* background: send what waits */
void sync_poll(struct sync *sync, struct sender *sender, const struct hal *hal);

#endif
