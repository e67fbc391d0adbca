#include "application/reports.h"

#include "application/store.h"
#include "application/version.h"

static void send(struct application *app, enum frame_type type, struct byte_writer end)
{
    sender_send(&app->sender, app->hal, type, application_sample_counter(app), end);
}

static void put_board(struct byte_writer *writer, const struct hal_properties *board)
{
    put_u64(writer, board->unique_id);
    put_u32(writer, board->sample_rate_millihz);
    put_u8(writer, (uint8_t)board->adc_bits);
    put_u8(writer, (uint8_t)board->dac_bits);
}

static void put_calibration(struct byte_writer *writer, const struct application *app)
{
    const struct calibration *calibration = &app->calibration;
    put_u16(writer, (uint16_t)calibration->gyro.lockin.decimation);
    put_u16(writer, (uint16_t)calibration->gyro.loops_per_slow);
    put_i32(writer, calibration->reference_temperature_mdegc);
    put_u32(writer, calibration->serial);
    put_u32(writer, calibration->sequence);
    put_u32(writer, calibration->crc);
    put_u8(writer, (uint8_t)app->calibration_source);
    put_u8(writer, calibration->gyro.calibration_valid ? 1 : 0);
    put_bytes(writer, calibration->device_name, CALIBRATION_NAME_BYTES);
}

static void report_self_test(struct application *app, const struct hal_self_test *test)
{
    struct byte_writer writer = sender_payload(&app->sender);
    put_u32(&writer, test->checked);
    put_u32(&writer, test->failed);
    put_u32(&writer, test->core_clock_hz);
    put_u32(&writer, test->fault_address);
    put_u32(&writer, test->samples_lost);
    send(app, FRAME_SELF_TEST, writer);
}

void report_identity(struct application *app)
{
    struct byte_writer writer = sender_payload(&app->sender);
    put_u16(&writer, FIRMWARE_VERSION_MAJOR);
    put_u16(&writer, FIRMWARE_VERSION_MINOR);
    put_u16(&writer, FIRMWARE_VERSION_PATCH);
    put_u16(&writer, SNAPSHOT_VERSION);
    put_u32(&writer, WINEGLASS_BUILD_ID);
    put_u16(&writer, CALIBRATION_VERSION);
    put_board(&writer, app->hal->properties);
    put_calibration(&writer, app);
    send(app, FRAME_IDENTITY, writer);
    if (app->hal->self_test != NULL) {
        report_self_test(app, app->hal->self_test);
    }
}

static void put_settings(struct byte_writer *writer, struct application *app)
{
    put_u8(writer, (uint8_t)app->calibration.gyro.loop);
    put_u8(writer, (uint8_t)app->calibration.gyro.compensation);
    put_u8(writer, (uint8_t)app->calibration.gyro.output_filter);
    put_u16(writer, telemetry_baseband_divisor(&app->telemetry));
    put_u16(writer, telemetry_output_divisor(&app->telemetry));
    put_u8(writer, app->calibration_unlocked ? 1 : 0);
    put_u8(writer, burst_idle(&app->burst) ? 0 : 1);
    put_u8(writer, 0);
}

static void put_counters(struct byte_writer *writer, struct application *app)
{
    put_u32(writer, app->sender.frames_lost);
    put_u32(writer, atomic_load_explicit(&app->telemetry.records_lost, memory_order_relaxed));
    put_u32(writer, app->burst.bursts_cut);
    put_u32(writer, app->counters.commands_accepted);
    put_u32(writer, app->counters.commands_refused);
    put_u32(writer, app->receiver.errors);
    put_u32(writer, app->counters.store_errors);
}

/* The latched bits start anew with every status frame. */
static void put_status_bits(struct byte_writer *writer, struct application *app, struct live live)
{
    put_u32(writer, live.status);
    put_u32(writer, atomic_exchange_explicit(&app->telemetry.status_or, 0, memory_order_relaxed));
    put_u32(writer, ~atomic_exchange_explicit(&app->telemetry.status_nand, 0, memory_order_relaxed));
    put_u32(writer, live.acquisition_attempt);
}

void report_status(struct application *app)
{
    struct byte_writer writer = sender_payload(&app->sender);
    put_u64(&writer, app->hal->time_us(app->hal->context));
    put_status_bits(&writer, app, live_read(&app->live));
    put_settings(&writer, app);
    put_counters(&writer, app);
    send(app, FRAME_STATUS, writer);
}

static void put_phase(struct byte_writer *writer, struct phase_found found, int32_t total_rad_q31)
{
    put_i32(writer, found.correction_rad_q31);
    put_i32(writer, found.uncertainty_rad_q31);
    put_i32(writer, total_rad_q31);
}

void report_phases(struct application *app)
{
    const struct phase_result *result = &app->phase_calibration.result;
    struct byte_writer writer = sender_payload(&app->sender);
    put_u16(&writer, (uint16_t)result->outcome);
    put_u16(&writer, (uint16_t)result->parts);
    put_i32(&writer, result->temperature_shift_q20);
    put_phase(&writer, result->drive, result->drive_rad_q31);
    put_phase(&writer, result->demodulation, result->demodulation_rad_q31);
    send(app, FRAME_PHASES, writer);
}

void report_ack(struct application *app, const struct frame_header *command, enum reason reason)
{
    struct byte_writer writer = sender_payload(&app->sender);
    put_u8(&writer, command->type);
    put_u8(&writer, (uint8_t)reason);
    put_u16(&writer, command->sequence);
    send(app, FRAME_ACK, writer);
}

enum reason report_calibration(struct application *app)
{
    struct store_record found[HAL_STORE_SECTORS];
    struct byte_writer writer = sender_payload(&app->sender);
    if (store_find(app->hal, CALIBRATION_BYTES, found) == 0) {
        return REASON_NOTHING_STORED;
    }
    if (store_read(app->hal, &found[0], writer.next) != HAL_OK) {
        return REASON_STORE_FAILED;
    }
    writer.next += found[0].size;
    send(app, FRAME_CALIBRATION, writer);
    return REASON_OK;
}
