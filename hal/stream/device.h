/* Port of the firmware to a machine without a board: converters, thermometer and serial line are calls, the store is memory. */
#ifndef HAL_STREAM_DEVICE_H
#define HAL_STREAM_DEVICE_H

#include <stddef.h>
#include <stdint.h>

#include "hal/simulated/board.h"

#define DEVICE_TELEMETRY_BYTES    (1u << 20)
#define DEVICE_COMMAND_BYTES      4096u

/* First in, first out; refuses what does not fit. */
struct device_queue {
    uint8_t *bytes;
    size_t capacity, count, taken;
};

struct device {
    struct simulated_board board; /* first: the context of its functions */
    struct device_queue telemetry, commands;
    uint8_t telemetry_bytes[DEVICE_TELEMETRY_BYTES];
    uint8_t command_bytes[DEVICE_COMMAND_BYTES];
};

/* Power on with `block` in the store (none when `size` is 0). 0, or a negative error of application_init or of the store. */
int32_t device_start(struct device *device, const struct hal_properties *properties, uint32_t poll_interval_samples,
                     const uint8_t *block, size_t size);

/* n samples: pairs of ADC codes in, pairs of DAC codes out; both may be the same memory. */
void device_run(struct device *device, size_t n, const int32_t *adc, int32_t *dac);

bool device_queue_put(struct device_queue *queue, const uint8_t *bytes, size_t count);
size_t device_queue_take(struct device_queue *queue, uint8_t *bytes, size_t capacity);

#endif
