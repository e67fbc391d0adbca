#include "hal/simulated/board.h"

#include <string.h>

#define POLL_INTERVAL_MAX 64u /* the ring of raw samples must not fill up in between */

/* ---- flash ------------------------------------------------------------------------------------------------------------- */

/* How much of an operation of `size` bytes happens: all of it, half when the supply goes during it, nothing afterwards. */
static uint32_t powered_bytes(struct simulated_power *power, uint32_t size)
{
    if (power->lost) {
        return 0;
    }
    if (power->operations_left == 0) {
        return size;
    }
    power->operations_left--;
    power->lost = power->operations_left == 0;
    return power->lost ? size / 2 : size;
}

static bool outside(uint32_t sector, uint32_t offset, uint32_t count)
{
    return sector >= HAL_STORE_SECTORS || offset > SIMULATED_SECTOR_BYTES || count > SIMULATED_SECTOR_BYTES - offset;
}

static int store_erase(void *context, uint32_t sector)
{
    struct simulated_board *board = context;
    if (outside(sector, 0, 0)) {
        return HAL_ERROR_ADDRESS;
    }
    memset(board->store[sector], 0xFF, powered_bytes(&board->power, SIMULATED_SECTOR_BYTES));
    return board->power.lost ? HAL_ERROR_STORE : HAL_OK;
}

static int store_program(void *context, uint32_t sector, uint32_t offset, const uint8_t *bytes, uint32_t count)
{
    struct simulated_board *board = context;
    uint32_t unit = board->properties.store_program_bytes;
    if (outside(sector, offset, count) || offset % unit != 0 || count % unit != 0) {
        return HAL_ERROR_ADDRESS;
    }
    uint32_t powered = powered_bytes(&board->power, count);
    for (uint32_t i = 0; i < powered; i++) {
        board->store[sector][offset + i] &= bytes[i];
    }
    return board->power.lost ? HAL_ERROR_STORE : HAL_OK;
}

static int store_copy(void *context, uint32_t sector, uint32_t offset, uint8_t *bytes, uint32_t count)
{
    const struct simulated_board *board = context;
    if (outside(sector, offset, count)) {
        return HAL_ERROR_ADDRESS;
    }
    memcpy(bytes, &board->store[sector][offset], count);
    return HAL_OK;
}

/* ---- time -------------------------------------------------------------------------------------------------------------- */

/* samples (1000 / rate) 10^6, split so that the product fits. */
static uint64_t time_us(void *context)
{
    const struct simulated_board *board = context;
    uint64_t rate = board->properties.sample_rate_millihz;
    uint64_t samples = board->app.sample_counter;
    return samples / rate * UINT64_C(1000000000) + samples % rate * UINT64_C(1000000000) / rate;
}

static uint32_t poll_interval(const struct simulated_board *board)
{
    uint32_t interval = board->poll_interval_samples != 0 ? board->poll_interval_samples : simulated_board_slow_period(board);
    return interval < POLL_INTERVAL_MAX ? interval : POLL_INTERVAL_MAX;
}

/* In this order: a configuration that the background has exchanged counts at once, and the call is one that can be counted (no jump). */
void simulated_board_poll(struct simulated_board *board)
{
    application_poll(&board->app);
    board->samples_to_poll = poll_interval(board);
}

/* ---- life -------------------------------------------------------------------------------------------------------------- */

void simulated_board_init(struct simulated_board *board, const struct hal_properties *properties,
                          int (*bytes_write)(void *context, const uint8_t *bytes, size_t count),
                          size_t (*bytes_read)(void *context, uint8_t *bytes, size_t capacity))
{
    board->properties = *properties;
    board->properties.store_sector_bytes = SIMULATED_SECTOR_BYTES;
    board->hal = (struct hal){
        .properties = &board->properties,
        .context = board,
        .bytes_write = bytes_write,
        .bytes_read = bytes_read,
        .time_us = time_us,
        .store_erase = store_erase,
        .store_program = store_program,
        .store_read = store_copy,
    };
    board->power = (struct simulated_power){0, false};
    memset(board->store, 0xFF, sizeof board->store);
}

int simulated_board_start(struct simulated_board *board)
{
    int status = application_init(&board->app, &board->hal);
    if (status == 0) {
        board->samples_to_poll = poll_interval(board);
    }
    return status;
}
