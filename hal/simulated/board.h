/* A board without hardware: what the ports to the host and to emulated machines share. Its flash is memory with the manners of flash, its time
 * the samples done, so that equal calls give equal bytes. Interrupt and background take turns. No heap: it runs on a bare processor, too. */
#ifndef HAL_SIMULATED_BOARD_H
#define HAL_SIMULATED_BOARD_H

#include <stddef.h>
#include <stdint.h>

#include "application/application.h"
#include "hal/hal.h"

#define SIMULATED_SECTOR_BYTES 1024

/* Loss of supply during flash operations. */
struct simulated_power {
    uint32_t operations_left; /* until the cut; 0: no cut planned */
    bool lost;
};

/* Stands first in a port's device, whose address is the context of the port's functions. */
struct simulated_board {
    struct application app;
    struct hal hal;
    struct hal_properties properties;
    uint32_t poll_interval_samples; /* 0: once per slow tick */
    uint32_t samples_to_poll;
    struct simulated_power power;
    uint8_t store[HAL_STORE_SECTORS][SIMULATED_SECTOR_BYTES];
};

/* An empty store, and the functions of the board but for the serial line, which the port has. */
void simulated_board_init(struct simulated_board *board, const struct hal_properties *properties,
                          int (*bytes_write)(void *context, const uint8_t *bytes, size_t count),
                          size_t (*bytes_read)(void *context, uint8_t *bytes, size_t capacity));

/* Power on; 0, or a negative error of application_init. */
int simulated_board_start(struct simulated_board *board);

/* The background's turn, and when it is next. */
void simulated_board_poll(struct simulated_board *board);

/* Samples per slow tick with the present calibration. */
static inline uint32_t simulated_board_slow_period(const struct simulated_board *board)
{
    return board->app.cfg->lockin.decimation * board->app.cfg->loops_per_slow;
}

/* What a converter could not have sent is clamped. */
static inline int32_t simulated_board_code(const struct simulated_board *board, int32_t code)
{
    int32_t high = (int32_t)(UINT32_C(0x7FFFFFFF) >> board->app.codes.adc_shift);
    return code > high ? high : code < -high - 1 ? -high - 1 : code;
}

/* Called after every sample. */
static inline void simulated_board_count(struct simulated_board *board)
{
    board->samples_to_poll--;
    if (board->samples_to_poll == 0) {
        simulated_board_poll(board);
    }
}

#endif
