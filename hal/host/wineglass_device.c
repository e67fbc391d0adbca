#include "hal/host/wineglass_device.h"

#include <stdlib.h>
#include <string.h>

#include "application/store.h"

#define LOOP_DELAY_Q16 (3u << 15) /* one sample of latency and half a sample of hold */

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

static void describe_board(struct wg_device *device, const struct wg_device_cfg *cfg)
{
    const struct hal_properties properties = {
        .unique_id = cfg->serial,
        .sample_rate_millihz = cfg->sample_rate_millihz,
        .adc_bits = cfg->adc_bits,
        .dac_bits = cfg->dac_bits,
        .loop_delay_samples_q16 = cfg->loop_delay_samples_q16 != 0 ? cfg->loop_delay_samples_q16 : LOOP_DELAY_Q16,
        .store_program_bytes = 4,
    };
    simulated_board_init(&device->board, &properties, write_bytes, read_bytes);
    device->board.poll_interval_samples = cfg->poll_interval_samples;
}

/* ---- life -------------------------------------------------------------------------------------------------------------- */

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
    if ((block != NULL && store_write(&device->board.hal, block, (uint32_t)size) != HAL_OK) || simulated_board_start(&device->board) != 0) {
        wg_device_destroy(device);
        return NULL;
    }
    device->adc_max = (int32_t)(UINT32_C(0x7FFFFFFF) >> device->board.app.codes.adc_shift);
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
    device->board.power = (struct simulated_power){0, false};
    host_queue_free(&device->commands);
    return simulated_board_start(&device->board) == 0 ? 0 : -1;
}

/* ---- running ----------------------------------------------------------------------------------------------------------- */

void wg_device_set_thermometer(struct wg_device *device, int32_t code)
{
    application_thermometer(&device->board.app, code);
}

void wg_device_thermometer_fails(struct wg_device *device)
{
    application_thermometer(&device->board.app, GYRO_THERMOMETER_INVALID);
}

void wg_device_poll(struct wg_device *device)
{
    application_poll(&device->board.app);
}

void wg_device_sync(struct wg_device *device, uint32_t since_sample_q16)
{
    application_sync(&device->board.app, since_sample_q16);
}

static int32_t clamp(int32_t value, int32_t low, int32_t high)
{
    return value < low ? low : value > high ? high : value;
}

void wg_device_run(struct wg_device *device, size_t n, const int32_t *adc, int32_t *dac)
{
    if (device->board.app.cfg == NULL) {
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
    return simulated_board_slow_period(&device->board);
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
    const struct gyro_signals *published = &device->board.app.gyro.signals;
    *signals = (struct wg_device_signals){
        .sample_counter = device->board.app.sample_counter,
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
    struct snapshot snapshot = {device->board.app.sample_counter, *device->board.app.cfg, device->board.app.gyro};
    if (capacity < snapshot_bytes()) {
        return -1;
    }
    return (int64_t)snapshot_write(&snapshot, 0, bytes, capacity);
}

/* The wanted configuration becomes the restored one, too, so that later commands start from it. */
int32_t wg_device_restore(struct wg_device *device, const uint8_t *bytes, size_t size)
{
    struct snapshot snapshot;
    struct application *app = &device->board.app;
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
    return sizeof((struct wg_device *)0)->board.store;
}

size_t wg_device_store_get(const struct wg_device *device, uint8_t *bytes, size_t capacity)
{
    size_t count = capacity < sizeof device->board.store ? capacity : sizeof device->board.store;
    memcpy(bytes, device->board.store, count);
    return count;
}

int32_t wg_device_store_set(struct wg_device *device, const uint8_t *bytes, size_t size)
{
    if (size > sizeof device->board.store) {
        return -1;
    }
    memcpy(device->board.store, bytes, size);
    return 0;
}

void wg_device_cut_power_after(struct wg_device *device, uint32_t operations)
{
    device->board.power = (struct simulated_power){operations, false};
}
