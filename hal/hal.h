/* What the application needs of a board, and what the board's port owes the application.
 *
 * The port owns the interrupts and the main loop and calls these functions of application/application.h:
 *
 *   application_sample()       interrupt    once per ADC sample, codes in, codes out
 *   application_thermometer()  any context  whenever the thermometer has a new code or stops answering (optional, see below)
 *   application_sync()         interrupt    at a synchronisation pulse, never inside application_sample() (optional)
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

/* What a board can find wrong with itself. */
enum hal_part {
    HAL_PART_CRYSTAL = 1u << 0,      /* oscillator of the sampling clock; without it the sample rate is as wrong as its replacement */
    HAL_PART_CORE_CLOCK = 1u << 1,   /* full speed */
    HAL_PART_SAMPLE_CLOCK = 1u << 2, /* clock of the converters */
    HAL_PART_CONVERTERS = 1u << 3,   /* samples arrive; without them the sample path runs on silence, slowly */
    HAL_PART_PICKOFFS = 1u << 4,     /* the codes of both pickoffs move: there is an analog front end */
    HAL_PART_THERMOMETER = 1u << 5,
    HAL_PART_STORE = 1u << 6,        /* the calibration's flash takes the key */
    HAL_PART_IMAGE = 1u << 7,        /* the program's CRC */
    HAL_PART_MEMORY = 1u << 8,       /* data memory keeps what is written */
    HAL_PART_WATCHDOG = 1u << 9,     /* runs */
    HAL_PART_UNIQUE_ID = 1u << 10,
    HAL_PART_LAST_RUN = 1u << 11     /* the run before ended by power or by the reset line, not by watchdog or fault */
};

/* Result of the board's self-test. The first two are set at start-up, once. */
struct hal_self_test {
    uint32_t checked, failed; /* enum hal_part */
    uint32_t core_clock_hz;
    uint32_t fault_address;   /* of the instruction that ended the run before, or the stack pointer that had left its room; 0: none */
    uint32_t samples_lost;    /* the interrupt was too late */
};

struct hal {
    const struct hal_properties *properties;
    void *context;
    const struct hal_self_test *self_test; /* sent with the identity; NULL: the board has none */

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
