/* The digital twin: resonator, temperatures and converters around one complete device (firmware in the loop), and the plant alone.
 *
 * Time: sample n (n = 1, 2, ...) is converted at t = n / sample_rate, and the firmware's answer acts dac_latency_samples later. A block
 * is block_samples samples; the resonator's parameters are those of the block's middle, held. The thermometer is read at the end
 * of each block, just before the block's last sample is handed to the firmware.
 *
 * The same configuration, profile and seed give the same bytes on every machine with IEEE 754 double arithmetic.
 * Structures hold plain numbers only. The regions between the cdef marks of resonator.h, thermal.h, electronics.h, effects/effect.h and
 * this file, in this order, are what a foreign-function interface needs. */
#ifndef SIM_TWIN_H
#define SIM_TWIN_H

#include <stddef.h>
#include <stdint.h>

#include "hal/host/wg_export.h"
#include "sim/effects/effect.h"
#include "sim/electronics.h"
#include "sim/resonator.h"
#include "sim/thermal.h"

/* cdef begin */
enum twin_error {
    TWIN_OK = 0,
    TWIN_ERROR_MEMORY = -1,
    TWIN_ERROR_SAMPLE_RATE = -2,  /* sample rate or block length zero, not a number, or fewer than 4 samples a cycle */
    TWIN_ERROR_RESONATOR = -3,    /* frequency or Q not positive, negative damping, or not a number */
    TWIN_ERROR_THERMAL = -4,      /* negative time constant or thermometer step, or not a number */
    TWIN_ERROR_ELECTRONICS = -5,  /* bits, delay, latency or noise out of range */
    TWIN_ERROR_DEVICE = -6,       /* the device refused its configuration or calibration block */
    TWIN_ERROR_PROFILE = -7,      /* missing array, a value that is not a number, or damping negative at its temperature */
    TWIN_ERROR_EFFECT = -8,       /* unknown effect, a parameter outside its bound, or too many effects */
    TWIN_ERROR_LIMITED = -9,      /* envelope twin: more slow ticks one by one than its configuration allows */
    TWIN_ERROR_RUNAWAY = -10      /* envelope twin: a mode rings beyond what any shell does */
};

struct twin;
struct wg_device;

struct twin_cfg {
    double sample_rate_hz;         /* samples/s; 50000 */
    uint32_t block_samples;        /* samples; 50 (1 ms); parameters, temperatures and records are per block */
    uint32_t serial;               /* 1; device serial number */
    uint64_t seed;                 /* 1; of every noise stream */
    struct resonator_cfg resonator;
    struct thermal_cfg thermal;
    struct electronics_cfg electronics;
};

/* What happens to the device. Arrays of n_blocks values, in order of time; the pointers need to live during twin_run only. */
struct twin_profile {
    uint64_t n_blocks;
    const double *rate_rad_s;      /* rad/s, mean over the block = at its middle; NULL = 0 */
    const double *rate_dot_rad_s2; /* rad/s^2 at the block's middle; NULL = 0 */
    const double *chamber_degc;    /* degC at the END of each block, linear in between, starting at thermal.initial_degc;
                                      the shell's own temperature if thermal.shell_imposed; NULL = held where it is */
};

/* What is written down, per block; any pointer may be NULL. All at the end of the block, the instant of its last sample. */
struct twin_record {
    double *shell_degc;            /* degC, true */
    double *thermometer_degc;      /* degC, what the code handed to the device says */
    double *primary_i;             /* FS; true primary x1 = Re((i + j q) exp(j phase)), phase of the device's oscillator */
    double *primary_q;             /* FS */
    double *secondary_i;           /* FS; true secondary, the same reference */
    double *secondary_q;           /* FS */
    int32_t *codes;                /* raw device codes of every sample, shape (n_blocks block_samples, 4): ADC primary, ADC secondary,
                                      DAC drive, DAC rebalance, the DAC codes as computed at that sample */
};

/* The truth at the last sample. */
struct twin_truth {
    double time_s;                 /* s since creation */
    double shell_degc;             /* degC */
    double resonance_hz;           /* Hz at which the primary's displacement lags a drive force by exactly 90 degrees, coupling included */
    double primary_frequency_hz;   /* Hz; sqrt(k1^2 - W^2) / 2 pi, coupling left out */
    double quality_factor;         /* 1; of the primary mode */
    double bias_rad_s;             /* rad/s; total cross damping as rate */
    double oscillator_hz;          /* Hz; the device's oscillator */
    double primary_amplitude;      /* FS */
    double primary_phase_rad;      /* rad in -pi..pi against the device's oscillator */
    double secondary_i;            /* FS; of the secondary, against the device's oscillator */
    double secondary_q;            /* FS */
    uint64_t samples;              /* since creation */
    uint64_t adc_saturations;      /* codes clamped since creation, both channels */
    uint64_t dac_saturations;      /* codes beyond the converter's width since creation */
};

/* A new twin at rest, in thermal equilibrium, its device just powered up. NULL calibration block = the device's own default.
 * Returns NULL and sets *error (if not NULL) to an enum twin_error. */
WG_EXPORT struct twin *twin_create(const struct twin_cfg *cfg, const uint8_t *calibration_block, size_t calibration_bytes, int32_t *error);

WG_EXPORT void twin_destroy(struct twin *twin);

/* Switches effects on, once, before the first run and before any command. 0, or TWIN_ERROR_EFFECT and none is on. */
WG_EXPORT int32_t twin_set_effects(struct twin *twin, const struct effect_setting *effects, uint32_t n_effects);

/* Runs profile->n_blocks blocks from where the last call ended. record may be NULL. Splitting a run into calls changes nothing.
 * 0, or a negative enum twin_error and nothing was run. */
WG_EXPORT int32_t twin_run(struct twin *twin, const struct twin_profile *profile, const struct twin_record *record);

/* The device inside, for its telemetry and commands. Owned by the twin. */
WG_EXPORT struct wg_device *twin_device(struct twin *twin);

WG_EXPORT void twin_truth(const struct twin *twin, struct twin_truth *truth);

/* The plant alone: no converters, no firmware.
 * forces: shape (n_blocks block_samples, 2), drive and rebalance as fractions of DAC full scale, each held over the sample interval
 * that ends at that sample; NULL = none. state: x1, x1', x2, x2' in FS and FS/s, in and out. trajectory: shape
 * (n_blocks block_samples, 4), the same after every sample; NULL = not wanted. shell_degc, rate and rate_dot per block; NULL = T0, 0, 0.
 * 0 or a negative enum twin_error. */
WG_EXPORT int32_t plant_run(const struct resonator_cfg *cfg, double sample_rate_hz, uint32_t block_samples, uint64_t n_blocks,
                  const double *shell_degc, const double *rate_rad_s, const double *rate_dot_rad_s2, const double *forces,
                  double *state, double *trajectory);

/* Standard Gaussian numbers of one of the twin's noise streams (0 ADC primary, 1 ADC secondary, 2 thermometer). */
WG_EXPORT void noise_fill(uint64_t seed, uint32_t stream, uint64_t n, double *values);
/* cdef end */

#endif
