#include "application/snapshot.h"

#include "application/bytes.h"
#include "application/layout.h"
#include "application/snapshot_check.h"

#define CFG(member, width)          {offsetof(struct gyro_cfg, member), (width), 1}
#define CFGS(member, width, count)  {offsetof(struct gyro_cfg, member), (width), (count)}
#define STATE(member, width)        {offsetof(struct gyro_state, member), (width), 1}
#define STATES(member, width, count) {offsetof(struct gyro_state, member), (width), (count)}
#define POLYNOMIAL(member)          CFGS(member.coef, 4, THERMAL_POLYNOMIAL_MAX_ORDER + 1), CFG(member.order, 4)
#define COMPLEX(member)             STATE(member.i_q30, 4), STATE(member.q_q30, 4)
#define CHANNEL(member)             STATE(member.sum, 8), STATE(member.ramp, 4), STATE(member.rising, 4)
#define AXIS(member)                STATE(member.integral_q54, 8), STATE(member.force_q31, 4), STATE(member.saturated, 1)
#define MEMORY(member)              STATE(member.next, 8), STATE(member.after, 8)
#define FILTER(member)                                                                                              \
    MEMORY(member.memory[0]), MEMORY(member.memory[1]), STATE(member.last, 4), STATE(member.choice, 4)

/* A field that is missing here is found by tests/unit/application/test_snapshot.c. A change of either table is a new
 * SNAPSHOT_VERSION. */
static const struct layout_field cfg_fields[] = {
    CFG(lockin.decimation, 4), CFG(lockin.normalise_q31, 4), CFG(lockin.reference_shift, 4), CFG(loops_per_slow, 4),
    CFG(acquisition.freq_start_u64, 8), CFG(acquisition.freq_end_u64, 8), CFG(acquisition.chirp_ticks_log2, 4),
    CFG(acquisition.settle_ticks, 4), CFG(acquisition.listen_ticks_log2, 4), CFG(acquisition.audible_q30, 4),
    CFG(acquisition.attempts, 4), CFG(acquisition.decimation, 4),
    CFG(drive.pll_proportional_q32, 4), CFG(drive.pll_integral_q32, 4), CFG(drive.phase_set_point_i32, 4),
    CFG(drive.freq_min_u64, 8),
    CFG(drive.freq_max_u64, 8), CFG(drive.amplitude_q30, 4), CFG(drive.agc_proportional_q16, 4),
    CFG(drive.agc_integral_q24, 4), CFG(drive.drive_max_q31, 4), CFG(drive.off, 1),
    CFG(rebalance.proportional_q16, 4), CFG(rebalance.integral_q24, 4), CFG(rebalance.in_phase_limit_q31, 4),
    CFG(rebalance.quadrature_limit_q31, 4),
    CFG(test_signal.in_phase_q31, 4), CFG(test_signal.quadrature_q31, 4), CFG(test_signal.freq_u32, 4),
    CFG(loop_delay_samples_q16, 4),
    CFG(thermometer.offset_raw, 4), CFG(thermometer.gain_degc_q36, 4), CFG(thermometer.shift_min_q20, 4),
    CFG(thermometer.shift_max_q20, 4),
    POLYNOMIAL(bias_rad_s_q31), POLYNOMIAL(scale_rad_s_q28), POLYNOMIAL(rebalance_scale_rad_s_q28),
    POLYNOMIAL(decay_per_s_q22), POLYNOMIAL(demodulation_phase_rad_q31), POLYNOMIAL(drive_phase_rad_q31),
    CFG(tuning.center_freq_u64, 8), CFG(tuning.center_2cos_q40, 8), CFG(tuning.center_cos_q31, 4),
    CFG(tuning.center_sin_q31, 4), CFG(tuning.sample_period_q46, 4), CFG(tuning.coupling_gain_q44, 4),
    CFG(monitor.phase_limit_i32, 4), CFG(monitor.amplitude_limit_q30, 4), CFG(monitor.hold_ticks, 4),
    CFG(monitor.adc_limit_q31, 4),
    CFG(loop, 4), CFG(compensation, 4), CFG(output_filter, 4), CFG(dac_shift, 4), CFG(calibration_valid, 1),
};

static const struct layout_field state_fields[] = {
    STATE(oscillator.phase_u64, 8), STATE(oscillator.freq_u64, 8),
    CHANNEL(primary_lockin.in_phase), CHANNEL(primary_lockin.quadrature), CHANNEL(secondary_lockin.in_phase),
    CHANNEL(secondary_lockin.quadrature),
    STATE(decoupler_coefs.minus_gain_q48, 4), STATE(decoupler_coefs.a1_q30, 4), STATE(decoupler_coefs.a1_low_q36, 4),
    STATE(decoupler_coefs.minus_r2_q30, 4), STATE(decoupler_coefs.minus_r2_low_q36, 4),
    STATE(decoupler.next_q61, 8), STATE(decoupler.after_q61, 8), STATE(decoupler.error1_q63, 4),
    STATE(decoupler.error2_q63, 4),
    STATE(acquisition.phase, 4), STATE(acquisition.tick, 4), STATE(acquisition.attempt, 4),
    STATE(acquisition.last_angle_i32, 4), STATE(acquisition.unwrapped, 8), STATES(acquisition.half_sum, 8, 2),
    STATE(acquisition.least_q30, 4),
    STATE(drive.freq_integral_u64, 8), STATE(drive.freq_u64, 8), STATE(drive.drive_integral_q54, 8),
    STATE(drive.drive_q31, 4), STATE(drive.phase_error_i32, 4), STATE(drive.amplitude_q30, 4), STATE(drive.saturated, 1),
    AXIS(rebalance.in_phase), AXIS(rebalance.quadrature), STATE(test_signal.phase_u32, 4),
    STATE(drive_shaper.error1, 4), STATE(drive_shaper.error2, 4), STATE(rebalance_shaper.error1, 4),
    STATE(rebalance_shaper.error2, 4),
    STATE(rate.removed_rad_s_q46, 8),
    FILTER(filter), FILTER(filter_uncompensated),
    COMPLEX(primary), COMPLEX(secondary), STATE(primary_polar.magnitude_q30, 4), STATE(primary_polar.angle_i32, 4),
    STATE(primary_sum.i_q30, 8), STATE(primary_sum.q_q30, 8), STATE(secondary_sum.i_q30, 8), STATE(secondary_sum.q_q30, 8),
    STATE(rebalance_sum.i_q30, 8), STATE(rebalance_sum.q_q30, 8),
    STATE(drive_lead.cosine_q30, 4), STATE(drive_lead.sine_q30, 4),
    STATE(demodulation.cosine_q30, 4), STATE(demodulation.sine_q30, 4),
    STATE(drive_force.cosine_q31, 4), STATE(drive_force.sine_q31, 4), STATE(rebalance_force.cosine_q31, 4),
    STATE(rebalance_force.sine_q31, 4), STATE(dac_mask, 4), STATE(two_cos_q30, 4),
    STATE(temperature_shift_q20, 4), STATE(bias_rad_s_q31, 4), STATE(scale_rad_s_q28, 4), STATE(decay_per_s_q22, 4),
    STATE(drive_phase_rad_q31, 4), STATE(bias_at_tick_q31, 4), STATE(bias_step_q31, 4), STATE(gain_step_q48, 4),
    STATE(loop_slot, 4), STATE(slow_slot, 4), STATE(blank_ticks, 4), STATE(lock_ticks, 4), STATE(silent_ticks, 4),
    STATE(loop, 4), STATE(compensation, 4),
    STATE(overflow, 1), STATE(adc_saturated, 1), STATE(drive_saturated, 1), STATE(rebalance_saturated, 1),
    STATE(temperature_seen, 1), STATE(temperature_valid, 1), STATE(retune_valid, 1), STATE(decoupling, 1),
    COMPLEX(signals.primary), COMPLEX(signals.secondary), STATE(signals.freq_u64, 8), STATE(signals.drive_level_q31, 4),
    STATE(signals.amplitude_set_point_q30, 4), STATE(signals.rebalance_in_phase_q31, 4),
    STATE(signals.rebalance_quadrature_q31, 4), STATE(signals.temperature_shift_q20, 4), STATE(signals.bias_rad_s_q31, 4),
    STATE(signals.rate_rad_s_q28, 4), STATE(signals.rate_uncompensated_rad_s_q28, 4),
    STATE(signals.quadrature_rad_s_q28, 4), STATE(signals.angle_u64, 8), STATE(signals.status, 4),
};

#define CFG_FIELDS   (sizeof cfg_fields / sizeof cfg_fields[0])
#define STATE_FIELDS (sizeof state_fields / sizeof state_fields[0])

size_t snapshot_bytes(void)
{
    return SNAPSHOT_HEADER_BYTES + layout_bytes(cfg_fields, CFG_FIELDS) + layout_bytes(state_fields, STATE_FIELDS);
}

static void build_header(uint64_t sample_counter, uint8_t header[SNAPSHOT_HEADER_BYTES])
{
    struct byte_writer writer = {header};
    put_u16(&writer, SNAPSHOT_VERSION);
    put_u16(&writer, (uint16_t)snapshot_bytes());
    put_u64(&writer, sample_counter);
}

static size_t write_header(const struct snapshot *snapshot, size_t position, uint8_t *out, size_t count)
{
    uint8_t header[SNAPSHOT_HEADER_BYTES];
    size_t written = 0;
    build_header(snapshot->sample_counter, header);
    while (position + written < SNAPSHOT_HEADER_BYTES && written < count) {
        out[written] = header[position + written];
        written++;
    }
    return written;
}

/* `position` counts from the start of the snapshot, `start` is where this part begins. */
static size_t write_part(const struct layout_field *fields, size_t field_count, const void *structure, size_t start,
                         size_t position, uint8_t *out, size_t count)
{
    return position < start ? 0 : layout_write(fields, field_count, structure, position - start, out, count);
}

size_t snapshot_write(const struct snapshot *snapshot, size_t position, uint8_t *out, size_t count)
{
    size_t state_start = SNAPSHOT_HEADER_BYTES + layout_bytes(cfg_fields, CFG_FIELDS);
    size_t written = write_header(snapshot, position, out, count);
    if (position + written < state_start) {
        written += write_part(cfg_fields, CFG_FIELDS, &snapshot->cfg, SNAPSHOT_HEADER_BYTES, position + written, out + written,
                              count - written);
    }
    written += write_part(state_fields, STATE_FIELDS, &snapshot->state, state_start, position + written, out + written,
                          count - written);
    return written;
}

enum reason snapshot_read(const uint8_t *bytes, size_t size, struct snapshot *snapshot)
{
    struct byte_reader reader = {bytes, size, false};
    uint16_t version = get_u16(&reader);
    uint16_t stated = get_u16(&reader);
    if (version != SNAPSHOT_VERSION || stated != size || size != snapshot_bytes()) {
        return REASON_SNAPSHOT_VERSION;
    }
    struct snapshot read = {.sample_counter = get_u64(&reader)};
    layout_read(cfg_fields, CFG_FIELDS, &read.cfg, reader.next);
    layout_read(state_fields, STATE_FIELDS, &read.state, reader.next + layout_bytes(cfg_fields, CFG_FIELDS));
    if (!snapshot_is_sound(&read)) {
        return REASON_SNAPSHOT_RANGE;
    }
    *snapshot = read;
    return REASON_OK;
}
