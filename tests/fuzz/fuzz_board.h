/* A board for the harnesses: flash that insists on its manners and can lose its supply, commands from memory, telemetry that must
 * decode. */
#ifndef FUZZ_FUZZ_BOARD_H
#define FUZZ_FUZZ_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "application/application.h"
#include "fuzz.h"
#include "hal/hal.h"

#define FUZZ_SECTOR_BYTES 512
#define FUZZ_IN_BYTES     1024 /* one poll takes that much */

struct fuzz_board {
    struct hal_properties properties;
    struct hal hal;
    uint8_t sectors[HAL_STORE_SECTORS][FUZZ_SECTOR_BYTES];
    uint32_t operations_left; /* to the loss of the supply; 0: none planned */
    bool lost;
    uint8_t in[FUZZ_IN_BYTES];
    size_t in_count, in_taken;
    struct frame_receiver receiver;
    uint32_t frames, acks;
    uint8_t ack_type, ack_reason; /* of the last acknowledgement */
    uint16_t ack_sequence;
};

void fuzz_board_init(struct fuzz_board *board);

/* One command frame for the next poll; payload_bytes at most FRAME_MAX_PAYLOAD. */
void fuzz_board_command(struct fuzz_board *board, uint8_t type, uint16_t sequence, const uint8_t *payload, size_t payload_bytes);

/* Samples with codes from the input, polled like the host port does; the forces must be codes of the DAC. */
void fuzz_board_run(struct fuzz_board *board, struct application *app, struct fuzz_input *input, uint32_t samples);

#endif
