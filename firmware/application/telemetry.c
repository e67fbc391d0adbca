#include "application/telemetry.h"

#define DEFAULT_BASEBAND_DIVISOR 10
#define DEFAULT_OUTPUT_DIVISOR   10

void telemetry_init(struct telemetry *telemetry)
{
    telemetry_set_divisors(telemetry, DEFAULT_BASEBAND_DIVISOR, DEFAULT_OUTPUT_DIVISOR);
}

void telemetry_set_divisors(struct telemetry *telemetry, uint16_t baseband, uint16_t output)
{
    atomic_store_explicit(&telemetry->divisors, (uint32_t)output << 16 | baseband, memory_order_relaxed);
}

uint16_t telemetry_baseband_divisor(struct telemetry *telemetry)
{
    return (uint16_t)atomic_load_explicit(&telemetry->divisors, memory_order_relaxed);
}

uint16_t telemetry_output_divisor(struct telemetry *telemetry)
{
    return (uint16_t)(atomic_load_explicit(&telemetry->divisors, memory_order_relaxed) >> 16);
}

/* ---- interrupt --------------------------------------------------------------------------------------------------------- */

static void interval_add(struct telemetry_interval *interval, uint32_t status, uint64_t sample_counter, uint32_t period_samples)
{
    interval->status_and = interval->ticks == 0 ? status : interval->status_and & status;
    interval->status_or |= status;
    interval->ticks++;
    interval->samples += period_samples;
    interval->sample_counter = sample_counter;
}

static void baseband_add(struct baseband_record *sum, const struct gyro_signals *signals)
{
    sum->primary_i += signals->primary.i_q30;
    sum->primary_q += signals->primary.q_q30;
    sum->secondary_i += signals->secondary.i_q30;
    sum->secondary_q += signals->secondary.q_q30;
    sum->drive_level += signals->drive_level_q31;
    sum->amplitude_set_point += signals->amplitude_set_point_q30;
    sum->rebalance_in_phase += signals->rebalance_in_phase_q31;
    sum->rebalance_quadrature += signals->rebalance_quadrature_q31;
    sum->freq_high += signals->freq_u64 >> 32;
    sum->freq_low += signals->freq_u64 & UINT32_MAX;
}

static void output_add(struct output_record *sum, const struct gyro_signals *signals, int32_t thermometer_raw)
{
    sum->temperature_shift += signals->temperature_shift_q20;
    sum->bias += signals->bias_rad_s_q31;
    sum->rate += signals->rate_rad_s_q28;
    sum->rate_uncompensated += signals->rate_uncompensated_rad_s_q28;
    sum->quadrature += signals->quadrature_rad_s_q28;
    sum->angle = signals->angle_u64;
    sum->thermometer_raw = thermometer_raw;
}

static void baseband_close(struct telemetry *telemetry)
{
    uint32_t index;
    if (ring_slot(&telemetry->baseband_ring, TELEMETRY_RECORDS, &index)) {
        telemetry->baseband[index] = telemetry->baseband_sum;
        ring_put(&telemetry->baseband_ring);
    } else {
        atomic_fetch_add_explicit(&telemetry->records_lost, 1, memory_order_relaxed);
    }
    telemetry->baseband_sum = (struct baseband_record){.primary_i = 0};
}

static void output_close(struct telemetry *telemetry)
{
    uint32_t index;
    if (ring_slot(&telemetry->output_ring, TELEMETRY_RECORDS, &index)) {
        telemetry->output[index] = telemetry->output_sum;
        ring_put(&telemetry->output_ring);
    } else {
        atomic_fetch_add_explicit(&telemetry->records_lost, 1, memory_order_relaxed);
    }
    telemetry->output_sum = (struct output_record){.rate = 0};
}

void telemetry_add(struct telemetry *telemetry, const struct gyro_signals *signals, int32_t thermometer_raw,
                   uint64_t sample_counter, uint32_t period_samples)
{
    uint32_t divisors = atomic_load_explicit(&telemetry->divisors, memory_order_relaxed);
    uint32_t baseband_divisor = divisors & 0xFFFF;
    uint32_t output_divisor = divisors >> 16;
    atomic_fetch_or_explicit(&telemetry->status_or, signals->status, memory_order_relaxed);
    atomic_fetch_or_explicit(&telemetry->status_nand, ~signals->status, memory_order_relaxed);
    if (baseband_divisor != 0) {
        interval_add(&telemetry->baseband_sum.interval, signals->status, sample_counter, period_samples);
        baseband_add(&telemetry->baseband_sum, signals);
        if (telemetry->baseband_sum.interval.ticks >= baseband_divisor) {
            baseband_close(telemetry);
        }
    }
    if (output_divisor != 0) {
        interval_add(&telemetry->output_sum.interval, signals->status, sample_counter, period_samples);
        output_add(&telemetry->output_sum, signals, thermometer_raw);
        if (telemetry->output_sum.interval.ticks >= output_divisor) {
            output_close(telemetry);
        }
    }
}

void telemetry_restart(struct telemetry *telemetry)
{
    telemetry->baseband_sum = (struct baseband_record){.primary_i = 0};
    telemetry->output_sum = (struct output_record){.rate = 0};
}

/* ---- background -------------------------------------------------------------------------------------------------------- */

/* Mean of values that fit 32 bit, rounded half up. Range: |sum| < 2^47, ticks < 2^16, so 2 sum + ticks < 2^49; the quotient is
 * floored, which C does not do for negative numerators. */
static int32_t mean_i32(int64_t sum, uint32_t ticks)
{
    int64_t numerator = 2 * sum + ticks;
    int64_t denominator = 2 * (int64_t)ticks;
    int64_t quotient = numerator / denominator;
    return (int32_t)(numerator % denominator < 0 ? quotient - 1 : quotient);
}

/* Mean of 64-bit words from the sums of their halves: (high 2^32 + low) / n, rounded half up.
 * Range: high < 2^48; its remainder < 2^16, so remainder 2^32 + low + n < 2^49. */
static uint64_t mean_u64(uint64_t high, uint64_t low, uint32_t ticks)
{
    uint64_t remainder = high % ticks;
    return ((high / ticks) << 32) + ((remainder << 32) + low + ticks / 2) / ticks;
}

static void put_interval_status(struct byte_writer *writer, const struct telemetry_interval *interval)
{
    put_u32(writer, interval->status_or);
    put_u32(writer, interval->status_and);
}

static void send_baseband(const struct baseband_record *record, struct sender *sender, const struct hal *hal)
{
    struct byte_writer writer = sender_payload(sender);
    uint32_t ticks = record->interval.ticks;
    put_u32(&writer, record->interval.samples);
    put_i32(&writer, mean_i32(record->primary_i, ticks));
    put_i32(&writer, mean_i32(record->primary_q, ticks));
    put_i32(&writer, mean_i32(record->secondary_i, ticks));
    put_i32(&writer, mean_i32(record->secondary_q, ticks));
    put_u64(&writer, mean_u64(record->freq_high, record->freq_low, ticks));
    put_i32(&writer, mean_i32(record->drive_level, ticks));
    put_i32(&writer, mean_i32(record->amplitude_set_point, ticks));
    put_i32(&writer, mean_i32(record->rebalance_in_phase, ticks));
    put_i32(&writer, mean_i32(record->rebalance_quadrature, ticks));
    put_interval_status(&writer, &record->interval);
    sender_send(sender, hal, FRAME_BASEBAND, record->interval.sample_counter, writer);
}

static void send_output(const struct output_record *record, struct sender *sender, const struct hal *hal)
{
    struct byte_writer writer = sender_payload(sender);
    uint32_t ticks = record->interval.ticks;
    put_u32(&writer, record->interval.samples);
    put_i32(&writer, record->thermometer_raw);
    put_i32(&writer, mean_i32(record->temperature_shift, ticks));
    put_i32(&writer, mean_i32(record->bias, ticks));
    put_i32(&writer, mean_i32(record->rate, ticks));
    put_i32(&writer, mean_i32(record->rate_uncompensated, ticks));
    put_i32(&writer, mean_i32(record->quadrature, ticks));
    put_u64(&writer, record->angle);
    put_interval_status(&writer, &record->interval);
    sender_send(sender, hal, FRAME_OUTPUT, record->interval.sample_counter, writer);
}

void telemetry_poll(struct telemetry *telemetry, struct sender *sender, const struct hal *hal)
{
    while (ring_waiting(&telemetry->baseband_ring) > 0) {
        send_baseband(&telemetry->baseband[ring_index(&telemetry->baseband_ring, TELEMETRY_RECORDS, 0)], sender, hal);
        ring_drop(&telemetry->baseband_ring, 1);
    }
    while (ring_waiting(&telemetry->output_ring) > 0) {
        send_output(&telemetry->output[ring_index(&telemetry->output_ring, TELEMETRY_RECORDS, 0)], sender, hal);
        ring_drop(&telemetry->output_ring, 1);
    }
}
