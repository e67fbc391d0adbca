/* C interface of a complete gyro electronics: any plant, in any language, can close the loop through it.
 *
 *   struct wg_device_cfg cfg = {.sample_rate_millihz = 50000000, .adc_bits = 16, .dac_bits = 16, .serial = 1};
 *   struct wg_device *device = wg_device_create(&cfg, block, block_size);
 *   for (;;) { ... wg_device_set_thermometer(device, code); wg_device_run(device, n, adc, dac); ... }
 *   wg_device_destroy(device);
 *
 * The device is the same firmware that runs on the board, behind the host port: its telemetry is read as bytes, its commands are
 * written as bytes (docs/SPEC.md). Devices share nothing; one thread may use one device at a time. The same calls give the same
 * bytes, always. The background part of the firmware runs every `poll_interval_samples` samples.
 *
 * The text between the two `cdef` marks is plain C without preprocessor lines, so that other languages can read it. */
#ifndef HAL_HOST_WINEGLASS_DEVICE_H
#define HAL_HOST_WINEGLASS_DEVICE_H

#include <stddef.h>
#include <stdint.h>

#include "hal/host/wg_export.h"

/* cdef begin */
struct wg_device;

struct wg_device_cfg {
    uint32_t sample_rate_millihz;   /* ADC and DAC rate in 1/1000 Hz; must be that of the calibration block */
    uint32_t adc_bits;              /* 8 .. 32; codes -2^(bits-1) .. 2^(bits-1) - 1, larger ones are clamped */
    uint32_t dac_bits;              /* 8 .. 32 */
    uint32_t poll_interval_samples; /* background run every so many samples; 0: once per slow tick */
    uint64_t serial;                /* unique id of the device */
    uint32_t loop_delay_samples_q16; /* of the board, used with the compiled-in calibration only; 0: one sample of latency and half a sample of hold */
};

/* What the firmware publishes once per slow tick. */
struct wg_device_signals {
    uint64_t sample_counter;        /* samples done */
    uint64_t freq_u64;              /* drive frequency, 2^64 = sample rate */
    int32_t primary_i_q30, primary_q_q30, secondary_i_q30, secondary_q_q30; /* of ADC full scale */
    int32_t drive_level_q31;        /* of DAC full scale */
    int32_t amplitude_set_point_q30;
    int32_t rebalance_in_phase_q31, rebalance_quadrature_q31; /* of DAC full scale */
    int32_t temperature_shift_q20;  /* degC from the calibration temperature */
    int32_t bias_rad_s_q31;
    int32_t rate_rad_s_q28;
    int32_t rate_uncompensated_rad_s_q28;
    int32_t quadrature_rad_s_q28;
    uint64_t angle_u64;             /* sum of the compensated, unfiltered rate in Q28 rad/s, one term a slow tick, modulo 2^64 */
    uint32_t status;                /* bits of enum gyro_status, docs/SPEC.md */
};

/* Reason code (docs/SPEC.md, 0 = accepted) that a device of this kind would give for a calibration block. */
WG_EXPORT int32_t wg_calibration_check(const struct wg_device_cfg *cfg, const uint8_t *block, size_t size);

/* One word of English for a reason code; never NULL. */
WG_EXPORT const char *wg_reason_text(int32_t reason);

/* Number of bytes of a calibration block of the present version. */
WG_EXPORT size_t wg_calibration_size(void);

/* A device with `block` in its store, as the factory leaves it; block = NULL: an empty store, so that it starts with the
 * compiled-in calibration (5 kHz at 50 kSa/s, calibration marked invalid). NULL when the memory or the block is refused
 * (wg_calibration_check says why). Acquisition begins with the first sample. */
WG_EXPORT struct wg_device *wg_device_create(const struct wg_device_cfg *cfg, const uint8_t *block, size_t size);
WG_EXPORT void wg_device_destroy(struct wg_device *device);

/* The thermometer's code from now on. Before the first call, and after wg_device_thermometer_fails, it does not answer. */
WG_EXPORT void wg_device_set_thermometer(struct wg_device *device, int32_t code);
WG_EXPORT void wg_device_thermometer_fails(struct wg_device *device);

/* A synchronisation pulse, `since_sample_q16` / 65536 sample periods after the last sample. */
WG_EXPORT void wg_device_sync(struct wg_device *device, uint32_t since_sample_q16);

/* n samples. adc: n pairs (primary, secondary pickoff code); dac: n pairs (drive, rebalance code), dac[i] computed from adc[i]. */
WG_EXPORT void wg_device_run(struct wg_device *device, size_t n, const int32_t *adc, int32_t *dac);

/* Run the firmware's background once, between samples. */
WG_EXPORT void wg_device_poll(struct wg_device *device);

/* Samples per slow tick with the present calibration. */
WG_EXPORT uint32_t wg_device_slow_period(const struct wg_device *device);

/* Telemetry: waiting bytes; take at most `capacity` of them, oldest first. Returns the count. */
WG_EXPORT size_t wg_device_telemetry_pending(const struct wg_device *device);
WG_EXPORT size_t wg_device_telemetry_read(struct wg_device *device, uint8_t *bytes, size_t capacity);

/* Command bytes for the device, executed at its next polls. Returns 0, or -1 when there is no memory. */
WG_EXPORT int32_t wg_device_command_write(struct wg_device *device, const uint8_t *bytes, size_t count);

WG_EXPORT void wg_device_get_signals(const struct wg_device *device, struct wg_device_signals *signals);

/* Complete state and configuration of the signal processing between two samples, in the format of the snapshot frames.
 * wg_device_snapshot returns the size, or -1 when capacity is too small; wg_device_restore 0 or the reason code why
 * it was refused (docs/SPEC.md; nothing has changed then): a snapshot is checked number by number, none can make the firmware fail. */
WG_EXPORT size_t wg_device_snapshot_size(void);
WG_EXPORT int64_t wg_device_snapshot(const struct wg_device *device, uint8_t *bytes, size_t capacity);
WG_EXPORT int32_t wg_device_restore(struct wg_device *device, const uint8_t *bytes, size_t size);

/* Switch off and on: everything but the store is lost. Unread telemetry stays readable. Returns 0, or -1 when the device finds nothing
 * to start from (no sound calibration, and the compiled-in one is for another sampling rate): its forces then stay 0 until a later
 * power cycle succeeds, and only wg_device_run, _telemetry_*, _store_*, _power_cycle and _destroy may be called. */
WG_EXPORT int32_t wg_device_power_cycle(struct wg_device *device);

/* The two flash sectors, one after the other. Reading returns the bytes copied (at most capacity); writing replaces the leading
 * `size` bytes, as a programmer or an accident would, and returns 0 or -1 (too long). */
WG_EXPORT size_t wg_device_store_size(void);
WG_EXPORT size_t wg_device_store_get(const struct wg_device *device, uint8_t *bytes, size_t capacity);
WG_EXPORT int32_t wg_device_store_set(struct wg_device *device, const uint8_t *bytes, size_t size);

/* Lose the supply during a flash operation: the `operations`-th from now (1 = the next) is left half done and every later one does
 * nothing until wg_device_power_cycle. 0 switches this off. */
WG_EXPORT void wg_device_cut_power_after(struct wg_device *device, uint32_t operations);

/* The firmware's kernels over arrays. */

/* Thermal polynomial: coef[6] in the format of `out`, argument in degC from the calibration temperature, 2^20 per degC.
 * Returns how many values were clamped, or -1 when order is not 0 .. 5. */
WG_EXPORT int64_t wg_thermal_polynomial_eval(const int32_t *coef, int32_t order, const int32_t *shift_q20, int32_t *out, size_t n);

/* Cosine and sine in Q30 of n phases, 2^32 = one turn. */
WG_EXPORT void wg_oscillator_eval(const uint32_t *phase_u32, int32_t *cosine_q30, int32_t *sine_q30, size_t n);

/* Lock-in of n pickoff samples (Q31) with an oscillator that starts at `phase_u64` and advances by `freq_u64` before each sample.
 * Writes n / decimation in-phase and quadrature values in Q30; returns their number, or -1 for a decimation not in 2 .. 32. */
WG_EXPORT int64_t wg_lockin_run(uint32_t decimation, uint64_t phase_u64, uint64_t freq_u64, const int32_t *pickoff_q31,
                                int32_t *in_phase_q30, int32_t *quadrature_q30, size_t n);

/* Decoupling filter over n samples, from rest. tuning[6] = center_freq_u64 (as int64), center_2cos_q40, center_cos_q31,
 * center_sin_q31, sample_period_q46, coupling_gain_q44. Returns how many samples were clamped, or -1 when the frequency or the
 * decay rate is outside the tuning's validity. */
WG_EXPORT int64_t wg_decoupler_run(const int64_t *tuning, uint64_t freq_u64, int32_t decay_per_s_q22, int32_t bias_rad_s_q31,
                                   const int32_t *primary_q31, int32_t *out_q31, size_t n);

/* Output filter `choice` (docs/SPEC.md) over n values of any 32-bit format, settled at `start`. Returns how many were clamped. */
WG_EXPORT int64_t wg_output_filter_run(uint32_t choice, int32_t start, const int32_t *values, int32_t *out, size_t n);

/* Magnitude (Q30) and angle (2^32 = one turn) of n complex values in Q30. */
WG_EXPORT void wg_polar_eval(const int32_t *i_q30, const int32_t *q_q30, int32_t *magnitude_q30, int32_t *angle_i32, size_t n);

/* Rate ratio Re(z2 conj(z1)) / |z1|^2 in Q29; 0 where the primary is too small. */
WG_EXPORT void wg_rate_ratio_eval(const int32_t *primary_i_q30, const int32_t *primary_q_q30, const int32_t *secondary_i_q30,
                                  const int32_t *secondary_q_q30, int32_t *ratio_q29, size_t n);

/* CRC-32 (IEEE 802.3) of n bytes. */
WG_EXPORT uint32_t wg_crc32(const uint8_t *bytes, size_t n);
/* cdef end */

/* For plants in C: the device's structure, and wg_device_sample(), which runs one sample without a call in between. */
#include "hal/host/host_device.h"

#endif
