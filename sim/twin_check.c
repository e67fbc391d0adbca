#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#include "sim/twin_internal.h"

#define LONGEST_DELAY_SAMPLES 24.0
#define LARGEST_BLOCK 65536u
#define LARGEST_DEGC 10000.0

static bool within(double value, double low, double high)
{
    return value >= low && value <= high; /* false for what is not a number */
}

static bool sampling_ok(const struct twin_cfg *cfg)
{
    double rate_hz = cfg->sample_rate_hz;
    return within(rate_hz, 1.0, 4e6) && rate_hz > 4.0 * cfg->resonator.frequency_hz && cfg->block_samples > 0
           && cfg->block_samples <= LARGEST_BLOCK;
}

static bool resonator_ok(const struct resonator_cfg *cfg)
{
    struct resonator resonator;
    resonator_init(cfg, &resonator);
    return cfg->frequency_hz > 0.0 && cfg->quality_factor > 0.0 && cfg->angular_gain > 0.0 && isfinite(cfg->angular_gain)
           && isfinite(cfg->drive_force_fs_s2) && isfinite(cfg->rebalance_force_fs_s2) && resonator_is_passive(&resonator, cfg->reference_degc);
}

static bool thermal_ok(const struct thermal_cfg *cfg)
{
    return within(cfg->initial_degc, -LARGEST_DEGC, LARGEST_DEGC) && within(cfg->shell_time_constant_s, 0.0, 1e9)
           && within(cfg->thermometer_lag_s, 0.0, 1e9) && within(cfg->thermometer_lsb_degc, 1e-12, LARGEST_DEGC)
           && within(cfg->thermometer_offset_degc, -LARGEST_DEGC, LARGEST_DEGC)
           && within(cfg->thermometer_noise_degc, 0.0, LARGEST_DEGC);
}

static bool electronics_ok(const struct electronics_cfg *cfg)
{
    bool ok = cfg->adc_bits >= 8 && cfg->adc_bits <= 32 && cfg->dac_bits >= 8 && cfg->dac_bits <= 32
              && within(cfg->adc_delay_samples, 0.0, LONGEST_DELAY_SAMPLES)
              && within(cfg->adc_secondary_delay_samples, 0.0, LONGEST_DELAY_SAMPLES - cfg->adc_delay_samples)
              && within(cfg->dac_latency_samples, 0.0, LONGEST_DELAY_SAMPLES);
    for (int channel = 0; channel < 2; channel++) {
        ok = ok && within(cfg->adc_noise_rms_fs[channel], 0.0, 1.0) && within(cfg->adc_offset_fs[channel], -1.0, 1.0);
    }
    return ok;
}

int32_t twin_check_cfg(const struct twin_cfg *cfg)
{
    if (!sampling_ok(cfg)) {
        return TWIN_ERROR_SAMPLE_RATE;
    }
    if (!resonator_ok(&cfg->resonator)) {
        return TWIN_ERROR_RESONATOR;
    }
    if (!thermal_ok(&cfg->thermal)) {
        return TWIN_ERROR_THERMAL;
    }
    return electronics_ok(&cfg->electronics) ? TWIN_OK : TWIN_ERROR_ELECTRONICS;
}

static bool all_within(const double *values, uint64_t n, double limit)
{
    for (uint64_t i = 0; values && i < n; i++) {
        if (!within(values[i], -limit, limit)) {
            return false;
        }
    }
    return true;
}

/* The shell stays between the temperatures that the chamber takes: each of them must be possible. */
static bool passive_everywhere(const struct resonator *resonator, const double *degc, uint64_t n)
{
    for (uint64_t i = 0; degc && i < n; i++) {
        bool seen = i > 0 && degc[i] == degc[i - 1];
        if (!seen && !resonator_is_passive(resonator, degc[i])) {
            return false;
        }
    }
    return true;
}

/* A rate must leave the stiffness positive; the limits are far above what any table does. */
int32_t twin_check_profile(const struct twin *twin, const struct twin_profile *profile)
{
    double k = twin->resonator.velocity_scale_rad_s;
    bool ok = all_within(profile->rate_rad_s, profile->n_blocks, 0.1 * k)
              && all_within(profile->rate_dot_rad_s2, profile->n_blocks, 0.1 * k * k)
              && all_within(profile->chamber_degc, profile->n_blocks, LARGEST_DEGC)
              && passive_everywhere(&twin->resonator, profile->chamber_degc, profile->n_blocks);
    return ok ? TWIN_OK : TWIN_ERROR_PROFILE;
}
