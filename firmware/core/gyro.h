/* One gyro: pickoff samples in, force samples out, rate and health beside them. A pure function of configuration, state and inputs.
 *
 * Three rates: every sample (mixers, decoupler, forces); every loop tick, `decimation` samples (amplitudes, drive loop); every slow
 * tick, `loops_per_slow` loop ticks (temperature, retuning, rate). The ticks' work is spread over the samples after them, one task a
 * sample, so that no sample is much longer than another. docs/DESIGN.md has the schedule. */
#ifndef WINEGLASS_CORE_GYRO_H
#define WINEGLASS_CORE_GYRO_H

#include <stdbool.h>
#include <stdint.h>

#include "core/acquisition.h"
#include "core/dac_shaper.h"
#include "core/decoupler.h"
#include "core/drive_loop.h"
#include "core/lockin.h"
#include "core/oscillator.h"
#include "core/output_filter.h"
#include "core/polar.h"
#include "core/rate.h"
#include "core/rebalance.h"
#include "core/test_signal.h"
#include "core/thermal_polynomial.h"

#define GYRO_THERMOMETER_INVALID INT32_MIN

enum gyro_loop {
    GYRO_LOOP_OPEN,      /* the secondary mode moves freely; rate = its amplitude relative to the primary */
    GYRO_LOOP_REBALANCE, /* forces null it; rate = the force in phase with the Coriolis force */
    GYRO_LOOP_COUNT
};

enum gyro_compensation {
    GYRO_COMPENSATION_NONE,   /* rate as demodulated */
    GYRO_COMPENSATION_STATIC, /* polynomial subtracted after demodulation */
    GYRO_COMPENSATION_G2,     /* decoupling before demodulation (paper eq 13); in rebalance, where nothing lags, the same as static */
    GYRO_COMPENSATION_COUNT
};

enum gyro_status {
    GYRO_STATUS_LOCKED = 1u << 0,             /* phase and amplitude within limits for the hold time */
    GYRO_STATUS_AMPLITUDE_IN_RANGE = 1u << 1, /* primary amplitude within 1 % of its set-point */
    GYRO_STATUS_ADC_SATURATED = 1u << 2,      /* a pickoff code stood at its limit since the last slow tick */
    GYRO_STATUS_DRIVE_SATURATED = 1u << 3,    /* drive force at its limit */
    GYRO_STATUS_OVERFLOW = 1u << 4,           /* an arithmetic result was clamped since the last slow tick */
    GYRO_STATUS_CALIBRATION_VALID = 1u << 5,
    GYRO_STATUS_TEMPERATURE_VALID = 1u << 6,  /* thermometer answers and the shift is inside the calibrated range */
    GYRO_STATUS_RETUNE_VALID = 1u << 7,       /* frequency and decay rate inside the tuning's validity */
    GYRO_STATUS_RATE_VALID = 1u << 8,         /* locked, no saturation, and whatever the compensation needs is valid */
    GYRO_STATUS_ACQUIRING = 1u << 9,          /* chirp or listening */
    GYRO_STATUS_REBALANCE_ACTIVE = 1u << 10,  /* the rebalance loops are closed */
    GYRO_STATUS_REBALANCE_SATURATED = 1u << 11, /* a rebalance force at its limit */
    GYRO_STATUS_TEST_ACTIVE = 1u << 12,       /* a test force is on, or the shell is held off resonance on purpose */
    GYRO_STATUS_DRIVE_OFF = 1u << 13          /* the drive is off by command: the shell rings down */
};

/* Thermometer code -> shift from the calibration temperature: (raw - offset_raw) gain. */
struct gyro_thermometer_cfg {
    int32_t offset_raw;           /* code at the calibration temperature */
    int32_t gain_degc_q36;        /* degC per code; 0 < gain < 2^-5 degC */
    int32_t shift_min_q20;        /* calibrated range */
    int32_t shift_max_q20;
};

struct gyro_monitor_cfg {
    int32_t phase_limit_i32;      /* |phase error| for lock, 2^32 = one turn */
    int32_t amplitude_limit_q30;  /* |amplitude error| for lock and range */
    uint32_t hold_ticks;          /* loop ticks within limits before `locked` is set */
    int32_t adc_limit_q31;        /* a pickoff beyond +- this counts as saturated */
};

struct gyro_cfg {
    struct lockin_cfg lockin;          /* decimation 8 .. 32: eight task slots */
    uint32_t loops_per_slow;           /* 1 .. 64 */
    struct acquisition_cfg acquisition;
    struct drive_loop_cfg drive;
    struct rebalance_cfg rebalance;
    struct test_signal_cfg test_signal;
    uint32_t loop_delay_samples_q16; /* ADC delay + computation + DAC hold: the drive leads by this much; < 64 samples */
    struct gyro_thermometer_cfg thermometer;
    struct thermal_polynomial bias_rad_s_q31;
    struct thermal_polynomial scale_rad_s_q28; /* rad/s per unit of secondary over primary amplitude, open loop */
    struct thermal_polynomial rebalance_scale_rad_s_q28; /* rad/s per unit of force over primary amplitude */
    struct thermal_polynomial decay_per_s_q22; /* z2 k2 */
    struct thermal_polynomial demodulation_phase_rad_q31; /* by which the secondary pickoff lags the primary */
    struct thermal_polynomial drive_phase_rad_q31; /* by which both forces lag, beyond the loop delay */
    struct decoupler_tuning tuning;
    struct gyro_monitor_cfg monitor;
    uint32_t loop;                   /* enum gyro_loop */
    uint32_t compensation;           /* enum gyro_compensation */
    uint32_t output_filter;          /* enum output_filter */
    uint32_t dac_shift;              /* 32 - DAC bits, 0 .. 24 */
    bool calibration_valid;
};

/* What the slow tick publishes; telemetry reads nothing else. */
struct gyro_signals {
    struct complex_q30 primary;        /* mean over the slow period, of ADC full scale */
    struct complex_q30 secondary;      /* after the decoupler, if it is on, and the demodulation phase */
    uint64_t freq_u64;                 /* total frequency */
    int32_t drive_level_q31;
    int32_t amplitude_set_point_q30;
    int32_t rebalance_in_phase_q31;    /* mean over the slow period; without the test force */
    int32_t rebalance_quadrature_q31;
    int32_t temperature_shift_q20;     /* degC from the calibration temperature */
    int32_t bias_rad_s_q31;            /* polynomial at that temperature */
    int32_t rate_rad_s_q28;            /* compensated as configured, filtered */
    int32_t rate_uncompensated_rad_s_q28;
    int32_t quadrature_rad_s_q28;      /* quadrature as the rate it would be 90 degrees later */
    uint64_t angle_u64;                /* running sum of the compensated, unfiltered rate in Q28 rad/s, one term a slow tick, modulo 2^64 */
    uint32_t status;
};

/* Sum of amplitudes over a slow period. Range: loops_per_slow <= 64 times 1.28 in Q30 < 2^37. */
struct gyro_sum {
    int64_t i_q30, q_q30;
};

/* A force at the carrier, in parts that go with the oscillator's cosine and sine. */
struct gyro_force {
    int32_t cosine_q31, sine_q31;
};

struct gyro_state {
    struct oscillator_state oscillator;
    struct lockin_state primary_lockin, secondary_lockin;
    struct decoupler_coefs decoupler_coefs;
    struct decoupler_state decoupler;
    struct acquisition_state acquisition;
    struct drive_loop_state drive;
    struct rebalance_state rebalance;
    struct test_signal_state test_signal;
    struct dac_shaper_state drive_shaper, rebalance_shaper;
    struct rate_state rate;
    struct output_filter_state filter, filter_uncompensated;
    struct complex_q30 primary, secondary;        /* of the last loop tick */
    struct polar primary_polar;                   /* the same, as magnitude and angle */
    struct gyro_sum primary_sum, secondary_sum;   /* over the slow period */
    struct gyro_sum rebalance_sum;                /* minus in-phase, plus quadrature force, halved to Q30 */
    struct phasor_q30 drive_lead;                 /* 90 degrees plus the loop delay at the present frequency */
    struct phasor_q30 demodulation;               /* angle by which the secondary amplitude is turned back: minus its lag */
    struct gyro_force drive_force, rebalance_force;
    uint32_t dac_mask;                            /* 2^dac_shift - 1: bits that a left-justified code does not have */
    int32_t two_cos_q30;                          /* of the oscillator's angle per sample, for the DAC shapers */
    int32_t temperature_shift_q20;
    int32_t bias_rad_s_q31, scale_rad_s_q28, decay_per_s_q22, drive_phase_rad_q31; /* at the last temperature */
    int32_t bias_at_tick_q31;                     /* polynomial at the last slow tick; bias_rad_s_q31 moves on from it */
    int32_t bias_step_q31;                        /* expected change of the bias per loop tick, followed while the decoupler is on */
    int32_t gain_step_q48;                        /* the same, of the decoupler's gain */
    uint32_t loop_slot;                           /* of the next sample: samples since the last loop tick */
    uint32_t slow_slot;                           /* loop ticks since the last slow tick */
    uint32_t blank_ticks;                         /* loop ticks to wait after a jump of the oscillator */
    uint32_t lock_ticks, silent_ticks;
    uint32_t loop, compensation;                  /* in force since the last slow tick */
    bool overflow, adc_saturated, drive_saturated, rebalance_saturated; /* since the last slow tick */
    bool temperature_seen, temperature_valid, retune_valid, decoupling;
    struct gyro_signals signals;
};

struct gyro_input {
    int32_t primary_q31, secondary_q31; /* pickoffs, left-justified codes */
    int32_t thermometer_raw;            /* latest code, or GYRO_THERMOMETER_INVALID; read once per slow tick */
};

struct gyro_output {
    int32_t drive_q31, rebalance_q31;   /* forces, of DAC full scale */
    bool slow_tick;                     /* `signals` has just been published */
};

/* From cold: acquisition begins with the next sample. */
void gyro_reset(const struct gyro_cfg *cfg, struct gyro_state *state);

/* One sample. Between two samples *cfg may be exchanged for another whole configuration. */
struct gyro_output gyro_step(const struct gyro_cfg *cfg, struct gyro_state *state, const struct gyro_input *input);

#endif
