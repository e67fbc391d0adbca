/* A board for tests of the application: telemetry into memory, commands from memory, and flash that watches its manners (alignment, no
 * unit programmed twice, bits only cleared) and can lose its supply in any operation. */
#ifndef SUPPORT_BOARD_H
#define SUPPORT_BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "application/application.h"
#include "hal/hal.h"

#define BOARD_SECTOR_BYTES 1024
#define BOARD_OUT_BYTES    (1u << 20)
#define BOARD_IN_BYTES     4096

struct board {
    struct hal_properties properties;
    struct hal hal;
    uint8_t sectors[HAL_STORE_SECTORS][BOARD_SECTOR_BYTES];
    bool programmed[HAL_STORE_SECTORS][BOARD_SECTOR_BYTES];
    uint32_t operations;     /* erasures and programmings so far */
    uint32_t cut_at;         /* this operation (from 1) is left half done, all later ones do nothing; 0: never */
    bool powered;
    uint32_t bad_manners;    /* misaligned, outside, or programmed twice */
    bool link_busy;          /* bytes_write refuses */
    uint8_t *out;
    size_t out_count;
    uint8_t in[BOARD_IN_BYTES];
    size_t in_count, in_taken;
    bool thermometer_present, thermometer_answers;
    int32_t thermometer_raw;
    uint32_t kicks;
};

struct board *board_create(void); /* 50 kSa/s, 16 bit, empty store; program unit 4 bytes */
void board_destroy(struct board *board);
void board_power_up(struct board *board);

/* Sends one command frame. */
void board_command(struct board *board, uint8_t type, uint16_t sequence, const uint8_t *payload, size_t payload_bytes);

/* Next frame of what the board has sent: *from moves on. False at the end; a damaged frame fails the test. */
bool board_next_frame(struct board *board, size_t *from, struct frame_receiver *receiver, struct frame_view *frame);

/* Newest frame of a type, from the whole output; false when there is none. The view lives until the next call with this receiver. */
bool board_last_frame(struct board *board, uint8_t type, struct frame_receiver *receiver, struct frame_view *frame);

/* Little-endian field of a payload. */
uint64_t board_field(const struct frame_view *frame, size_t offset, unsigned width);

/* The compiled-in calibration block with fields replaced (block_set), and its CRC set right (block_seal). */
void block_default(uint8_t block[CALIBRATION_BYTES]);
void block_set(uint8_t block[CALIBRATION_BYTES], size_t offset, uint64_t value, unsigned width);
void block_seal(uint8_t block[CALIBRATION_BYTES]);

/* Offsets of some fields, docs/SPEC.md. */
enum {
    BLOCK_MAGIC = 0, BLOCK_VERSION = 4, BLOCK_SIZE = 6, BLOCK_SERIAL = 24, BLOCK_SEQUENCE = 28, BLOCK_CREATED = 32, BLOCK_SAMPLE_RATE = 40,
    BLOCK_DECIMATION = 44, BLOCK_NORMALISE = 48, BLOCK_LOOPS_PER_SLOW = 52, BLOCK_SHIFT_MIN = 68, BLOCK_SHIFT_MAX = 72,
    BLOCK_BIAS_ORDER = 76, BLOCK_BIAS = 80, BLOCK_REBALANCE_SCALE = 136, BLOCK_CENTER_FREQ = 248, BLOCK_CENTER_2COS = 256, BLOCK_CENTER_COS = 264,
    BLOCK_SAMPLE_PERIOD = 272, BLOCK_SEARCH_MIN = 280, BLOCK_SEARCH_MAX = 288, BLOCK_CHIRP = 296, BLOCK_AMPLITUDE = 332, BLOCK_DRIVE_MAX = 336,
    BLOCK_REBALANCE_KP = 340, BLOCK_REBALANCE_LIMIT = 348, BLOCK_QUADRATURE_LIMIT = 352, BLOCK_LOOP = 376, BLOCK_COMPENSATION = 380,
    BLOCK_OUTPUT_FILTER = 384, BLOCK_CRC = 388
};

#endif
