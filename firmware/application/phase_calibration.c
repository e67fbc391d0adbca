#include "application/phase_calibration.h"

#include "application/rebalance_check.h"
#include "core/fixed.h"
#include "core/oscillator.h"
#include "core/polar.h"

#define LEAST_RESPONSE_Q30 (INT32_C(1) << 18) /* 1/4000 of full scale: below, the secondary has not answered the test force */

static const int32_t signs[PHASE_CALIBRATION_STEPS] = {1, -1, -1, 1};

/* ---- interrupt --------------------------------------------------------------------------------------------------------- */

static void close_record(struct phase_calibration *calibration)
{
    uint32_t index;
    if (ring_slot(&calibration->ring, PHASE_CALIBRATION_RECORDS, &index)) {
        calibration->records[index] = calibration->sum;
        ring_put(&calibration->ring);
    }
    calibration->sum = (struct phase_record){.ticks = 0};
}

void phase_calibration_add(struct phase_calibration *calibration, const struct gyro_signals *signals)
{
    struct phase_record *sum = &calibration->sum;
    if (atomic_load_explicit(&calibration->collecting, memory_order_acquire) == 0) {
        sum->ticks = 0;
        return;
    }
    if (sum->ticks == 0) {
        *sum = (struct phase_record){.status_and = UINT32_MAX};
    }
    sum->drive_level += signals->drive_level_q31;
    sum->secondary_i += signals->secondary.i_q30;
    sum->secondary_q += signals->secondary.q_q30;
    sum->temperature_shift += signals->temperature_shift_q20;
    sum->status_or |= signals->status;
    sum->status_and &= signals->status;
    sum->ticks++;
    if (sum->ticks >= PHASE_CALIBRATION_TICKS) {
        close_record(calibration);
    }
}

/* ---- what the sums say ------------------------------------------------------------------------------------------------- */

static int32_t saturated_sum(int32_t a, int32_t b)
{
    bool clamped = false;
    return fixed_saturate_i32((int64_t)a + b, &clamped);
}

/* 2^32 = one turn -> rad in Q31: times pi (Q29). Beyond +-1 rad it saturates. */
static int32_t rad_q31(int32_t angle_i32)
{
    bool clamped = false;
    return fixed_saturate_i32(((int64_t)angle_i32 * INT64_C(1686629713)) >> 29, &clamped);
}

static int64_t mean(int64_t sum, uint32_t ticks)
{
    return sum / (int64_t)ticks;
}

/* Angle of i + j q. Range: both below 2^31, halved to what polar_from_complex takes. */
static int32_t angle_rad_q31(int64_t i, int64_t q)
{
    struct complex_q30 value = {(int32_t)(i / 2), (int32_t)(q / 2)};
    return rad_q31(polar_from_complex(value).angle_i32);
}

/* tan(lag) = difference / sum / tan(e). Range: levels below 2^31 in Q31, so half sums and half differences are too. */
static int32_t drive_lag_rad_q31(const struct phase_calibration *calibration, uint32_t plus, uint32_t minus)
{
    const struct phase_record *sum = calibration->step_sum;
    struct phasor_q30 step = oscillator_phasor((uint32_t)calibration->order.phase_i32);
    int64_t level_plus = mean(sum[plus].drive_level, sum[plus].ticks);
    int64_t level_minus = mean(sum[minus].drive_level, sum[minus].ticks);
    int64_t half_sum = (level_plus + level_minus) / 2;
    int64_t half_difference = (level_plus - level_minus) / 2;
    return angle_rad_q31((half_sum * step.sine_q30) >> 30, (half_difference * step.cosine_q30) >> 30);
}

/* A quadrature force +q moves the secondary by -j |.| exp(-j lag): both parts of minus the response give the lag. */
static int32_t demodulation_lag_rad_q31(const struct phase_calibration *calibration, uint32_t plus, uint32_t minus)
{
    const struct phase_record *sum = calibration->step_sum;
    int64_t in_phase = mean(sum[plus].secondary_i, sum[plus].ticks) - mean(sum[minus].secondary_i, sum[minus].ticks);
    int64_t quadrature = mean(sum[plus].secondary_q, sum[plus].ticks) - mean(sum[minus].secondary_q, sum[minus].ticks);
    return angle_rad_q31(-quadrature / 2, -in_phase / 2);
}

/* Off resonance by tan(phase)/tau the same force moves the shell a little less or more, as it goes with 1/w: the lag looks smaller by 1/(tau w).
 * Range: decay rate x period 2^31 2^31 >> 30 = 2^32 in Q38; 2^57 over turns, at most 2^57; times 1/(2 pi). */
static int32_t detuning_rad_q31(const struct gyro_cfg *gyro)
{
    bool clamped = false;
    int64_t turns_q32 = (int64_t)(gyro->tuning.center_freq_u64 >> 32);
    int64_t decay_q38 = ((int64_t)gyro->decay_per_s_q22.coef[0] * gyro->tuning.sample_period_q46) >> 30;
    if (turns_q32 == 0) {
        return 0;
    }
    return fixed_saturate_i32(fixed_mul_i64_q31((decay_q38 * (INT64_C(1) << 25)) / turns_q32, INT32_C(341782638)), &clamped);
}

static struct phase_found found_from(int32_t first_rad_q31, int32_t second_rad_q31)
{
    int64_t difference = (int64_t)first_rad_q31 - second_rad_q31;
    struct phase_found found = {
        (int32_t)(((int64_t)first_rad_q31 + second_rad_q31) / 2),
        (int32_t)((difference < 0 ? -difference : difference) / 2),
    };
    return found;
}

static bool has_answered(const struct phase_calibration *calibration)
{
    const struct phase_record *sum = calibration->step_sum;
    int64_t response = mean(sum[1].secondary_q, sum[1].ticks) - mean(sum[0].secondary_q, sum[0].ticks);
    return response > LEAST_RESPONSE_Q30;
}

/* ---- sequence ---------------------------------------------------------------------------------------------------------- */

static struct phase_settings settings_of(const struct gyro_cfg *gyro)
{
    struct phase_settings settings = {
        gyro->loop, gyro->drive.phase_set_point_i32, gyro->test_signal,
        gyro->drive_phase_rad_q31.coef[0], gyro->demodulation_phase_rad_q31.coef[0],
    };
    return settings;
}

static void put_back(const struct phase_settings *settings, struct gyro_cfg *gyro)
{
    gyro->loop = settings->loop;
    gyro->drive.phase_set_point_i32 = settings->phase_set_point_i32;
    gyro->test_signal = settings->test_signal;
    gyro->drive_phase_rad_q31.coef[0] = settings->drive_rad_q31;
    gyro->demodulation_phase_rad_q31.coef[0] = settings->demodulation_rad_q31;
}

static void begin_step(struct phase_calibration *calibration, struct gyro_cfg *gyro)
{
    const struct phase_calibration_order *order = &calibration->order;
    bool drive = calibration->part == PHASE_CALIBRATION_DRIVE;
    int32_t sign = signs[calibration->step];
    calibration->step_sum[calibration->step] = (struct phase_record){.ticks = 0};
    calibration->phase = PHASE_CALIBRATION_SETTLE;
    calibration->means_left = drive ? order->settle_drive : order->settle_demodulation;
    gyro->drive.phase_set_point_i32 = drive ? sign * order->phase_i32 : 0;
    gyro->test_signal = (struct test_signal_cfg){0, drive ? 0 : sign * order->quadrature_q31, 0};
}

static void begin_part(struct phase_calibration *calibration, enum phase_calibration_part part, struct gyro_cfg *gyro)
{
    calibration->part = part;
    calibration->step = 0;
    bool closes = part == PHASE_CALIBRATION_DRIVE && rebalance_is_described(gyro) && rebalance_is_stable(gyro);
    gyro->loop = closes ? GYRO_LOOP_REBALANCE : GYRO_LOOP_OPEN;
    begin_step(calibration, gyro);
}

static void finish(struct phase_calibration *calibration, uint32_t outcome, struct gyro_cfg *gyro)
{
    struct phase_result *result = &calibration->result;
    bool clamped = false;
    int32_t shift_q20 = calibration->temperature_ticks == 0
                            ? 0
                            : (int32_t)mean(calibration->temperature_sum, calibration->temperature_ticks);
    put_back(&calibration->saved, gyro);
    gyro->drive_phase_rad_q31.coef[0] = saturated_sum(calibration->saved.drive_rad_q31, result->drive.correction_rad_q31);
    gyro->demodulation_phase_rad_q31.coef[0] =
        saturated_sum(calibration->saved.demodulation_rad_q31, result->demodulation.correction_rad_q31);
    int32_t argument_q31 = thermal_polynomial_argument(shift_q20, &clamped);
    result->outcome = outcome;
    result->temperature_shift_q20 = shift_q20;
    result->drive_rad_q31 = thermal_polynomial_eval(&gyro->drive_phase_rad_q31, argument_q31, &clamped);
    result->demodulation_rad_q31 = thermal_polynomial_eval(&gyro->demodulation_phase_rad_q31, argument_q31, &clamped);
    calibration->result_valid = outcome == PHASE_CALIBRATION_DONE;
    if (!calibration->result_valid || (calibration->order.parts & PHASE_CALIBRATION_APPLY) == 0) {
        put_back(&calibration->saved, gyro);
    }
    calibration->phase = PHASE_CALIBRATION_IDLE;
    atomic_store_explicit(&calibration->collecting, 0, memory_order_release);
}

/* What the test force has left behind dies away while a force of one unit, far below any converter, keeps the rate marked invalid. */
static void recover(struct phase_calibration *calibration, struct gyro_cfg *gyro)
{
    calibration->phase = PHASE_CALIBRATION_RECOVER;
    calibration->means_left = calibration->saved.loop == GYRO_LOOP_OPEN ? calibration->order.settle_demodulation
                                                                        : calibration->order.settle_drive;
    gyro->loop = calibration->saved.loop;
    gyro->drive.phase_set_point_i32 = calibration->saved.phase_set_point_i32;
    gyro->test_signal = (struct test_signal_cfg){0, 1, 0};
}

static void end_drive(struct phase_calibration *calibration, struct gyro_cfg *gyro)
{
    struct phase_found found = found_from(drive_lag_rad_q31(calibration, 0, 1), drive_lag_rad_q31(calibration, 3, 2));
    found.correction_rad_q31 = saturated_sum(found.correction_rad_q31, detuning_rad_q31(gyro));
    calibration->result.drive = found;
    gyro->drive_phase_rad_q31.coef[0] = saturated_sum(calibration->saved.drive_rad_q31, found.correction_rad_q31);
    if ((calibration->order.parts & PHASE_CALIBRATION_DEMODULATION) != 0) {
        begin_part(calibration, PHASE_CALIBRATION_DEMODULATION, gyro);
    } else {
        recover(calibration, gyro);
    }
}

static void end_demodulation(struct phase_calibration *calibration, struct gyro_cfg *gyro)
{
    struct phase_found found = found_from(demodulation_lag_rad_q31(calibration, 0, 1), demodulation_lag_rad_q31(calibration, 3, 2));
    if (!has_answered(calibration)) {
        finish(calibration, PHASE_CALIBRATION_DISTURBED, gyro);
        return;
    }
    calibration->result.demodulation = found;
    gyro->demodulation_phase_rad_q31.coef[0] = saturated_sum(calibration->saved.demodulation_rad_q31, found.correction_rad_q31);
    recover(calibration, gyro);
}

static void end_step(struct phase_calibration *calibration, struct gyro_cfg *gyro)
{
    calibration->step++;
    if (calibration->step < PHASE_CALIBRATION_STEPS) {
        begin_step(calibration, gyro);
    } else if (calibration->part == PHASE_CALIBRATION_DRIVE) {
        end_drive(calibration, gyro);
    } else {
        end_demodulation(calibration, gyro);
    }
}

static bool undisturbed(const struct phase_record *record)
{
    const uint32_t bad = GYRO_STATUS_ADC_SATURATED | GYRO_STATUS_DRIVE_SATURATED | GYRO_STATUS_REBALANCE_SATURATED | GYRO_STATUS_OVERFLOW;
    return (record->status_and & GYRO_STATUS_LOCKED) != 0 && (record->status_or & bad) == 0;
}

static void measure(struct phase_calibration *calibration, const struct phase_record *record)
{
    struct phase_record *sum = &calibration->step_sum[calibration->step];
    sum->drive_level += record->drive_level;
    sum->secondary_i += record->secondary_i;
    sum->secondary_q += record->secondary_q;
    sum->ticks += record->ticks;
    calibration->temperature_sum += record->temperature_shift;
    calibration->temperature_ticks += record->ticks;
}

/* True when *gyro has changed. */
static bool take(struct phase_calibration *calibration, const struct phase_record *record, struct gyro_cfg *gyro)
{
    if (calibration->phase == PHASE_CALIBRATION_MEASURE) {
        if (!undisturbed(record)) {
            finish(calibration, PHASE_CALIBRATION_DISTURBED, gyro);
            return true;
        }
        measure(calibration, record);
    }
    calibration->means_left--;
    if (calibration->means_left > 0) {
        return false;
    }
    if (calibration->phase == PHASE_CALIBRATION_SETTLE) {
        calibration->phase = PHASE_CALIBRATION_MEASURE;
        calibration->means_left = calibration->order.measure;
        return false;
    }
    if (calibration->phase == PHASE_CALIBRATION_MEASURE) {
        end_step(calibration, gyro);
    } else {
        finish(calibration, PHASE_CALIBRATION_DONE, gyro);
    }
    return true;
}

/* ---- background -------------------------------------------------------------------------------------------------------- */

void phase_calibration_start(struct phase_calibration *calibration, const struct phase_calibration_order *order, struct gyro_cfg *gyro)
{
    calibration->order = *order;
    calibration->saved = settings_of(gyro);
    calibration->result = (struct phase_result){.parts = order->parts};
    calibration->result_valid = false;
    calibration->temperature_sum = 0;
    calibration->temperature_ticks = 0;
    ring_drop(&calibration->ring, ring_waiting(&calibration->ring));
    atomic_store_explicit(&calibration->collecting, 1, memory_order_release);
    bool drive = (order->parts & PHASE_CALIBRATION_DRIVE) != 0;
    begin_part(calibration, drive ? PHASE_CALIBRATION_DRIVE : PHASE_CALIBRATION_DEMODULATION, gyro);
}

bool phase_calibration_poll(struct phase_calibration *calibration, struct gyro_cfg *gyro)
{
    bool changed = false;
    while (ring_waiting(&calibration->ring) > 0) {
        uint32_t index = ring_index(&calibration->ring, PHASE_CALIBRATION_RECORDS, 0);
        if (!phase_calibration_idle(calibration)) {
            changed = take(calibration, &calibration->records[index], gyro) || changed;
        }
        ring_drop(&calibration->ring, 1);
    }
    return changed;
}

void phase_calibration_abort(struct phase_calibration *calibration, struct gyro_cfg *gyro)
{
    finish(calibration, PHASE_CALIBRATION_ABORTED, gyro);
}
