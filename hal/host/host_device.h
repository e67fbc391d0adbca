/* Inside of the host port, for plants in C that run millions of samples a second. Include hal/host/wineglass_device.h. */
#ifndef HAL_HOST_HOST_DEVICE_H
#define HAL_HOST_HOST_DEVICE_H

#include <stddef.h>
#include <stdint.h>

#include "hal/host/host_queue.h"
#include "hal/simulated/board.h"

struct wg_device {
    struct simulated_board board; /* first: the context of its functions */
    int32_t adc_min, adc_max;
    struct host_queue telemetry, commands;
};

/* One sample: adc = primary and secondary pickoff code (must be within adc_bits), dac = drive and rebalance code. */
static inline void wg_device_sample(struct wg_device *device, const int32_t adc[2], int32_t dac[2])
{
    application_sample(&device->board.app, adc, dac);
    simulated_board_count(&device->board);
}

/* Phase of the oscillator at the last sample, 2^64 = one turn. */
static inline uint64_t wg_device_phase_u64(const struct wg_device *device)
{
    return device->board.app.gyro.oscillator.phase_u64;
}

#endif
