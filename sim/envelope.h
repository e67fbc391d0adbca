/* The fast twin: the slowly varying amplitudes of both modes (paper eq 3) with the averaged behaviour of the firmware's loops, instead
 * of samples. Tens of thousands of times faster than real time; docs/NUMBERS.md has how far it is from the sampled twin.
 *
 * Takes the device, scenario and calibration block of the sampled twin and gives what telemetry would send, without noise:
 * means over frames. Time runs in slow ticks of the firmware; `step_ticks` of them are one step, `frame_steps` steps one frame.
 * Step i ends at slow tick (i + 1) step_ticks, whose sample counter is envelope_end_sample(): inputs are means over steps and values
 * at their ends. Where something happens (commands, forces at their limits, start-up) a step is done tick by tick.
 *
 * The firmware's arithmetic is ideal here: no quantisation, no noise, no lock detection. docs/DESIGN.md has the equations. */
#ifndef SIM_ENVELOPE_H
#define SIM_ENVELOPE_H

#include <stddef.h>
#include <stdint.h>

#include "hal/host/wg_export.h"
#include "sim/effects/effect.h"
#include "sim/twin.h"

/* cdef begin */
struct envelope;

enum envelope_start {
    ENVELOPE_START_COLD,    /* acquisition, then growth, as after power-up */
    ENVELOPE_START_SETTLED  /* in lock, both modes and all loops in the steady state of the first step */
};

struct envelope_cfg {
    uint32_t step_ticks;           /* 1..1000; 20; slow ticks per step */
    uint32_t frame_steps;          /* 1; steps per frame of the record */
    uint32_t start;                /* enum envelope_start */
    uint32_t n_effects;            /* 0; entries of effects */
    const struct effect_setting *effects;
    uint64_t most_single_ticks;    /* 0: any number; a run that needs more one by one is given up: its forces stand at their limits all along */
};

/* Commands to the firmware, as telemetry's counterpart would send them. */
enum envelope_command {
    ENVELOPE_AMPLITUDE,      /* value: set-point, FS */
    ENVELOPE_COMPENSATION,   /* 0 none, 1 static, 2 g2 */
    ENVELOPE_LOOP,           /* 0 open, 1 rebalance */
    ENVELOPE_TEST_SIGNAL,    /* in phase FS, quadrature FS, tone Hz (0: constant) */
    ENVELOPE_PHASE_SET_POINT,/* rad */
    ENVELOPE_PLL_GAINS,      /* 1/s, 1/s^2 */
    ENVELOPE_AGC_GAINS,      /* FS/FS, FS/FS/s */
    ENVELOPE_REBALANCE,      /* FS/FS, FS/FS/s, in-phase limit FS, quadrature limit FS */
    ENVELOPE_OUTPUT_FILTER,  /* 0..4, enum output_filter */
    ENVELOPE_DRIVE,          /* 0 off, 1 on */
    ENVELOPE_COMMAND_COUNT
};

struct envelope_event {
    double time_s;                 /* when the firmware's background executes it (ends of slow periods), since power-up; in order of time */
    uint32_t command;              /* enum envelope_command */
    uint32_t reserved;
    double value[4];
};

/* Arrays of n_steps values. */
struct envelope_profile {
    uint64_t n_steps;
    const double *rate_mean_rad_s; /* rad/s, mean over each step; NULL = 0 */
    const double *rate_end_rad_s;  /* rad/s at the end of each step; NULL = 0 */
    const double *chamber_degc;    /* degC at the end of each step, the shell's own if thermal.shell_imposed; NULL = held */
    uint64_t n_events;
    const struct envelope_event *events;
};

/* Means over frames, n_steps / frame_steps values each; any pointer may be NULL. Names and units as in a recording. */
struct envelope_record {
    double *primary_in_phase;      /* FS */
    double *primary_quadrature;    /* FS */
    double *secondary_in_phase;    /* FS */
    double *secondary_quadrature;  /* FS */
    double *drive_frequency;       /* Hz */
    double *drive_level;           /* FS */
    double *rebalance_in_phase;    /* FS */
    double *rebalance_quadrature;  /* FS */
    double *temperature_measured;  /* degC */
    double *rate;                  /* rad/s */
    double *rate_uncompensated;    /* rad/s */
    double *quadrature;            /* rad/s */
    double *amplitude_set_point;   /* FS */
    double *shell_degc;            /* degC, true */
};

/* NULL, with *error (if not NULL) an enum twin_error, when the sampled twin would refuse the same, the block is refused
 * (TWIN_ERROR_DEVICE; NULL = the firmware's own default), or the lengths are out of range (TWIN_ERROR_SAMPLE_RATE). */
WG_EXPORT struct envelope *envelope_create(const struct twin_cfg *plant, const struct envelope_cfg *cfg, const uint8_t *calibration_block,
                                           size_t calibration_bytes, int32_t *error);
WG_EXPORT void envelope_destroy(struct envelope *envelope);

/* Back to power-up: the same run again, without the cost of creation. */
WG_EXPORT void envelope_reset(struct envelope *envelope);

/* Runs profile->n_steps steps, a multiple of frame_steps, from where the last call ended. 0 or a negative enum twin_error;
 * TWIN_ERROR_LIMITED, TWIN_ERROR_RUNAWAY: it ends at the frame where the bound was passed, and only a reset goes on from there. */
WG_EXPORT int32_t envelope_run(struct envelope *envelope, const struct envelope_profile *profile, const struct envelope_record *record);

/* Sample counter of the slow tick that ends step number `step` (0, 1, ...); the first step begins step_ticks slow ticks before the end of
 * step 0, a little before power-up. */
WG_EXPORT int64_t envelope_end_sample(const struct envelope *envelope, uint64_t step);

/* Slow ticks that were done one by one since power-up, because something happened in them. */
WG_EXPORT uint64_t envelope_single_ticks(const struct envelope *envelope);
/* cdef end */

#endif
