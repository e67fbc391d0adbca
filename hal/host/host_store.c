#include "hal/host/host_store.h"

#include <string.h>

#include "hal/host/host_device.h"

/* How much of an operation of `size` bytes happens: all of it, half when the supply goes during it, nothing afterwards. */
static uint32_t powered_bytes(struct host_power *power, uint32_t size)
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
    return sector >= HAL_STORE_SECTORS || offset > HOST_STORE_SECTOR_BYTES || count > HOST_STORE_SECTOR_BYTES - offset;
}

int host_store_erase(void *context, uint32_t sector)
{
    struct wg_device *device = context;
    if (outside(sector, 0, 0)) {
        return HAL_ERROR_ADDRESS;
    }
    memset(device->store[sector], 0xFF, powered_bytes(&device->power, HOST_STORE_SECTOR_BYTES));
    return device->power.lost ? HAL_ERROR_STORE : HAL_OK;
}

int host_store_program(void *context, uint32_t sector, uint32_t offset, const uint8_t *bytes, uint32_t count)
{
    struct wg_device *device = context;
    uint32_t unit = device->properties.store_program_bytes;
    if (outside(sector, offset, count) || offset % unit != 0 || count % unit != 0) {
        return HAL_ERROR_ADDRESS;
    }
    uint32_t powered = powered_bytes(&device->power, count);
    for (uint32_t i = 0; i < powered; i++) {
        device->store[sector][offset + i] &= bytes[i];
    }
    return device->power.lost ? HAL_ERROR_STORE : HAL_OK;
}

int host_store_read(void *context, uint32_t sector, uint32_t offset, uint8_t *bytes, uint32_t count)
{
    const struct wg_device *device = context;
    if (outside(sector, offset, count)) {
        return HAL_ERROR_ADDRESS;
    }
    memcpy(bytes, &device->store[sector][offset], count);
    return HAL_OK;
}
