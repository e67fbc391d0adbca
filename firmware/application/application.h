/* The whole firmware of one gyro on top of the HAL contract: start-up, signal processing, telemetry, commands, calibration store.
 *
 * The caller owns the memory; nothing is shared between two applications. Two contexts meet here:
 *
 *   interrupt   application_sample()   the signal processing; publishes at slow ticks; never waits, never calls the port
 *   background  application_poll()     everything else
 *
 * They exchange data in four lock-free ways: a new configuration is written to the copy that is not in use and taken over at a slow
 * tick; means of intervals and raw samples go through rings with one writer and one reader; a few live numbers stand behind a
 * sequence lock. What application_sample() does depends on the codes, the thermometer's code and the moment of a take-over, and on
 * nothing else. */
#ifndef WINEGLASS_APPLICATION_APPLICATION_H
#define WINEGLASS_APPLICATION_APPLICATION_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "application/burst.h"
#include "application/calibration.h"
#include "application/frame.h"
#include "application/live.h"
#include "application/phase_calibration.h"
#include "application/sender.h"
#include "application/sync.h"
#include "application/telemetry.h"
#include "core/gyro.h"
#include "hal/hal.h"

#define APPLICATION_ERROR_BOARD       (-1) /* the board's properties are outside the contract */
#define APPLICATION_ERROR_CALIBRATION (-2) /* no calibration in the store, and the compiled-in one does not suit the board */

/* What the background asks of the interrupt; taken over at the next slow tick outside a burst. */
enum application_request { REQUEST_CONFIGURATION = 1u << 0, REQUEST_RESTART = 1u << 1 };

enum calibration_source { CALIBRATION_COMPILED_IN, CALIBRATION_STORED, CALIBRATION_STORED_PREDECESSOR };

/* Codes of the converters <-> left-justified 32 bit. */
struct application_codes {
    uint32_t adc_shift, dac_shift; /* 32 - bits */
};

struct application_counters {
    uint32_t commands_accepted, commands_refused, store_errors;
};

struct application {
    /* interrupt */
    const struct gyro_cfg *cfg; /* one of cfgs[] */
    struct application_codes codes;
    uint64_t sample_counter;    /* samples done */
    struct gyro_state gyro;

    /* shared */
    _Atomic int32_t thermometer_raw;
    _Atomic uint32_t requests;  /* enum application_request */
    struct gyro_cfg cfgs[2];
    struct live_lock live;
    struct telemetry telemetry;
    struct burst burst;
    struct sync sync;
    struct phase_calibration phase_calibration;

    /* background */
    const struct hal *hal;
    struct calibration calibration; /* in force; its .gyro is the configuration that is wanted, commands change it */
    enum calibration_source calibration_source;
    uint32_t cfg_wanted;            /* index of the copy handed over last */
    bool cfg_changed;               /* hand the wanted configuration over at the next poll … */
    uint32_t restart_wanted;        /* … and start from cold with it: REQUEST_RESTART or 0 */
    bool calibration_unlocked;
    int32_t calibrated_amplitude_q30, calibrated_amplitude_limit_q30;
    uint8_t staged_block[CALIBRATION_BYTES];
    struct sender sender;
    struct frame_receiver receiver;
    struct application_counters counters;
};

/* Starts from cold: newest sound calibration of the store, else its predecessor, else the compiled-in one. 0 or a negative error. */
int application_init(struct application *app, const struct hal *hal);

/* background */
void application_poll(struct application *app);

/* background: samples done, as of the last slow tick */
uint64_t application_sample_counter(struct application *app);

/* background: a calibration has come into force; remembers what commands are relative to */
void application_note_calibrated(struct application *app);

/* any context: latest code of the thermometer, GYRO_THERMOMETER_INVALID when it does not answer */
static inline void application_thermometer(struct application *app, int32_t raw)
{
    atomic_store_explicit(&app->thermometer_raw, raw, memory_order_relaxed);
}

/* interrupt, never inside application_sample(): a synchronisation pulse, so long after the last sample (in 1/65536 of a sample
 * period, at most 65535; 0 when the port does not know) */
void application_sync(struct application *app, uint32_t since_sample_q16);

/* interrupt: end of a slow tick's sample; application_sample() calls it */
void application_slow_tick(struct application *app);

static inline int32_t application_pickoff_q31(const struct application *app, int32_t adc_raw)
{
    return (int32_t)((uint32_t)adc_raw << app->codes.adc_shift);
}

/* interrupt: one sample. adc_raw: primary and secondary pickoff; dac_raw: drive and rebalance force, which the
 * signal processing has already rounded to codes. */
static inline void application_sample(struct application *app, const int32_t adc_raw[2], int32_t dac_raw[2])
{
    const struct gyro_input input = {
        application_pickoff_q31(app, adc_raw[0]),
        application_pickoff_q31(app, adc_raw[1]),
        atomic_load_explicit(&app->thermometer_raw, memory_order_relaxed),
    };
    struct gyro_output output = gyro_step(app->cfg, &app->gyro, &input);
    dac_raw[0] = output.drive_q31 >> app->codes.dac_shift;
    dac_raw[1] = output.rebalance_q31 >> app->codes.dac_shift;
    app->sample_counter++;
    if (app->burst.remaining != 0) {
        burst_add(&app->burst, adc_raw, dac_raw, input.thermometer_raw);
    }
    if (output.slow_tick) {
        application_slow_tick(app);
    }
}

#endif
