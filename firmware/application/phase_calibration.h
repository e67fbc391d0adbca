/* Self-calibration of the two phases that let quadrature leak into the rate.
 *
 *   drive phase         by which the forces lag. The PLL then holds the shell off resonance, and the drive level D that holds the amplitude goes with
 *                       1/cos(lag + set-point): four set-points +e -e -e +e give tan(lag) = (D+ - D-) / (D+ + D-) / tan(e).
 *   demodulation phase  by which the secondary pickoff lags the primary. Open loop, a quadrature force +q -q -q +q must move the secondary
 *                       straight in quadrature; the angle by which it does not is the phase.
 *
 * Both sequences cancel a linear drift. The first runs with the rebalance loops closed, if there are any, so that the secondary does not pull at the
 * primary; the second runs behind it, with what the first has found in force. The rate is marked invalid all the time. docs/decisions/0005.
 *
 *   background: the sequence below          interrupt: means over PHASE_CALIBRATION_TICKS slow ticks
 *
 *   IDLE --start--> SETTLE --> MEASURE --next step--> SETTLE ... --> RECOVER --> IDLE, result sent */
#ifndef WINEGLASS_APPLICATION_PHASE_CALIBRATION_H
#define WINEGLASS_APPLICATION_PHASE_CALIBRATION_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "application/ring.h"
#include "core/gyro.h"

#define PHASE_CALIBRATION_TICKS   50u /* slow ticks per mean */
#define PHASE_CALIBRATION_RECORDS 4
#define PHASE_CALIBRATION_STEPS   4u  /* + - - + */

enum phase_calibration_part {
    PHASE_CALIBRATION_DRIVE = 1u << 0,
    PHASE_CALIBRATION_DEMODULATION = 1u << 1,
    PHASE_CALIBRATION_APPLY = 1u << 2 /* what was found stays in force until the next start */
};

enum phase_calibration_outcome {
    PHASE_CALIBRATION_DONE,
    PHASE_CALIBRATION_ABORTED,
    PHASE_CALIBRATION_DISTURBED /* lock lost, a converter or force at its limit, or no response */
};

enum phase_calibration_phase { PHASE_CALIBRATION_IDLE, PHASE_CALIBRATION_SETTLE, PHASE_CALIBRATION_MEASURE, PHASE_CALIBRATION_RECOVER };

/* What the command asks for. Times in means, PHASE_CALIBRATION_TICKS slow ticks each. */
struct phase_calibration_order {
    uint32_t parts;                /* enum phase_calibration_part */
    uint32_t settle_drive;         /* after a step of the set-point */
    uint32_t settle_demodulation;  /* after a step of the test force */
    uint32_t measure;
    int32_t phase_i32;             /* e, 2^32 = one turn */
    int32_t quadrature_q31;        /* q, of rebalance full scale */
};

/* Sums over PHASE_CALIBRATION_TICKS slow ticks. Range: 2^31 a tick. */
struct phase_record {
    int64_t drive_level, secondary_i, secondary_q, temperature_shift;
    uint32_t ticks;
    uint32_t status_or, status_and;
};

/* Correction to a phase, and half the difference between the two halves of the sequence; rad, q31. */
struct phase_found {
    int32_t correction_rad_q31, uncertainty_rad_q31;
};

struct phase_result {
    uint32_t outcome; /* enum phase_calibration_outcome */
    uint32_t parts;
    int32_t temperature_shift_q20;
    struct phase_found drive, demodulation;
    int32_t drive_rad_q31, demodulation_rad_q31; /* polynomial at that temperature, corrected */
};

/* What the sequence changes and puts back. */
struct phase_settings {
    uint32_t loop;
    int32_t phase_set_point_i32;
    struct test_signal_cfg test_signal;
    int32_t drive_rad_q31, demodulation_rad_q31; /* constant terms of the polynomials */
};

struct phase_calibration {
    _Atomic uint32_t collecting;

    /* interrupt */
    struct phase_record sum;

    /* interrupt to background */
    struct ring ring;
    struct phase_record records[PHASE_CALIBRATION_RECORDS];

    /* background */
    enum phase_calibration_phase phase;
    enum phase_calibration_part part;
    uint32_t step, means_left;
    struct phase_calibration_order order;
    struct phase_settings saved;
    struct phase_record step_sum[PHASE_CALIBRATION_STEPS];
    int64_t temperature_sum;
    uint32_t temperature_ticks;
    struct phase_result result;
    bool result_valid; /* of a calibration that was done, since the last start */
};

/* interrupt, once per slow tick */
void phase_calibration_add(struct phase_calibration *calibration, const struct gyro_signals *signals);

/* background. `gyro` is the configuration that is wanted; the functions change it. The sequence must not be running. */
void phase_calibration_start(struct phase_calibration *calibration, const struct phase_calibration_order *order, struct gyro_cfg *gyro);

/* background: take what has come in. True when *gyro has changed or the sequence has ended. */
bool phase_calibration_poll(struct phase_calibration *calibration, struct gyro_cfg *gyro);

/* background: put everything back. */
void phase_calibration_abort(struct phase_calibration *calibration, struct gyro_cfg *gyro);

static inline bool phase_calibration_idle(const struct phase_calibration *calibration)
{
    return calibration->phase == PHASE_CALIBRATION_IDLE;
}

#endif
