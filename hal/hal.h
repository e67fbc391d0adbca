/* What the application needs of a board, and what the board's port owes the application.
 *
 * The port owns the interrupts and the main loop and calls three functions of application/application.h:
 *
 *   application_sample()       interrupt    once per ADC sample, codes in, codes out
 *   application_thermometer()  any context  whenever the thermometer has a new code or stops answering (optional, see below)
 *   application_poll()         background   as often as possible, at least every few slow ticks (1 ms each by default)
 *
 * In return it fills in one `struct hal`. Every function gets `context` back. All of them are called from the background only;
 * the interrupt never calls the port. */
#ifndef HAL_HAL_H
#define HAL_HAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define HAL_OK            0
#define HAL_ERROR_BUSY    (-1) /* try again later */
#define HAL_ERROR_STORE   (-2) /* flash reported a failure */
#define HAL_ERROR_ADDRESS (-3) /* outside the store, or not a multiple of the program unit */

/* The store is two sectors that are erased independently: one holds the calibration in use, the other its predecessor. */
#define HAL_STORE_SECTORS 2

/* Facts about the board. Constant while the application runs. */
struct hal_properties {
    uint64_t unique_id;              /* serial number of the device */
    uint32_t sample_rate_millihz;    /* nominal ADC and DAC rate, 1/1000 Hz: 50 kSa/s is 50 000 000 */
    uint32_t adc_bits;               /* 8 .. 32; codes are signed, right-justified: -2^(bits-1) .. 2^(bits-1) - 1 */
    uint32_t dac_bits;               /* 8 .. 32; the same */
    uint32_t loop_delay_samples_q16; /* ADC delay + computation + DAC hold, used with the compiled-in calibration only */
    uint32_t store_sector_bytes;     /* at least 512 */
    uint32_t store_program_bytes;    /* smallest unit that can be programmed: 1, 2, 4, 8, 16 or 32 */
};

struct hal {
    const struct hal_properties *properties;
    void *context;

    /* background. Queue all `count` bytes (at most 512) or none: HAL_OK or HAL_ERROR_BUSY. Must not wait. */
    int (*bytes_write)(void *context, const uint8_t *bytes, size_t count);

    /* background. Take at most `capacity` received bytes; returns how many. Must not wait. */
    size_t (*bytes_read)(void *context, uint8_t *bytes, size_t capacity);

    /* background, once per poll; may be NULL when the port pushes codes by application_thermometer(), which has less latency.
     * Returns false when the thermometer does not answer. Must not wait. */
    bool (*thermometer_read_raw)(void *context, int32_t *raw);

    /* background. Microseconds since power-up; monotonic. Reported in status frames, never used by the sample path. */
    uint64_t (*time_us)(void *context);

    /* background; may take as long as the flash takes. `sector` is 0 or 1. Erasing sets every byte to 0xFF; programming only
     * clears bits; offset and count are multiples of store_program_bytes and no unit is programmed twice between two erasures.
     * Return HAL_OK or a negative error. */
    int (*store_erase)(void *context, uint32_t sector);
    int (*store_program)(void *context, uint32_t sector, uint32_t offset, const uint8_t *bytes, uint32_t count);
    int (*store_read)(void *context, uint32_t sector, uint32_t offset, uint8_t *bytes, uint32_t count);

    /* background, once per poll; may be NULL. */
    void (*watchdog_kick)(void *context);
};

#endif
