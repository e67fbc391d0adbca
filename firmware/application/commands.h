/* Commands from the host. Each is answered by one acknowledgement; a refused one changes nothing and is counted.
 * docs/SPEC.md has the payloads. */
#ifndef WINEGLASS_APPLICATION_COMMANDS_H
#define WINEGLASS_APPLICATION_COMMANDS_H

#include "application/application.h"
#include "application/frame.h"

enum command_type {
    COMMAND_PING = 0x81,
    COMMAND_STATUS = 0x82,
    COMMAND_COMPENSATION = 0x83,
    COMMAND_AMPLITUDE = 0x84,
    COMMAND_PLL_GAINS = 0x85,
    COMMAND_AGC_GAINS = 0x86,
    COMMAND_OUTPUT_FILTER = 0x87,
    COMMAND_DIVISORS = 0x88,
    COMMAND_RAW_BURST = 0x89,
    COMMAND_RESTART = 0x8A,
    COMMAND_LOOP = 0x8B,
    COMMAND_REBALANCE = 0x8C,
    COMMAND_TEST_SIGNAL = 0x8D,
    COMMAND_PHASE_SET_POINT = 0x8E,
    COMMAND_PHASE_CALIBRATION = 0x8F,
    COMMAND_CALIBRATION_UNLOCK = 0x90,
    COMMAND_CALIBRATION_WRITE = 0x91,
    COMMAND_CALIBRATION_COMMIT = 0x92,
    COMMAND_CALIBRATION_READ = 0x93,
    COMMAND_PHASES_STORE = 0x94,
    COMMAND_DRIVE = 0x95
};

/* The key that unlocks the calibration: CRC-32 of the device's unique id as 8 little-endian bytes. It keeps a block from going to the
 * wrong device by mistake; it is no secret. */
uint32_t command_unlock_key(uint64_t unique_id);

void command_execute(struct application *app, const struct frame_view *frame);

#endif
