#include "support/core_recording.h"

#include "support/random.h"

static void take(const struct gyro_state *state, const struct gyro_input *input, struct gyro_output output, struct recorded_sample *sample)
{
    sample->freq_u64 = state->oscillator.freq_u64;
    sample->primary_q31 = input->primary_q31;
    sample->secondary_q31 = input->secondary_q31;
    sample->bias_rad_s_q31 = state->bias_rad_s_q31;
    sample->decay_per_s_q22 = state->decay_per_s_q22;
    sample->rate_rad_s_q28 = state->signals.rate_rad_s_q28;
    sample->status = state->signals.status;
    sample->slow_tick = output.slow_tick;
}

int core_record(const struct fixture_device *device, uint64_t seed, size_t settle, size_t count, struct recorded_sample *samples)
{
    struct gyro_cfg cfg = fixture_cfg(device);
    struct gyro_state state;
    struct fixture_plant plant;
    struct random_state random = {seed};
    gyro_reset(&cfg, &state);
    fixture_plant_init(&plant, device);
    for (size_t n = 0; n < settle; n++) {
        (void)fixture_sample(device, &cfg, &state, &plant, &random);
    }
    for (size_t n = 0; n < count; n++) {
        int32_t primary = fixture_adc_q31(device, plant.x1, random_gauss(&random));
        struct gyro_input input = {primary, fixture_adc_q31(device, plant.x2, random_gauss(&random)), 0};
        samples[n].phase_u32 = (uint32_t)((state.oscillator.phase_u64 + state.oscillator.freq_u64) >> 32);
        struct gyro_output output = gyro_step(&cfg, &state, &input);
        take(&state, &input, output, &samples[n]);
        fixture_plant_step(&plant, output.drive_q31, output.rebalance_q31);
    }
    return samples[0].status & GYRO_STATUS_LOCKED ? 0 : -1;
}

int core_decoupler(const int32_t coefs[5], const int32_t *primary_q31, size_t count, int32_t *out_q31, int64_t *out_q61)
{
    struct decoupler_coefs words = {coefs[0], coefs[1], coefs[2], coefs[3], coefs[4]};
    struct decoupler_state state;
    bool overflow = false;
    decoupler_reset(&state);
    for (size_t n = 0; n < count; n++) {
        out_q61[n] = state.next_q61 - (((int64_t)words.minus_gain_q48 * primary_q31[n]) >> 18);
        out_q31[n] = decoupler_step(&words, &state, primary_q31[n], &overflow);
    }
    return overflow;
}

int core_retune(double sample_rate_hz, double center_freq_hz, double freq_hz, int32_t decay_per_s_q22, int32_t bias_rad_s_q31,
                int32_t coefs[5])
{
    struct decoupler_tuning tuning = fixture_tuning(sample_rate_hz, center_freq_hz, 2.0);
    struct decoupler_coefs words = {0, 0, 0, 0, 0};
    uint64_t freq_u64 = (uint64_t)(freq_hz / sample_rate_hz * 18446744073709551616.0);
    bool accepted = decoupler_retune(&tuning, freq_u64, decay_per_s_q22, bias_rad_s_q31, &words);
    coefs[0] = words.minus_gain_q48;
    coefs[1] = words.a1_q30;
    coefs[2] = words.a1_low_q36;
    coefs[3] = words.minus_r2_q30;
    coefs[4] = words.minus_r2_low_q36;
    return accepted;
}

void core_output_filter(uint32_t choice, const int32_t *values, size_t count, int32_t *out)
{
    struct output_filter_state state;
    bool overflow = false;
    output_filter_reset(&state, 0);
    for (size_t n = 0; n < count; n++) {
        out[n] = output_filter_step(choice, &state, values[n], &overflow);
    }
}

size_t core_polynomial(const int32_t coef[6], uint32_t order, const int32_t *argument_q31, size_t count, int32_t *out)
{
    struct thermal_polynomial polynomial = {{coef[0], coef[1], coef[2], coef[3], coef[4], coef[5]}, order};
    size_t clamped = 0;
    for (size_t n = 0; n < count; n++) {
        bool overflow = false;
        out[n] = thermal_polynomial_eval(&polynomial, argument_q31[n], &overflow);
        clamped += overflow;
    }
    return clamped;
}
