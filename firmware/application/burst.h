/* Raw bursts: every device code of a stretch of samples, together with the complete state of the signal processing before the first of
 * them, so that the stretch can be replayed.
 *
 *        command            slow tick            last sample, or ring full      last chunk sent
 *   IDLE --------> ASKED ------------> RECORDING -------------------------> ENDED -------------> IDLE
 *     background          interrupt                    interrupt                    background
 *
 * The configuration is never exchanged while a burst is recorded. */
#ifndef WINEGLASS_APPLICATION_BURST_H
#define WINEGLASS_APPLICATION_BURST_H

#include <stdatomic.h>
#include <stdint.h>

#include "application/ring.h"
#include "application/sender.h"
#include "application/snapshot.h"

#define BURST_RING        128 /* samples that may wait for the background */
#define BURST_MAX_SAMPLES UINT32_C(50000000)

enum burst_phase { BURST_IDLE, BURST_ASKED, BURST_RECORDING, BURST_ENDED };

struct burst_sample {
    int32_t code[4]; /* primary and secondary ADC, drive and rebalance DAC */
    int32_t thermometer_raw;
};

struct burst {
    _Atomic uint32_t phase; /* enum burst_phase */
    uint32_t asked;         /* samples; background writes it before ASKED */

    /* interrupt until ENDED */
    uint32_t remaining;
    uint32_t missing; /* samples that found the ring full: the burst ends there */
    struct snapshot snapshot;
    struct ring ring;
    struct burst_sample samples[BURST_RING];

    /* background */
    uint32_t snapshot_sent; /* bytes */
    uint64_t next_sample;
    uint32_t bursts_cut;
};

/* background; false while another one is under way */
bool burst_ask(struct burst *burst, uint32_t samples);
bool burst_idle(struct burst *burst);

/* interrupt, at a slow tick: begin with the next sample if one was asked for */
void burst_begin(struct burst *burst, const struct gyro_cfg *cfg, const struct gyro_state *state, uint64_t sample_counter);

/* interrupt, every sample while burst->remaining > 0 */
void burst_add(struct burst *burst, const int32_t adc_raw[2], const int32_t dac_raw[2], int32_t thermometer_raw);

/* background: send what waits; code_bytes is 2 or 4 */
void burst_poll(struct burst *burst, struct sender *sender, const struct hal *hal, uint32_t code_bytes);

#endif
