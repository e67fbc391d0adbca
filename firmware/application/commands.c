#include "application/commands.h"

#include <stddef.h>

#include "application/crc32.h"
#include "application/layout.h"
#include "application/limits.h"
#include "application/rebalance_check.h"
#include "application/reports.h"
#include "application/store.h"

#define ANY_LENGTH 0xFFFF

typedef enum reason (*command_handler)(struct application *app, struct byte_reader *payload);

uint32_t command_unlock_key(uint64_t unique_id)
{
    uint8_t bytes[8];
    struct byte_writer writer = {bytes};
    put_u64(&writer, unique_id);
    return crc32_update(0, bytes, sizeof bytes);
}

static bool within(int64_t value, int64_t low, int64_t high)
{
    return value >= low && value <= high;
}

/* ---- queries ----------------------------------------------------------------------------------------------------------- */

static enum reason ping(struct application *app, struct byte_reader *payload)
{
    (void)payload;
    report_identity(app);
    return REASON_OK;
}

static enum reason status(struct application *app, struct byte_reader *payload)
{
    (void)payload;
    report_status(app);
    return REASON_OK;
}

/* ---- signal processing ------------------------------------------------------------------------------------------------- */

/* A raw burst replays one configuration; the phase calibration changes it by itself. */
static bool is_busy(struct application *app)
{
    return !burst_idle(&app->burst) || !phase_calibration_idle(&app->phase_calibration);
}

/* What every command that changes the signal processing begins with. */
static enum reason configuration_is_free(struct application *app, bool in_range)
{
    if (!in_range) {
        return REASON_OUT_OF_RANGE;
    }
    if (is_busy(app)) {
        return REASON_BUSY;
    }
    app->cfg_changed = true;
    return REASON_OK;
}

/* Commands that only set words of the configuration: the payload is these words, in this order. A word whose range is not negative is unsigned. */
struct word {
    uint8_t command;
    uint16_t offset; /* in struct gyro_cfg */
    int64_t min, max;
};

#define AT(member) offsetof(struct gyro_cfg, member)

static const struct word words[] = {
    {COMMAND_COMPENSATION, AT(compensation), 0, GYRO_COMPENSATION_COUNT - 1},
    {COMMAND_PLL_GAINS, AT(drive.pll_proportional_q32), 1, PLL_PROPORTIONAL_MAX_Q32},
    {COMMAND_PLL_GAINS, AT(drive.pll_integral_q32), 0, PLL_INTEGRAL_MAX_Q32},
    {COMMAND_AGC_GAINS, AT(drive.agc_proportional_q16), 1, AGC_PROPORTIONAL_MAX_Q16},
    {COMMAND_AGC_GAINS, AT(drive.agc_integral_q24), 0, AGC_INTEGRAL_MAX_Q24},
    {COMMAND_OUTPUT_FILTER, AT(output_filter), 0, OUTPUT_FILTER_COUNT - 1},
    {COMMAND_TEST_SIGNAL, AT(test_signal.in_phase_q31), -DRIVE_MAX_Q31, DRIVE_MAX_Q31},
    {COMMAND_TEST_SIGNAL, AT(test_signal.quadrature_q31), -DRIVE_MAX_Q31, DRIVE_MAX_Q31},
    {COMMAND_TEST_SIGNAL, AT(test_signal.freq_u32), 0, INT64_C(1) << 31},
    {COMMAND_PHASE_SET_POINT, AT(drive.phase_set_point_i32), -PHASE_SET_POINT_MAX_I32, PHASE_SET_POINT_MAX_I32},
};

#define WORDS (sizeof words / sizeof words[0])

static size_t words_of(uint8_t command)
{
    size_t count = 0;
    for (size_t i = 0; i < WORDS; i++) {
        count += words[i].command == command;
    }
    return count;
}

static bool words_in_range(uint8_t command, struct byte_reader payload)
{
    bool in_range = true;
    for (size_t i = 0; i < WORDS; i++) {
        if (words[i].command == command) {
            uint32_t bits = get_u32(&payload);
            in_range = in_range && within(words[i].min < 0 ? (int64_t)(int32_t)bits : (int64_t)bits, words[i].min, words[i].max);
        }
    }
    return in_range;
}

static enum reason set_words(struct application *app, uint8_t command, struct byte_reader *payload)
{
    enum reason reason = configuration_is_free(app, words_in_range(command, *payload));
    for (size_t i = 0; i < WORDS && reason == REASON_OK; i++) {
        if (words[i].command == command) {
            layout_store((uint8_t *)&app->calibration.gyro + words[i].offset, sizeof(uint32_t), get_u32(payload));
        }
    }
    return reason;
}

/* The limit of the amplitude error stays the same part of the set-point. Range: 2^30 2^30 fits; the result is at most 49 times the
 * calibrated limit (amplitude limits), bounded to 2^29. */
static int32_t scaled_amplitude_limit_q30(const struct application *app, int32_t amplitude_q30)
{
    int64_t limit = (int64_t)app->calibrated_amplitude_limit_q30 * amplitude_q30 / app->calibrated_amplitude_q30;
    limit = limit < 1 ? 1 : limit;
    return limit > INT32_C(1) << 29 ? INT32_C(1) << 29 : (int32_t)limit;
}

static enum reason set_amplitude(struct application *app, struct byte_reader *payload)
{
    int32_t amplitude_q30 = get_i32(payload);
    enum reason reason = configuration_is_free(app, within(amplitude_q30, AMPLITUDE_MIN_Q30, AMPLITUDE_MAX_Q30));
    if (reason == REASON_OK) {
        app->calibration.gyro.drive.amplitude_q30 = amplitude_q30;
        app->calibration.gyro.monitor.amplitude_limit_q30 = scaled_amplitude_limit_q30(app, amplitude_q30);
    }
    return reason;
}

static enum reason set_loop(struct application *app, struct byte_reader *payload)
{
    uint32_t loop = get_u32(payload);
    const struct gyro_cfg *gyro = &app->calibration.gyro;
    bool possible = loop == GYRO_LOOP_OPEN || (loop == GYRO_LOOP_REBALANCE && rebalance_is_described(gyro));
    if (possible && loop == GYRO_LOOP_REBALANCE && !rebalance_is_stable(gyro)) {
        return REASON_UNSTABLE;
    }
    enum reason reason = configuration_is_free(app, possible);
    if (reason == REASON_OK) {
        app->calibration.gyro.loop = loop;
    }
    return reason;
}

/* The stability is known only with a scale factor; without one the loop cannot be closed either. */
static bool stays_stable(const struct application *app, const struct rebalance_cfg *wanted)
{
    struct gyro_cfg gyro = app->calibration.gyro;
    gyro.rebalance = *wanted;
    return !rebalance_is_described(&gyro) || rebalance_is_stable(&gyro);
}

static enum reason set_rebalance(struct application *app, struct byte_reader *payload)
{
    struct rebalance_cfg wanted;
    wanted.proportional_q16 = get_i32(payload);
    wanted.integral_q24 = get_i32(payload);
    wanted.in_phase_limit_q31 = get_i32(payload);
    wanted.quadrature_limit_q31 = get_i32(payload);
    bool in_range = within(wanted.proportional_q16, 1, REBALANCE_PROPORTIONAL_MAX_Q16) &&
                    within(wanted.integral_q24, 0, REBALANCE_INTEGRAL_MAX_Q24) &&
                    within(wanted.in_phase_limit_q31, 1, DRIVE_MAX_Q31) &&
                    within(wanted.quadrature_limit_q31, 0, DRIVE_MAX_Q31) && rebalance_limits_fit(&wanted);
    if (in_range && !stays_stable(app, &wanted)) {
        return REASON_UNSTABLE;
    }
    enum reason reason = configuration_is_free(app, in_range);
    if (reason == REASON_OK) {
        app->calibration.gyro.rebalance = wanted;
    }
    return reason;
}

static enum reason set_drive(struct application *app, struct byte_reader *payload)
{
    uint32_t on = get_u32(payload);
    enum reason reason = configuration_is_free(app, on <= 1);
    if (reason == REASON_OK) {
        app->calibration.gyro.drive.off = on == 0;
    }
    return reason;
}

static bool order_in_range(const struct phase_calibration_order *order, const struct gyro_cfg *gyro)
{
    const uint32_t measured = PHASE_CALIBRATION_DRIVE | PHASE_CALIBRATION_DEMODULATION;
    bool times = within(order->settle_drive, PHASE_SETTLE_MIN, PHASE_SETTLE_MAX) &&
                 within(order->settle_demodulation, PHASE_SETTLE_MIN, PHASE_SETTLE_MAX) && within(order->measure, 1, PHASE_MEASURE_MAX);
    bool force = (order->parts & PHASE_CALIBRATION_DEMODULATION) == 0 ||
                 within(order->quadrature_q31, 1, gyro->rebalance.quadrature_limit_q31);
    return (order->parts & measured) != 0 && order->parts <= (measured | PHASE_CALIBRATION_APPLY) && times && force &&
           within(order->phase_i32, PHASE_STEP_MIN_I32, PHASE_STEP_MAX_I32);
}

static enum reason abort_phases(struct application *app)
{
    if (!phase_calibration_idle(&app->phase_calibration)) {
        phase_calibration_abort(&app->phase_calibration, &app->calibration.gyro);
        app->cfg_changed = true;
        report_phases(app);
    }
    return REASON_OK;
}

static enum reason calibrate_phases(struct application *app, struct byte_reader *payload)
{
    struct phase_calibration_order order;
    order.parts = get_u32(payload);
    order.settle_drive = get_u16(payload);
    order.settle_demodulation = get_u16(payload);
    order.measure = get_u16(payload);
    (void)get_u16(payload);
    order.phase_i32 = get_i32(payload);
    order.quadrature_q31 = get_i32(payload);
    if (order.parts == 0) {
        return abort_phases(app);
    }
    if ((live_read(&app->live).status & GYRO_STATUS_LOCKED) == 0) {
        return REASON_NOT_LOCKED;
    }
    enum reason reason = configuration_is_free(app, order_in_range(&order, &app->calibration.gyro));
    if (reason == REASON_OK) {
        phase_calibration_start(&app->phase_calibration, &order, &app->calibration.gyro);
    }
    return reason;
}

static enum reason restart(struct application *app, struct byte_reader *payload)
{
    (void)payload;
    enum reason reason = configuration_is_free(app, true);
    if (reason == REASON_OK) {
        app->restart_wanted = REQUEST_RESTART;
    }
    return reason;
}

/* ---- telemetry --------------------------------------------------------------------------------------------------------- */

static enum reason set_divisors(struct application *app, struct byte_reader *payload)
{
    uint16_t baseband = get_u16(payload);
    uint16_t output = get_u16(payload);
    telemetry_set_divisors(&app->telemetry, baseband, output);
    return REASON_OK;
}

static enum reason raw_burst(struct application *app, struct byte_reader *payload)
{
    uint32_t samples = get_u32(payload);
    if (!within(samples, 1, BURST_MAX_SAMPLES)) {
        return REASON_OUT_OF_RANGE;
    }
    return phase_calibration_idle(&app->phase_calibration) && burst_ask(&app->burst, samples) ? REASON_OK : REASON_BUSY;
}

/* ---- calibration ------------------------------------------------------------------------------------------------------- */

static enum reason calibration_unlock(struct application *app, struct byte_reader *payload)
{
    app->calibration_unlocked = get_u32(payload) == command_unlock_key(app->hal->properties->unique_id);
    return app->calibration_unlocked ? REASON_OK : REASON_WRONG_KEY;
}

static enum reason calibration_write(struct application *app, struct byte_reader *payload)
{
    if (!app->calibration_unlocked) {
        return REASON_LOCKED;
    }
    if (payload->left < 3) {
        return REASON_LENGTH;
    }
    size_t offset = get_u16(payload);
    if (offset + payload->left > CALIBRATION_BYTES) {
        return REASON_OUT_OF_RANGE;
    }
    struct byte_writer writer = {&app->staged_block[offset]};
    put_bytes(&writer, payload->next, payload->left);
    return REASON_OK;
}

static void activate(struct application *app, const struct calibration *calibration)
{
    app->calibration = *calibration;
    app->calibration_source = CALIBRATION_STORED;
    app->calibration_unlocked = false;
    app->cfg_changed = true;
    app->restart_wanted = REQUEST_RESTART;
    application_note_calibrated(app);
}

static enum reason calibration_commit(struct application *app, struct byte_reader *payload)
{
    struct calibration calibration;
    uint32_t size = get_u32(payload);
    if (!app->calibration_unlocked) {
        return REASON_LOCKED;
    }
    if (is_busy(app)) {
        return REASON_BUSY;
    }
    if (size != CALIBRATION_BYTES) {
        return REASON_CALIBRATION_SIZE;
    }
    enum reason reason = calibration_parse(app->staged_block, size, app->hal->properties, &calibration);
    if (reason != REASON_OK) {
        return reason;
    }
    if (store_write(app->hal, app->staged_block, size) != HAL_OK) {
        app->counters.store_errors++;
        return REASON_STORE_FAILED;
    }
    activate(app, &calibration);
    report_identity(app);
    return REASON_OK;
}

static enum reason calibration_read(struct application *app, struct byte_reader *payload)
{
    (void)payload;
    return report_calibration(app);
}

/* The newest stored block with the found phases in it; what commands have changed beside is not stored. */
static enum reason corrected_block(struct application *app, struct calibration *calibration)
{
    const struct phase_result *result = &app->phase_calibration.result;
    struct store_record found[HAL_STORE_SECTORS];
    if (store_find(app->hal, CALIBRATION_BYTES, found) == 0) {
        return REASON_NOTHING_STORED;
    }
    if (found[0].size != CALIBRATION_BYTES || store_read(app->hal, &found[0], app->staged_block) != HAL_OK) {
        return REASON_STORE_FAILED;
    }
    calibration_add_phases(app->staged_block, result->drive.correction_rad_q31, result->demodulation.correction_rad_q31);
    return calibration_parse(app->staged_block, CALIBRATION_BYTES, app->hal->properties, calibration);
}

/* The corrections count from now on and are spent, so that no second command adds them again. */
static void adopt_phases(struct application *app, const struct calibration *stored)
{
    struct calibration *calibration = &app->calibration;
    calibration->gyro.drive_phase_rad_q31 = stored->gyro.drive_phase_rad_q31;
    calibration->gyro.demodulation_phase_rad_q31 = stored->gyro.demodulation_phase_rad_q31;
    calibration->sequence = stored->sequence;
    calibration->crc = stored->crc;
    app->calibration_unlocked = false;
    app->phase_calibration.result_valid = false;
    app->cfg_changed = true;
}

static enum reason store_phases(struct application *app, struct byte_reader *payload)
{
    struct calibration stored;
    (void)payload;
    if (!app->calibration_unlocked) {
        return REASON_LOCKED;
    }
    if (is_busy(app)) {
        return REASON_BUSY;
    }
    if (!app->phase_calibration.result_valid) {
        return REASON_NO_RESULT;
    }
    enum reason reason = corrected_block(app, &stored);
    if (reason != REASON_OK) {
        return reason;
    }
    if (store_write(app->hal, app->staged_block, CALIBRATION_BYTES) != HAL_OK) {
        app->counters.store_errors++;
        return REASON_STORE_FAILED;
    }
    adopt_phases(app, &stored);
    report_identity(app);
    return REASON_OK;
}

/* ---- dispatch ---------------------------------------------------------------------------------------------------------- */

struct command {
    uint8_t type;
    uint16_t payload_bytes;
    command_handler handler;
};

static const struct command commands[] = {
    {COMMAND_PING, 0, ping},
    {COMMAND_STATUS, 0, status},
    {COMMAND_AMPLITUDE, 4, set_amplitude},
    {COMMAND_DIVISORS, 4, set_divisors},
    {COMMAND_RAW_BURST, 4, raw_burst},
    {COMMAND_RESTART, 0, restart},
    {COMMAND_LOOP, 4, set_loop},
    {COMMAND_REBALANCE, 16, set_rebalance},
    {COMMAND_PHASE_CALIBRATION, 20, calibrate_phases},
    {COMMAND_CALIBRATION_UNLOCK, 4, calibration_unlock},
    {COMMAND_CALIBRATION_WRITE, ANY_LENGTH, calibration_write},
    {COMMAND_CALIBRATION_COMMIT, 4, calibration_commit},
    {COMMAND_CALIBRATION_READ, 0, calibration_read},
    {COMMAND_PHASES_STORE, 0, store_phases},
    {COMMAND_DRIVE, 4, set_drive},
};

static enum reason run(struct application *app, const struct frame_view *frame)
{
    struct byte_reader payload = {frame->payload, frame->payload_bytes, false};
    size_t word_count = words_of(frame->header.type);
    if (frame->header.version != FRAME_VERSION) {
        return REASON_FRAME_VERSION;
    }
    if (word_count > 0) {
        return payload.left == word_count * sizeof(uint32_t) ? set_words(app, frame->header.type, &payload) : REASON_LENGTH;
    }
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
        if (commands[i].type == frame->header.type) {
            bool length_right = commands[i].payload_bytes == ANY_LENGTH || commands[i].payload_bytes == payload.left;
            return length_right ? commands[i].handler(app, &payload) : REASON_LENGTH;
        }
    }
    return REASON_UNKNOWN_COMMAND;
}

void command_execute(struct application *app, const struct frame_view *frame)
{
    enum reason reason = run(app, frame);
    if (reason == REASON_OK) {
        app->counters.commands_accepted++;
    } else {
        app->counters.commands_refused++;
    }
    report_ack(app, &frame->header, reason);
}
