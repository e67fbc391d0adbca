/* Inside of the host port, for plants in C that run millions of samples a second. Include hal/host/wineglass_device.h. */
#ifndef HAL_HOST_HOST_DEVICE_H
#define HAL_HOST_HOST_DEVICE_H

#include <stddef.h>
#include <stdint.h>

#include "application/application.h"
#include "hal/hal.h"
#include "hal/host/host_queue.h"

#define HOST_STORE_SECTOR_BYTES 1024

/* Loss of supply during flash operations. */
struct host_power {
    uint32_t operations_left; /* until the cut; 0: no cut planned */
    bool lost;
};

struct wg_device {
    struct application app;
    uint32_t poll_interval_samples;
    uint32_t samples_to_poll;
    int32_t adc_min, adc_max;
    struct hal hal;
    struct hal_properties properties;
    struct host_queue telemetry, commands;
    struct host_power power;
    uint8_t store[HAL_STORE_SECTORS][HOST_STORE_SECTOR_BYTES];
};

void host_device_poll(struct wg_device *device);

/* One sample: adc = primary and secondary pickoff code (must be within adc_bits), dac = drive and rebalance code. */
static inline void wg_device_sample(struct wg_device *device, const int32_t adc[2], int32_t dac[2])
{
    application_sample(&device->app, adc, dac);
    device->samples_to_poll--;
    if (device->samples_to_poll == 0) {
        host_device_poll(device);
    }
}

/* Phase of the oscillator at the last sample, 2^64 = one turn. */
static inline uint64_t wg_device_phase_u64(const struct wg_device *device)
{
    return device->app.gyro.oscillator.phase_u64;
}

#endif
