#include "application/calibration.h"

#include <stddef.h>

#include "application/bytes.h"
#include "application/crc32.h"
#include "application/layout.h"
#include "application/limits.h"
#include "application/rebalance_check.h"
#include "core/fixed.h"
#include "core/oscillator.h"

/* One field of the block, in the block's order. The value is refused unless min <= value <= max. */
struct calibration_field {
    uint16_t offset; /* in struct calibration */
    uint8_t width;   /* bytes, in the block as in the structure */
    uint8_t is_signed;
    int64_t min, max;
};

#define AT(member)                  offsetof(struct calibration, member)
#define SIGNED(member, min, max)    {AT(member), 4, 1, (min), (max)}
#define UNSIGNED(member, min, max)  {AT(member), 4, 0, (min), (max)}
#define WIDE(member, min, max)      {AT(member), 8, 1, (min), (max)}
#define ANY_I32(member)             SIGNED(member, INT32_MIN, INT32_MAX)
#define POLYNOMIAL(member)                                                                                          \
    UNSIGNED(member.order, 0, THERMAL_POLYNOMIAL_MAX_ORDER), ANY_I32(member.coef[0]), ANY_I32(member.coef[1]),      \
        ANY_I32(member.coef[2]), ANY_I32(member.coef[3]), ANY_I32(member.coef[4]), ANY_I32(member.coef[5])

#define TURN_U64(divisor)  (INT64_C(0x4000000000000000) / (divisor) * 4) /* 1/divisor turn a sample; divisor > 2 */
#define DEGC_Q20(degc)     ((degc) * (INT64_C(1) << 20))
#define FRACTION_Q30(part) ((INT64_C(1) << 30) / (part)) /* 1/part */

static const struct calibration_field fields[] = {
    UNSIGNED(serial, 0, UINT32_MAX),
    UNSIGNED(sequence, 0, UINT32_MAX),
    WIDE(created_unix_s, 0, INT64_MAX),
    UNSIGNED(sample_rate_millihz, 32769000, UINT32_MAX),
    UNSIGNED(gyro.lockin.decimation, 8, LOCKIN_MAX_DECIMATION),
    SIGNED(gyro.lockin.normalise_q31, 1, INT32_MAX),
    UNSIGNED(gyro.loops_per_slow, 1, 64),
    SIGNED(reference_temperature_mdegc, -273150, 1000000),
    ANY_I32(gyro.thermometer.offset_raw),
    SIGNED(gyro.thermometer.gain_degc_q36, 1, INT32_MAX),
    SIGNED(gyro.thermometer.shift_min_q20, DEGC_Q20(-128), DEGC_Q20(128)),
    SIGNED(gyro.thermometer.shift_max_q20, DEGC_Q20(-128), DEGC_Q20(128)),
    POLYNOMIAL(gyro.bias_rad_s_q31),
    POLYNOMIAL(gyro.scale_rad_s_q28),
    POLYNOMIAL(gyro.rebalance_scale_rad_s_q28),
    POLYNOMIAL(gyro.decay_per_s_q22),
    POLYNOMIAL(gyro.demodulation_phase_rad_q31),
    POLYNOMIAL(gyro.drive_phase_rad_q31),
    SIGNED(angular_gain_q24, 1, INT64_C(4) << 24),
    WIDE(gyro.tuning.center_freq_u64, TURN_U64(256), TURN_U64(3)),
    WIDE(gyro.tuning.center_2cos_q40, -(INT64_C(1) << 41), INT64_C(1) << 41),
    ANY_I32(gyro.tuning.center_cos_q31),
    ANY_I32(gyro.tuning.center_sin_q31),
    SIGNED(gyro.tuning.sample_period_q46, 1, INT32_MAX),
    SIGNED(gyro.tuning.coupling_gain_q44, 1, INT32_MAX),
    WIDE(gyro.acquisition.freq_start_u64, TURN_U64(256), TURN_U64(3)),
    WIDE(gyro.acquisition.freq_end_u64, TURN_U64(256), TURN_U64(3)),
    UNSIGNED(gyro.acquisition.chirp_ticks_log2, 2, 16),
    UNSIGNED(gyro.acquisition.settle_ticks, 1, 65535),
    UNSIGNED(gyro.acquisition.listen_ticks_log2, 2, 12),
    SIGNED(gyro.acquisition.audible_q30, FRACTION_Q30(65536), FRACTION_Q30(2)),
    UNSIGNED(gyro.acquisition.attempts, 0, 6),
    UNSIGNED(gyro.drive.pll_proportional_q32, 1, PLL_PROPORTIONAL_MAX_Q32),
    UNSIGNED(gyro.drive.pll_integral_q32, 0, PLL_INTEGRAL_MAX_Q32),
    SIGNED(gyro.drive.agc_proportional_q16, 1, AGC_PROPORTIONAL_MAX_Q16),
    SIGNED(gyro.drive.agc_integral_q24, 0, AGC_INTEGRAL_MAX_Q24),
    SIGNED(gyro.drive.amplitude_q30, AMPLITUDE_MIN_Q30, AMPLITUDE_MAX_Q30),
    SIGNED(gyro.drive.drive_max_q31, 1, DRIVE_MAX_Q31),
    SIGNED(gyro.rebalance.proportional_q16, 0, REBALANCE_PROPORTIONAL_MAX_Q16),
    SIGNED(gyro.rebalance.integral_q24, 0, REBALANCE_INTEGRAL_MAX_Q24),
    SIGNED(gyro.rebalance.in_phase_limit_q31, 0, DRIVE_MAX_Q31),
    SIGNED(gyro.rebalance.quadrature_limit_q31, 0, DRIVE_MAX_Q31),
    UNSIGNED(gyro.loop_delay_samples_q16, 0, LOOP_DELAY_MAX_SAMPLES * 65536 - 1),
    SIGNED(gyro.monitor.phase_limit_i32, 1, INT32_C(1) << 30),
    SIGNED(gyro.monitor.amplitude_limit_q30, 1, FRACTION_Q30(2)),
    UNSIGNED(gyro.monitor.hold_ticks, 1, 1000000),
    SIGNED(gyro.monitor.adc_limit_q31, INT32_C(1) << 30, INT32_MAX),
    UNSIGNED(gyro.loop, 0, GYRO_LOOP_COUNT - 1),
    UNSIGNED(gyro.compensation, 0, GYRO_COMPENSATION_COUNT - 1),
    UNSIGNED(gyro.output_filter, 0, OUTPUT_FILTER_COUNT - 1),
};

#define FIELD_COUNT  (sizeof fields / sizeof fields[0])
#define HEADER_BYTES 8

static enum reason check_envelope(const uint8_t *block, size_t size)
{
    if (size != CALIBRATION_BYTES) {
        return REASON_CALIBRATION_SIZE;
    }
    struct byte_reader reader = {block, size, false};
    if (get_u32(&reader) != CALIBRATION_MAGIC) {
        return REASON_CALIBRATION_MAGIC;
    }
    if (get_u16(&reader) != CALIBRATION_VERSION) {
        return REASON_CALIBRATION_VERSION;
    }
    if (get_u16(&reader) != CALIBRATION_BYTES) {
        return REASON_CALIBRATION_SIZE;
    }
    struct byte_reader crc = {block + size - 4, 4, false};
    return get_u32(&crc) == crc32_update(0, block, size - 4) ? REASON_OK : REASON_CALIBRATION_CRC;
}

/* Range: a 64-bit field with its top bit set reads as negative, which no table row allows for frequencies and times. */
static bool in_range(const struct calibration_field *field, uint64_t bits)
{
    int64_t value = field->width == 4 && field->is_signed ? (int32_t)(uint32_t)bits : (int64_t)bits;
    return value >= field->min && value <= field->max;
}

static bool read_field(const struct calibration_field *field, struct byte_reader *reader, struct calibration *calibration)
{
    uint64_t bits = get_little_endian(reader, field->width);
    layout_store((uint8_t *)calibration + field->offset, field->width, bits);
    return in_range(field, bits);
}

static enum reason read_fields(const uint8_t *block, struct calibration *calibration)
{
    struct byte_reader reader = {block + HEADER_BYTES, CALIBRATION_BYTES - HEADER_BYTES, false};
    bool all_in_range = true;
    for (size_t i = 0; i < CALIBRATION_NAME_BYTES; i++) {
        calibration->device_name[i] = get_u8(&reader);
    }
    for (size_t i = 0; i < FIELD_COUNT; i++) {
        all_in_range = read_field(&fields[i], &reader, calibration) && all_in_range;
    }
    calibration->crc = get_u32(&reader);
    return all_in_range && reader.left == 0 && !reader.short_of_bytes ? REASON_OK : REASON_CALIBRATION_RANGE;
}

static bool near(int64_t a, int64_t b, int64_t tolerance)
{
    return a - b <= tolerance && b - a <= tolerance;
}

/* 2^46 s over the period in 1/1000 Hz: 2^46 1000 / rate, to one unit. */
static bool period_agrees(const struct calibration *calibration)
{
    int64_t period_q46 = (INT64_C(1000) << 46) / calibration->sample_rate_millihz;
    return near(calibration->gyro.tuning.sample_period_q46, period_q46, 2);
}

/* The oscillator is good to 9e-6: 2^-16 in Q30 and Q40 terms. */
static bool center_agrees(const struct decoupler_tuning *tuning)
{
    struct phasor_q30 center = oscillator_phasor((uint32_t)(tuning->center_freq_u64 >> 32));
    return near(tuning->center_cos_q31, 2 * (int64_t)center.cosine_q30, INT64_C(1) << 16) &&
           near(tuning->center_sin_q31, 2 * (int64_t)center.sine_q30, INT64_C(1) << 16) &&
           near(tuning->center_2cos_q40, (int64_t)tuning->center_cos_q31 * 1024, 1024);
}

static bool rebalance_agrees(const struct gyro_cfg *gyro)
{
    return rebalance_limits_fit(&gyro->rebalance) && (gyro->loop != GYRO_LOOP_REBALANCE || rebalance_is_described(gyro));
}

static bool gyro_agrees(const struct gyro_cfg *gyro)
{
    int64_t window = (int64_t)gyro->lockin.decimation * gyro->lockin.decimation;
    return gyro->acquisition.freq_start_u64 < gyro->acquisition.freq_end_u64 &&
           gyro->thermometer.shift_min_q20 < gyro->thermometer.shift_max_q20 &&
           near(gyro->lockin.normalise_q31, (INT64_C(4) << 31) / window, 1) && center_agrees(&gyro->tuning) && rebalance_agrees(gyro);
}

static bool fields_agree(const struct calibration *calibration)
{
    return gyro_agrees(&calibration->gyro) && period_agrees(calibration);
}

static bool rebalance_is_unstable(const struct gyro_cfg *gyro)
{
    return rebalance_is_described(gyro) && !rebalance_is_stable(gyro);
}

bool calibration_gyro_is_sound(const struct gyro_cfg *gyro)
{
    for (size_t i = 0; i < FIELD_COUNT; i++) {
        const struct calibration_field *field = &fields[i];
        bool of_the_gyro = field->offset >= AT(gyro);
        if (of_the_gyro && !in_range(field, layout_load((const uint8_t *)gyro + (field->offset - AT(gyro)), field->width))) {
            return false;
        }
    }
    return gyro_agrees(gyro) && !rebalance_is_unstable(gyro);
}

/* What the block says once and the configuration holds twice, and what the board adds. */
static void spread(struct gyro_cfg *gyro, const struct hal_properties *board)
{
    gyro->dac_shift = 32 - board->dac_bits;
    gyro->acquisition.decimation = gyro->lockin.decimation;
    gyro->lockin.reference_shift = lockin_reference_shift(gyro->lockin.decimation);
    gyro->drive.freq_min_u64 = gyro->acquisition.freq_start_u64;
    gyro->drive.freq_max_u64 = gyro->acquisition.freq_end_u64;
    gyro->calibration_valid = true;
}

enum reason calibration_parse(const uint8_t *block, size_t size, const struct hal_properties *board,
                              struct calibration *calibration)
{
    struct calibration parsed = {.serial = 0};
    enum reason reason = check_envelope(block, size);
    if (reason == REASON_OK) {
        reason = read_fields(block, &parsed);
    }
    if (reason == REASON_OK && !fields_agree(&parsed)) {
        reason = REASON_CALIBRATION_CONFLICT;
    }
    if (reason == REASON_OK && rebalance_is_unstable(&parsed.gyro)) {
        reason = REASON_CALIBRATION_UNSTABLE;
    }
    if (reason == REASON_OK && parsed.sample_rate_millihz != board->sample_rate_millihz) {
        reason = REASON_CALIBRATION_BOARD;
    }
    if (reason == REASON_OK) {
        spread(&parsed.gyro, board);
        *calibration = parsed;
    }
    return reason;
}

/* Where a field of the structure stands in the block. */
static size_t block_offset(size_t structure_offset)
{
    size_t position = HEADER_BYTES + CALIBRATION_NAME_BYTES;
    for (size_t i = 0; i < FIELD_COUNT && fields[i].offset != structure_offset; i++) {
        position += fields[i].width;
    }
    return position;
}

static void add_to_word(uint8_t *word, int32_t term)
{
    struct byte_reader reader = {word, 4, false};
    struct byte_writer writer = {word};
    bool clamped = false;
    put_i32(&writer, fixed_saturate_i32((int64_t)get_i32(&reader) + term, &clamped));
}

void calibration_add_phases(uint8_t block[CALIBRATION_BYTES], int32_t drive_rad_q31, int32_t demodulation_rad_q31)
{
    uint8_t *sequence = block + block_offset(AT(sequence));
    struct byte_reader reader = {sequence, 4, false};
    struct byte_writer sequence_writer = {sequence};
    put_u32(&sequence_writer, get_u32(&reader) + 1);
    add_to_word(block + block_offset(AT(gyro.drive_phase_rad_q31.coef[0])), drive_rad_q31);
    add_to_word(block + block_offset(AT(gyro.demodulation_phase_rad_q31.coef[0])), demodulation_rad_q31);
    struct byte_writer crc = {block + CALIBRATION_BYTES - 4};
    put_u32(&crc, crc32_update(0, block, CALIBRATION_BYTES - 4));
}
