/* The examiner's plant: a gyro written a second time, from the equations of motion alone, that closes its loop through the real firmware.
 *
 * It shares nothing with the digital twin. Whatever changes slowly (parameters of shell and electronics, rate, temperature) comes as one number
 * per block boundary, a column; it is straight in between. Whatever depends on single samples is done here: converters, noise, jitter,
 * feedthrough, tones, pumping, a third mode, lost samples.
 *
 *   struct exam *exam = exam_create(&cfg, block, size);
 *   exam_run(exam, n, columns, thermometer_codes, &record);
 *   ... wg_device_telemetry_read(exam_device(exam), ...) ...
 *   exam_destroy(exam);
 *
 * The text between the two `cdef` marks is plain C without preprocessor lines, so that other languages can read it. */
#ifndef EXAM_EXAM_H
#define EXAM_EXAM_H

#include <stddef.h>
#include <stdint.h>

#include "hal/host/wineglass_device.h"

/* cdef begin */
/* Columns, at every block boundary. Channel 1 is the primary pickoff or the drive DAC, channel 2 the secondary or the rebalance DAC. */
enum exam_quantity {
    EXAM_STIFFNESS_11, EXAM_STIFFNESS_12, EXAM_STIFFNESS_21, EXAM_STIFFNESS_22, /* rad^2/s^2 */
    EXAM_DAMPING_11, EXAM_DAMPING_12, EXAM_DAMPING_21, EXAM_DAMPING_22,         /* 1/s */
    EXAM_RATE, EXAM_ANGULAR_GAIN,                                               /* rad/s, 1 */
    EXAM_DRIVE_FORCE_1, EXAM_DRIVE_FORCE_2, EXAM_REBALANCE_FORCE_1, EXAM_REBALANCE_FORCE_2, /* on mode 1, 2: FS/s^2 at full scale */
    EXAM_DRIVE_DELAY, EXAM_REBALANCE_DELAY,         /* s, 0 .. one period */
    EXAM_STIFFENING_1, EXAM_STIFFENING_2,           /* relative, of k_ii per FS^power of the amplitude of mode 1 */
    EXAM_THICKENING_1, EXAM_THICKENING_2,           /* relative, of c_ii per FS^power */
    EXAM_CUBIC_CROSS,                               /* rad^2/s^2/FS^2: force -c x1^2 x2 on mode 2, -c x2^2 x1 on mode 1 */
    EXAM_PUMP, EXAM_PUMP_HZ,                        /* relative modulation of both stiffnesses, and its frequency */
    EXAM_THIRD_HZ, EXAM_THIRD_DECAY, EXAM_THIRD_DRIVE, EXAM_THIRD_REBALANCE, EXAM_THIRD_SEEN_1, EXAM_THIRD_SEEN_2, /* a third mode */
    EXAM_GAIN_1, EXAM_GAIN_2, EXAM_LAG_1, EXAM_LAG_2, /* pickoffs: FS/FS, rad at the carrier */
    EXAM_SEES_SECONDARY, EXAM_SEES_PRIMARY,         /* pickoff 1 sees x2, pickoff 2 sees x1: FS/FS */
    EXAM_DRIVE_LEAK_1, EXAM_DRIVE_LEAK_2, EXAM_DRIVE_EDGE_2, EXAM_REBALANCE_LEAK_2, /* DAC output, or its change, into pickoffs: FS/FS */
    EXAM_OFFSET_1, EXAM_OFFSET_2, EXAM_NOISE_1, EXAM_NOISE_2, /* FS, FS rms */
    EXAM_MEMORY_1, EXAM_MEMORY_2,                   /* share of the other channel's conversion before this one */
    EXAM_JITTER, EXAM_SAMPLE_PERIOD,                /* s rms, s */
    EXAM_TONE_A, EXAM_TONE_A_HZ, EXAM_TONE_B, EXAM_TONE_B_HZ, EXAM_TONE_C, EXAM_TONE_C_HZ, /* amplitude in the unit of its place */
    EXAM_QUANTITIES
};

enum exam_place { EXAM_NOWHERE, EXAM_AT_ADC_1, EXAM_AT_ADC_2, EXAM_AT_BOTH_ADC, EXAM_AT_FORCE_1, EXAM_AT_FORCE_2, EXAM_AT_RATE, EXAM_AT_SAMPLE_TIME };

enum exam_trouble { EXAM_LOST, EXAM_STALE, EXAM_DOUBLED };

/* values[i stride]: i = 0 .. n; stride 0: constant. */
struct exam_column {
    const double *values;
    int64_t stride;
};

/* Something that happens to the converters' samples at a counter. LOST: `count` of them never arrive. STALE: the codes before are given `count`
 * times. DOUBLED: the codes of this sample are given `count` times more, in the time of one. */
struct exam_event {
    uint64_t sample;
    uint32_t kind, count;
};

struct exam_cfg {
    double sample_rate_hz, carrier_hz; /* nominal */
    uint32_t block_samples;            /* 1 .. 4096 */
    uint32_t adc_bits, dac_bits;
    uint32_t dac_latency_samples;      /* 0 .. 126 */
    uint32_t serial;
    uint64_t seed;
    uint32_t amplitude_power;          /* of STIFFENING and THICKENING: 1, 2 or 4 */
    double jitter_memory;              /* 0: white; r: first-order correlation from sample to sample */
    uint32_t quantum[2];               /* codes of each ADC are multiples of this; 1: all bits there */
    uint32_t tone_place[3];            /* enum exam_place */
    double tone_phase_rad[3];
    uint32_t curve_count;              /* knots of all curves that there are */
    const double *adc_error[2];        /* static characteristics, NULL: ideal */
    const double *dac_error[2];
    uint32_t event_count;
    const struct exam_event *events;   /* in order of their counters */
};

/* Where to write, one entry per block at its end, or NULL. codes: 4 per sample (ADC 1, 2, DAC 1, 2). state: 4 per block, x1, x1'/w, x2, x2'/w. */
struct exam_record {
    double *state;
    int32_t *codes;
};

struct exam;

/* NULL: no memory, or the firmware refuses the block, or the configuration is out of its bounds. Arrays of cfg are copied. */
WG_EXPORT struct exam *exam_create(const struct exam_cfg *cfg, const uint8_t *block, size_t size);
WG_EXPORT void exam_destroy(struct exam *exam);

/* n blocks. columns: EXAM_QUANTITIES of them, n + 1 values each; thermometer: n codes, given to the firmware at the start of each block. */
WG_EXPORT void exam_run(struct exam *exam, size_t n, const struct exam_column *columns, const int32_t *thermometer, const struct exam_record *record);

/* The plant without firmware and converters: dac gives n pairs of forces (FS), state n times 4 numbers. */
WG_EXPORT void exam_shell_run(struct exam *exam, const double *quantities, size_t n, const double *dac, double *state);

/* Number of quantities, 2^32, and size of struct exam_cfg: what a caller in another language must agree on. */
WG_EXPORT uint64_t exam_layout(void);

WG_EXPORT struct wg_device *exam_device(struct exam *exam);
WG_EXPORT uint64_t exam_clipped(const struct exam *exam);
WG_EXPORT void exam_set_state(struct exam *exam, const double state[4]);
WG_EXPORT void exam_normals(uint64_t seed, uint64_t stream, size_t n, double *out);
/* cdef end */

#endif
