#include "hal/stream/device.h"

#include <string.h>

#include "application/store.h"

#define POLL_INTERVAL_MAX 64u /* the ring of raw samples must not fill up in between */

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

/* Time of the samples done, so that equal runs give equal bytes. */
static uint64_t time_us(void *context)
{
    const struct device *device = context;
    uint64_t rate = device->properties.sample_rate_millihz;
    uint64_t samples = device->app.sample_counter;
    return samples / rate * UINT64_C(1000000000) + samples % rate * UINT64_C(1000000000) / rate;
}

static bool outside(uint32_t sector, uint32_t offset, uint32_t count)
{
    return sector >= HAL_STORE_SECTORS || offset > DEVICE_STORE_SECTOR_BYTES || count > DEVICE_STORE_SECTOR_BYTES - offset;
}

static int store_erase(void *context, uint32_t sector)
{
    struct device *device = context;
    if (outside(sector, 0, 0)) {
        return HAL_ERROR_ADDRESS;
    }
    memset(device->store[sector], 0xFF, DEVICE_STORE_SECTOR_BYTES);
    return HAL_OK;
}

static int store_program(void *context, uint32_t sector, uint32_t offset, const uint8_t *bytes, uint32_t count)
{
    struct device *device = context;
    uint32_t unit = device->properties.store_program_bytes;
    if (outside(sector, offset, count) || offset % unit != 0 || count % unit != 0) {
        return HAL_ERROR_ADDRESS;
    }
    for (uint32_t i = 0; i < count; i++) {
        device->store[sector][offset + i] &= bytes[i];
    }
    return HAL_OK;
}

static int store_copy(void *context, uint32_t sector, uint32_t offset, uint8_t *bytes, uint32_t count)
{
    const struct device *device = context;
    if (outside(sector, offset, count)) {
        return HAL_ERROR_ADDRESS;
    }
    memcpy(bytes, &device->store[sector][offset], count);
    return HAL_OK;
}

static const struct hal functions = {
    .bytes_write = write_bytes,
    .bytes_read = read_bytes,
    .time_us = time_us,
    .store_erase = store_erase,
    .store_program = store_program,
    .store_read = store_copy,
};

/* ---- life -------------------------------------------------------------------------------------------------------------- */

static uint32_t poll_interval(const struct device *device)
{
    const struct gyro_cfg *cfg = device->app.cfg;
    uint32_t asked = device->poll_interval_samples;
    uint32_t interval = asked != 0 ? asked : cfg->lockin.decimation * cfg->loops_per_slow;
    return interval < POLL_INTERVAL_MAX ? interval : POLL_INTERVAL_MAX;
}

int32_t device_start(struct device *device, const struct hal_properties *properties, uint32_t poll_interval_samples,
                     const uint8_t *block, size_t size)
{
    device->properties = *properties;
    device->properties.store_sector_bytes = DEVICE_STORE_SECTOR_BYTES;
    device->hal = functions;
    device->hal.properties = &device->properties;
    device->hal.context = device;
    device->poll_interval_samples = poll_interval_samples;
    device->telemetry = (struct device_queue){device->telemetry_bytes, DEVICE_TELEMETRY_BYTES, 0, 0};
    device->commands = (struct device_queue){device->command_bytes, DEVICE_COMMAND_BYTES, 0, 0};
    memset(device->store, 0xFF, sizeof device->store);
    int status = size > 0 ? store_write(&device->hal, block, (uint32_t)size) : HAL_OK;
    if (status == HAL_OK) {
        status = application_init(&device->app, &device->hal);
    }
    device->samples_to_poll = status == HAL_OK ? poll_interval(device) : 0;
    return status;
}

/* What a converter of `bits` could not have sent is clamped. */
static int32_t clamp_code(int32_t code, uint32_t shift)
{
    int32_t high = (int32_t)(UINT32_C(0x7FFFFFFF) >> shift);
    return code > high ? high : code < -high - 1 ? -high - 1 : code;
}

/* What the interrupt of a board would do, as one function so that it can be watched. */
__attribute__((noinline)) static void device_sample(struct device *device, const int32_t adc[2], int32_t dac[2])
{
    application_sample(&device->app, adc, dac);
}

void device_run(struct device *device, size_t n, const int32_t *adc, int32_t *dac)
{
    uint32_t shift = device->app.codes.adc_shift;
    for (size_t i = 0; i < n; i++) {
        const int32_t codes[2] = {clamp_code(adc[2 * i], shift), clamp_code(adc[2 * i + 1], shift)};
        device_sample(device, codes, &dac[2 * i]);
        device->samples_to_poll--;
        if (device->samples_to_poll == 0) {
            device->samples_to_poll = poll_interval(device);
            application_poll(&device->app);
        }
    }
}
