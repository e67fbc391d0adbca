#include "hal/host/wineglass_device.h"

#include <stdlib.h>
#include <string.h>

#include "application/store.h"
#include "hal/host/host_store.h"

#define LOOP_DELAY_Q16    (3u << 15) /* one sample of latency and half a sample of hold */
#define POLL_INTERVAL_MAX 64 /* the ring of raw samples must not fill up in between */

/* ---- the port ---------------------------------------------------------------------------------------------------------- */

static int write_bytes(void *context, const uint8_t *bytes, size_t count)
{
    struct wg_device *device = context;
    return host_queue_put(&device->telemetry, bytes, count) ? HAL_OK : HAL_ERROR_BUSY;
}

static size_t read_bytes(void *context, uint8_t *bytes, size_t capacity)
{
    struct wg_device *device = context;
    return host_queue_take(&device->commands, bytes, capacity);
}

/* Simulated time, so that equal runs give equal bytes: samples (1000 / rate) 10^6. Range: good for 2^63 / 10^9 samples (two days)
 * before the product is split. */
static uint64_t time_us(void *context)
{
    const struct wg_device *device = context;
    uint64_t rate = device->properties.sample_rate_millihz;
    uint64_t samples = device->app.sample_counter;
    return samples / rate * UINT64_C(1000000000) + samples % rate * UINT64_C(1000000000) / rate;
}

static void describe_board(struct wg_device *device, const struct wg_device_cfg *cfg)
{
    device->properties = (struct hal_properties){
        .unique_id = cfg->serial,
        .sample_rate_millihz = cfg->sample_rate_millihz,
        .adc_bits = cfg->adc_bits,
        .dac_bits = cfg->dac_bits,
        .loop_delay_samples_q16 = cfg->loop_delay_samples_q16 != 0 ? cfg->loop_delay_samples_q16 : LOOP_DELAY_Q16,
        .store_sector_bytes = HOST_STORE_SECTOR_BYTES,
        .store_program_bytes = 4,
    };
    device->hal = (struct hal){
        .properties = &device->properties,
        .context = device,
        .bytes_write = write_bytes,
        .bytes_read = read_bytes,
        .time_us = time_us,
        .store_erase = host_store_erase,
        .store_program = host_store_program,
        .store_read = host_store_read,
    };
}

/* ---- life -------------------------------------------------------------------------------------------------------------- */

static int start(struct wg_device *device)
{
    int status = application_init(&device->app, &device->hal);
    if (status == 0) {
        uint32_t interval = device->poll_interval_samples != 0 ? device->poll_interval_samples : wg_device_slow_period(device);
        device->samples_to_poll = interval < POLL_INTERVAL_MAX ? interval : POLL_INTERVAL_MAX;
    }
    return status;
}

int32_t wg_calibration_check(const struct wg_device_cfg *cfg, const uint8_t *block, size_t size)
{
    struct calibration calibration;
    struct hal_properties board = {.sample_rate_millihz = cfg->sample_rate_millihz, .dac_bits = cfg->dac_bits};
    return (int32_t)calibration_parse(block, size, &board, &calibration);
}

const char *wg_reason_text(int32_t reason)
{
    return reason_text((enum reason)reason);
}

size_t wg_calibration_size(void)
{
    return CALIBRATION_BYTES;
}

struct wg_device *wg_device_create(const struct wg_device_cfg *cfg, const uint8_t *block, size_t size)
{
    if (block != NULL && wg_calibration_check(cfg, block, size) != REASON_OK) {
        return NULL;
    }
    struct wg_device *device = calloc(1, sizeof *device);
    if (device == NULL) {
        return NULL;
    }
    describe_board(device, cfg);
    device->poll_interval_samples = cfg->poll_interval_samples;
    memset(device->store, 0xFF, sizeof device->store);
    if ((block != NULL && store_write(&device->hal, block, (uint32_t)size) != HAL_OK) || start(device) != 0) {
        wg_device_destroy(device);
        return NULL;
    }
    device->adc_max = (int32_t)(UINT32_C(0x7FFFFFFF) >> device->app.codes.adc_shift);
    device->adc_min = -device->adc_max - 1;
    return device;
}

void wg_device_destroy(struct wg_device *device)
{
    if (device != NULL) {
        host_queue_free(&device->telemetry);
        host_queue_free(&device->commands);
        free(device);
    }
}

int32_t wg_device_power_cycle(struct wg_device *device)
{
    device->power = (struct host_power){0, false};
    host_queue_free(&device->commands);
    return start(device) == 0 ? 0 : -1;
}

/* ---- running ----------------------------------------------------------------------------------------------------------- */

void wg_device_set_thermometer(struct wg_device *device, int32_t code)
{
    application_thermometer(&device->app, code);
}

void wg_device_thermometer_fails(struct wg_device *device)
{
    application_thermometer(&device->app, GYRO_THERMOMETER_INVALID);
}

void host_device_poll(struct wg_device *device)
{
    uint32_t interval = device->poll_interval_samples != 0 ? device->poll_interval_samples : wg_device_slow_period(device);
    device->samples_to_poll = interval < POLL_INTERVAL_MAX ? interval : POLL_INTERVAL_MAX;
    application_poll(&device->app);
}

void wg_device_poll(struct wg_device *device)
{
    application_poll(&device->app);
}

void wg_device_sync(struct wg_device *device, uint32_t since_sample_q16)
{
    application_sync(&device->app, since_sample_q16);
}

static int32_t clamp(int32_t value, int32_t low, int32_t high)
{
    return value < low ? low : value > high ? high : value;
}

void wg_device_run(struct wg_device *device, size_t n, const int32_t *adc, int32_t *dac)
{
    if (device->app.cfg == NULL) {
        memset(dac, 0, 2 * n * sizeof *dac);
        return;
    }
    for (size_t i = 0; i < n; i++) {
        const int32_t codes[2] = {
            clamp(adc[2 * i], device->adc_min, device->adc_max),
            clamp(adc[2 * i + 1], device->adc_min, device->adc_max),
        };
        wg_device_sample(device, codes, &dac[2 * i]);
    }
}

uint32_t wg_device_slow_period(const struct wg_device *device)
{
    return device->app.cfg->lockin.decimation * device->app.cfg->loops_per_slow;
}

size_t wg_device_telemetry_pending(const struct wg_device *device)
{
    return device->telemetry.count;
}

size_t wg_device_telemetry_read(struct wg_device *device, uint8_t *bytes, size_t capacity)
{
    return host_queue_take(&device->telemetry, bytes, capacity);
}

int32_t wg_device_command_write(struct wg_device *device, const uint8_t *bytes, size_t count)
{
    return host_queue_put(&device->commands, bytes, count) ? 0 : -1;
}

void wg_device_get_signals(const struct wg_device *device, struct wg_device_signals *signals)
{
    const struct gyro_signals *published = &device->app.gyro.signals;
    *signals = (struct wg_device_signals){
        .sample_counter = device->app.sample_counter,
        .freq_u64 = published->freq_u64,
        .primary_i_q30 = published->primary.i_q30,
        .primary_q_q30 = published->primary.q_q30,
        .secondary_i_q30 = published->secondary.i_q30,
        .secondary_q_q30 = published->secondary.q_q30,
        .drive_level_q31 = published->drive_level_q31,
        .amplitude_set_point_q30 = published->amplitude_set_point_q30,
        .rebalance_in_phase_q31 = published->rebalance_in_phase_q31,
        .rebalance_quadrature_q31 = published->rebalance_quadrature_q31,
        .temperature_shift_q20 = published->temperature_shift_q20,
        .bias_rad_s_q31 = published->bias_rad_s_q31,
        .rate_rad_s_q28 = published->rate_rad_s_q28,
        .rate_uncompensated_rad_s_q28 = published->rate_uncompensated_rad_s_q28,
        .quadrature_rad_s_q28 = published->quadrature_rad_s_q28,
        .angle_u64 = published->angle_u64,
        .status = published->status,
    };
}

/* ---- state ------------------------------------------------------------------------------------------------------------- */

size_t wg_device_snapshot_size(void)
{
    return snapshot_bytes();
}

int64_t wg_device_snapshot(const struct wg_device *device, uint8_t *bytes, size_t capacity)
{
    struct snapshot snapshot = {device->app.sample_counter, *device->app.cfg, device->app.gyro};
    if (capacity < snapshot_bytes()) {
        return -1;
    }
    return (int64_t)snapshot_write(&snapshot, 0, bytes, capacity);
}

/* The wanted configuration becomes the restored one, too, so that later commands start from it. */
int32_t wg_device_restore(struct wg_device *device, const uint8_t *bytes, size_t size)
{
    struct snapshot snapshot;
    struct application *app = &device->app;
    enum reason reason = snapshot_read(bytes, size, &snapshot);
    if (reason == REASON_OK && snapshot.cfg.dac_shift != app->codes.dac_shift) {
        reason = REASON_SNAPSHOT_BOARD;
    }
    if (reason != REASON_OK) {
        return (int32_t)reason;
    }
    app->cfgs[0] = app->cfgs[1] = snapshot.cfg;
    app->calibration.gyro = snapshot.cfg;
    app->gyro = snapshot.state;
    app->phase_calibration = (struct phase_calibration){.phase = PHASE_CALIBRATION_IDLE};
    app->sample_counter = snapshot.sample_counter;
    telemetry_restart(&app->telemetry);
    return 0;
}

size_t wg_device_store_size(void)
{
    return sizeof((struct wg_device *)0)->store;
}

size_t wg_device_store_get(const struct wg_device *device, uint8_t *bytes, size_t capacity)
{
    size_t count = capacity < sizeof device->store ? capacity : sizeof device->store;
    memcpy(bytes, device->store, count);
    return count;
}

int32_t wg_device_store_set(struct wg_device *device, const uint8_t *bytes, size_t size)
{
    if (size > sizeof device->store) {
        return -1;
    }
    memcpy(device->store, bytes, size);
    return 0;
}

void wg_device_cut_power_after(struct wg_device *device, uint32_t operations)
{
    device->power = (struct host_power){operations, false};
}
