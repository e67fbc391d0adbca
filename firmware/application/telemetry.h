/* Means of the published signals over a chosen number of slow ticks, as baseband and output frames. The interrupt adds up; the
 * background divides, frames and sends. */
#ifndef WINEGLASS_APPLICATION_TELEMETRY_H
#define WINEGLASS_APPLICATION_TELEMETRY_H

#include <stdatomic.h>
#include <stdint.h>

#include "application/ring.h"
#include "application/sender.h"
#include "core/gyro.h"

#define TELEMETRY_RECORDS 8 /* intervals that may wait for the background */

/* What both kinds of interval carry. */
struct telemetry_interval {
    uint64_t sample_counter; /* samples done at its end */
    uint32_t samples;        /* its length */
    uint32_t ticks;
    uint32_t status_or, status_and;
};

/* Range of every sum: 2^31 a tick, at most 65535 ticks: below 2^47. The frequency's halves are added as two 32-bit words. */
struct baseband_record {
    struct telemetry_interval interval;
    int64_t primary_i, primary_q, secondary_i, secondary_q, drive_level, amplitude_set_point;
    int64_t rebalance_in_phase, rebalance_quadrature;
    uint64_t freq_high, freq_low;
};

struct output_record {
    struct telemetry_interval interval;
    int64_t temperature_shift, bias, rate, rate_uncompensated, quadrature;
    uint64_t angle;          /* the last one */
    int32_t thermometer_raw; /* the last one */
};

struct telemetry {
    _Atomic uint32_t divisors; /* slow ticks per frame, 0 = off: baseband in the lower half, output in the upper one */

    /* interrupt */
    struct baseband_record baseband_sum;
    struct output_record output_sum;

    /* interrupt to background */
    struct ring baseband_ring, output_ring;
    struct baseband_record baseband[TELEMETRY_RECORDS];
    struct output_record output[TELEMETRY_RECORDS];
    _Atomic uint32_t records_lost; /* intervals for which the background was too slow */
    _Atomic uint32_t status_or, status_nand; /* of all ticks since the last status frame */
};

void telemetry_init(struct telemetry *telemetry);

/* background */
void telemetry_set_divisors(struct telemetry *telemetry, uint16_t baseband, uint16_t output);
uint16_t telemetry_baseband_divisor(struct telemetry *telemetry);
uint16_t telemetry_output_divisor(struct telemetry *telemetry);

/* interrupt, once per slow tick of `period_samples` samples */
void telemetry_add(struct telemetry *telemetry, const struct gyro_signals *signals, int32_t thermometer_raw,
                   uint64_t sample_counter, uint32_t period_samples);

/* interrupt: forget begun intervals, because what comes next has nothing to do with them */
void telemetry_restart(struct telemetry *telemetry);

/* background: send what waits */
void telemetry_poll(struct telemetry *telemetry, struct sender *sender, const struct hal *hal);

#endif
