/* Calibration block: what the factory (or `wineglass calibrate`) knows about one device, as bytes, and its translation into the
 * configuration of the signal processing. Nothing is computed here but copies: the block carries every number as the firmware
 * needs it. docs/SPEC.md has the bytes; calibration.c has the one table of fields and their ranges. */
#ifndef WINEGLASS_APPLICATION_CALIBRATION_H
#define WINEGLASS_APPLICATION_CALIBRATION_H

#include <stdbool.h>
#include <stdint.h>

#include "application/reason.h"
#include "core/gyro.h"
#include "hal/hal.h"

#define CALIBRATION_MAGIC      UINT32_C(0x42434757) /* "WGCB" */
#define CALIBRATION_VERSION    1
#define CALIBRATION_BYTES      392
#define CALIBRATION_NAME_BYTES 16

/* A block as the firmware holds it. */
struct calibration {
    uint8_t device_name[CALIBRATION_NAME_BYTES]; /* zero-padded */
    uint32_t serial;
    uint32_t sequence;
    uint64_t created_unix_s;
    uint32_t sample_rate_millihz;
    int32_t reference_temperature_mdegc;
    int32_t angular_gain_q24; /* for the tools; the firmware needs it inside other numbers only */
    uint32_t crc;             /* the block's own */
    struct gyro_cfg gyro;
};

/* Checks size, magic, version, CRC, every field's range and the fields against each other and against the board.
 * *calibration is written only when the answer is REASON_OK. */
enum reason calibration_parse(const uint8_t *block, size_t size, const struct hal_properties *board,
                              struct calibration *calibration);

/* The same ranges, and the fields against each other, for a configuration that comes from elsewhere: only one that a block and commands can lead to. */
bool calibration_gyro_is_sound(const struct gyro_cfg *gyro);

/* A sound block with something added to the constant terms of both phase polynomials, its sequence number one up, and sealed again. */
void calibration_add_phases(uint8_t block[CALIBRATION_BYTES], int32_t drive_rad_q31, int32_t demodulation_rad_q31);

/* The compiled-in block: 5 kHz at 50 kSa/s, Q = 1e4, no compensation. */
extern const uint8_t calibration_default_block[CALIBRATION_BYTES];

#endif
