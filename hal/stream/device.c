#include "hal/stream/device.h"

#include "application/store.h"

/* ---- queues ------------------------------------------------------------------------------------------------------------ */

bool device_queue_put(struct device_queue *queue, const uint8_t *bytes, size_t count)
{
    if (count > queue->capacity - queue->count) {
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        queue->bytes[(queue->taken + queue->count + i) % queue->capacity] = bytes[i];
    }
    queue->count += count;
    return true;
}

size_t device_queue_take(struct device_queue *queue, uint8_t *bytes, size_t capacity)
{
    size_t count = queue->count < capacity ? queue->count : capacity;
    for (size_t i = 0; i < count; i++) {
        bytes[i] = queue->bytes[(queue->taken + i) % queue->capacity];
    }
    queue->taken = (queue->taken + count) % queue->capacity;
    queue->count -= count;
    return count;
}

/* ---- the port ---------------------------------------------------------------------------------------------------------- */

static int write_bytes(void *context, const uint8_t *bytes, size_t count)
{
    struct device *device = context;
    return device_queue_put(&device->telemetry, bytes, count) ? HAL_OK : HAL_ERROR_BUSY;
}

static size_t read_bytes(void *context, uint8_t *bytes, size_t capacity)
{
    struct device *device = context;
    return device_queue_take(&device->commands, bytes, capacity);
}

/* ---- life -------------------------------------------------------------------------------------------------------------- */

int32_t device_start(struct device *device, const struct hal_properties *properties, uint32_t poll_interval_samples,
                     const uint8_t *block, size_t size)
{
    simulated_board_init(&device->board, properties, write_bytes, read_bytes);
    device->board.poll_interval_samples = poll_interval_samples;
    device->telemetry = (struct device_queue){device->telemetry_bytes, DEVICE_TELEMETRY_BYTES, 0, 0};
    device->commands = (struct device_queue){device->command_bytes, DEVICE_COMMAND_BYTES, 0, 0};
    int status = size > 0 ? store_write(&device->board.hal, block, (uint32_t)size) : HAL_OK;
    return status == HAL_OK ? simulated_board_start(&device->board) : status;
}

/* What the interrupt of a board would do, as one function so that it can be watched. */
__attribute__((noinline)) static void device_sample(struct device *device, const int32_t adc[2], int32_t dac[2])
{
    application_sample(&device->board.app, adc, dac);
}

void device_run(struct device *device, size_t n, const int32_t *adc, int32_t *dac)
{
    const struct simulated_board *board = &device->board;
    for (size_t i = 0; i < n; i++) {
        const int32_t codes[2] = {simulated_board_code(board, adc[2 * i]), simulated_board_code(board, adc[2 * i + 1])};
        device_sample(device, codes, &dac[2 * i]);
        simulated_board_count(&device->board);
    }
}
