#include "application/application.h"

#include <stddef.h>

#include "application/commands.h"
#include "application/reports.h"
#include "application/store.h"

#define BITS_MIN              8
#define BITS_MAX              32
#define STORE_SECTOR_BYTES_MIN 512
#define PROGRAM_BYTES_MAX     32
#define RECEIVE_BYTES         64 /* taken from the port at a time */
#define RECEIVE_ROUNDS        16

/* ---- start-up ---------------------------------------------------------------------------------------------------------- */

static bool bits_sound(uint32_t bits)
{
    return bits >= BITS_MIN && bits <= BITS_MAX;
}

static bool board_sound(const struct hal_properties *board)
{
    uint32_t unit = board->store_program_bytes;
    return bits_sound(board->adc_bits) && bits_sound(board->dac_bits) && unit >= 1 && unit <= PROGRAM_BYTES_MAX &&
           (unit & (unit - 1)) == 0 && board->store_sector_bytes >= STORE_SECTOR_BYTES_MIN &&
           board->store_sector_bytes % PROGRAM_BYTES_MAX == 0;
}

static bool load_stored(struct application *app)
{
    struct store_record found[HAL_STORE_SECTORS];
    uint32_t count = store_find(app->hal, CALIBRATION_BYTES, found);
    for (uint32_t i = 0; i < count; i++) {
        enum reason reason = REASON_STORE_FAILED;
        if (store_read(app->hal, &found[i], app->staged_block) == HAL_OK) {
            reason = calibration_parse(app->staged_block, found[i].size, app->hal->properties, &app->calibration);
        }
        if (reason == REASON_OK) {
            app->calibration_source = i == 0 ? CALIBRATION_STORED : CALIBRATION_STORED_PREDECESSOR;
            return true;
        }
        app->counters.store_errors++;
    }
    return false;
}

static bool load_compiled_in(struct application *app)
{
    const struct hal_properties *board = app->hal->properties;
    app->calibration_source = CALIBRATION_COMPILED_IN;
    if (calibration_parse(calibration_default_block, CALIBRATION_BYTES, board, &app->calibration) != REASON_OK) {
        return false;
    }
    app->calibration.gyro.loop_delay_samples_q16 = board->loop_delay_samples_q16;
    app->calibration.gyro.calibration_valid = false;
    return true;
}

void application_note_calibrated(struct application *app)
{
    app->calibrated_amplitude_q30 = app->calibration.gyro.drive.amplitude_q30;
    app->calibrated_amplitude_limit_q30 = app->calibration.gyro.monitor.amplitude_limit_q30;
}

static void clear(void *memory, size_t size)
{
    unsigned char *bytes = memory;
    for (size_t i = 0; i < size; i++) {
        bytes[i] = 0;
    }
}

int application_init(struct application *app, const struct hal *hal)
{
    clear(app, sizeof *app);
    if (!board_sound(hal->properties)) {
        return APPLICATION_ERROR_BOARD;
    }
    app->hal = hal;
    app->codes = (struct application_codes){32 - hal->properties->adc_bits, 32 - hal->properties->dac_bits};
    if (!load_stored(app) && !load_compiled_in(app)) {
        return APPLICATION_ERROR_CALIBRATION;
    }
    clear(app->staged_block, sizeof app->staged_block);
    application_note_calibrated(app);
    application_thermometer(app, GYRO_THERMOMETER_INVALID);
    telemetry_init(&app->telemetry);
    app->cfgs[0] = app->calibration.gyro;
    app->cfg = &app->cfgs[0];
    gyro_reset(app->cfg, &app->gyro);
    report_identity(app);
    return 0;
}

/* ---- interrupt --------------------------------------------------------------------------------------------------------- */

static void take_requests(struct application *app, uint32_t requests)
{
    if ((requests & REQUEST_CONFIGURATION) != 0) {
        app->cfg = app->cfg == &app->cfgs[0] ? &app->cfgs[1] : &app->cfgs[0];
    }
    if ((requests & REQUEST_RESTART) != 0) {
        gyro_reset(app->cfg, &app->gyro);
        telemetry_restart(&app->telemetry);
    }
    atomic_fetch_and_explicit(&app->requests, ~requests, memory_order_release);
}

void application_sync(struct application *app, uint32_t since_sample_q16)
{
    sync_mark(&app->sync, app->sample_counter, since_sample_q16 < 65536 ? since_sample_q16 : 65535);
}

/* No configuration is exchanged while a burst is recorded: its replay knows the one of its beginning only. */
void application_slow_tick(struct application *app)
{
    const struct gyro_signals *signals = &app->gyro.signals;
    uint32_t period_samples = app->cfg->lockin.decimation * app->cfg->loops_per_slow;
    int32_t thermometer_raw = atomic_load_explicit(&app->thermometer_raw, memory_order_relaxed);
    telemetry_add(&app->telemetry, signals, thermometer_raw, app->sample_counter, period_samples);
    phase_calibration_add(&app->phase_calibration, signals);
    live_publish(&app->live, (struct live){app->sample_counter, signals->status, app->gyro.acquisition.attempt});
    if (app->burst.remaining != 0) {
        return;
    }
    uint32_t requests = atomic_load_explicit(&app->requests, memory_order_acquire);
    if (requests != 0) {
        take_requests(app, requests);
    }
    burst_begin(&app->burst, app->cfg, &app->gyro, app->sample_counter);
}

/* ---- background -------------------------------------------------------------------------------------------------------- */

static void read_thermometer(struct application *app)
{
    int32_t raw;
    if (app->hal->thermometer_read_raw != NULL) {
        bool answers = app->hal->thermometer_read_raw(app->hal->context, &raw);
        application_thermometer(app, answers ? raw : GYRO_THERMOMETER_INVALID);
    }
}

static void receive(struct application *app)
{
    uint8_t bytes[RECEIVE_BYTES];
    struct frame_view frame;
    size_t count = RECEIVE_BYTES;
    for (unsigned round = 0; round < RECEIVE_ROUNDS && count == RECEIVE_BYTES; round++) {
        count = app->hal->bytes_read(app->hal->context, bytes, RECEIVE_BYTES);
        for (size_t i = 0; i < count; i++) {
            if (frame_receive(&app->receiver, bytes[i], &frame)) {
                command_execute(app, &frame);
            }
        }
    }
}

/* The copy that is not in use is free as soon as the interrupt has taken over the last one. */
static void hand_over_configuration(struct application *app)
{
    uint32_t requests = atomic_load_explicit(&app->requests, memory_order_acquire);
    if (!app->cfg_changed || (requests & REQUEST_CONFIGURATION) != 0) {
        return;
    }
    app->cfg_wanted = 1 - app->cfg_wanted;
    app->cfgs[app->cfg_wanted] = app->calibration.gyro;
    app->cfg_changed = false;
    atomic_fetch_or_explicit(&app->requests, REQUEST_CONFIGURATION | app->restart_wanted, memory_order_release);
    app->restart_wanted = 0;
}

static void calibrate_phases(struct application *app)
{
    if (phase_calibration_poll(&app->phase_calibration, &app->calibration.gyro)) {
        app->cfg_changed = true;
        if (phase_calibration_idle(&app->phase_calibration)) {
            report_phases(app);
        }
    }
}

uint64_t application_sample_counter(struct application *app)
{
    return live_read(&app->live).sample_counter;
}

void application_poll(struct application *app)
{
    const struct hal_properties *board = app->hal->properties;
    read_thermometer(app);
    receive(app);
    calibrate_phases(app);
    hand_over_configuration(app);
    sync_poll(&app->sync, &app->sender, app->hal);
    telemetry_poll(&app->telemetry, &app->sender, app->hal);
    burst_poll(&app->burst, &app->sender, app->hal, board->adc_bits <= 16 && board->dac_bits <= 16 ? 2 : 4);
    if (app->hal->watchdog_kick != NULL) {
        app->hal->watchdog_kick(app->hal->context);
    }
}
