#include "support/gyro_fixture.h"

#include <math.h>

#include "support/random.h"

#define TURN_U64 18446744073709551616.0

static double two_pi(void)
{
    return 8.0 * atan(1.0);
}

static uint64_t freq_u64(const struct fixture_device *device, double freq_hz)
{
    return (uint64_t)(freq_hz / device->sample_rate_hz * TURN_U64);
}

static int32_t q(double value, int bits)
{
    return (int32_t)llrint(fmin(ldexp(value, bits), 2147483647.0));
}

static double decay_rate(const struct fixture_device *device)
{
    return two_pi() * device->center_freq_hz / (2.0 * device->quality);
}

struct fixture_device fixture_default(void)
{
    return (struct fixture_device){
        .sample_rate_hz = 50e3,
        .freq_hz = 5000.0,
        .center_freq_hz = 5000.0,
        .quality = 1e4,
        .gain = 2.0,
        .amplitude = 0.9,
        .force_margin = 2.0,
        .adc_noise = sqrt(0.5) * pow(10.0, -90.0 / 20.0),
        .adc_bits = 16,
    };
}

struct decoupler_tuning fixture_tuning(double sample_rate_hz, double center_freq_hz, double gain)
{
    double w = two_pi() * center_freq_hz / sample_rate_hz;
    return (struct decoupler_tuning){
        .center_freq_u64 = (uint64_t)(center_freq_hz / sample_rate_hz * TURN_U64),
        .center_2cos_q40 = llrint(ldexp(2.0 * cos(w), 40)),
        .center_cos_q31 = q(cos(w), 31),
        .center_sin_q31 = q(sin(w), 31),
        .sample_period_q46 = q(1.0 / sample_rate_hz, 46),
        .coupling_gain_q44 = q(gain / sample_rate_hz, 44),
    };
}

static void set_acquisition(struct gyro_cfg *cfg, const struct fixture_device *device)
{
    cfg->acquisition = (struct acquisition_cfg){
        .freq_start_u64 = freq_u64(device, device->center_freq_hz * 0.988),
        .freq_end_u64 = freq_u64(device, device->center_freq_hz * 1.012),
        .chirp_ticks_log2 = 9,
        .settle_ticks = 20,
        .listen_ticks_log2 = 8,
        .audible_q30 = q(3e-4, 30),
        .attempts = 3,
        .decimation = cfg->lockin.decimation,
    };
}

/* Amplitude per second at full force, which the hold between two samples weakens by sin(x)/x. */
static double growth_rate(const struct fixture_device *device)
{
    double x = 0.5 * two_pi() * device->center_freq_hz / device->sample_rate_hz;
    return device->force_margin * device->amplitude * decay_rate(device) * sin(x) / x;
}

/* PLL bandwidth 40 Hz, AGC 5 Hz, rebalance 50 Hz. */
static void set_loops(struct gyro_cfg *cfg, const struct fixture_device *device)
{
    double period = 1.0 / device->sample_rate_hz;
    double tick = period * cfg->lockin.decimation;
    double proportional = two_pi() * 40.0;
    double integral = proportional * proportional / 1.96;
    double growth = growth_rate(device);
    double agc = two_pi() * 5.0 / growth;
    cfg->drive = (struct drive_loop_cfg){
        .pll_proportional_q32 = (uint32_t)llrint(ldexp(proportional * period, 32)),
        .pll_integral_q32 = (uint32_t)llrint(ldexp(integral * tick * period, 32)),
        .freq_min_u64 = freq_u64(device, device->center_freq_hz * 0.985),
        .freq_max_u64 = freq_u64(device, device->center_freq_hz * 1.015),
        .amplitude_q30 = q(device->amplitude, 30),
        .agc_proportional_q16 = q(agc, 16),
        .agc_integral_q24 = q(agc * two_pi() * 5.0 / 4.0 * tick, 24),
        .drive_max_q31 = q(0.9999, 31),
    };
    double rebalance = two_pi() * 50.0 / growth;
    cfg->rebalance = (struct rebalance_cfg){
        .proportional_q16 = q(rebalance, 16),
        .integral_q24 = q(rebalance * two_pi() * 50.0 / 4.0 * tick, 24),
        .in_phase_limit_q31 = q(0.7, 31),
        .quadrature_limit_q31 = q(0.7, 31),
    };
}

static void set_polynomials(struct gyro_cfg *cfg, const struct fixture_device *device)
{
    double decay = decay_rate(device);
    cfg->bias_rad_s_q31.coef[0] = q(device->bias_rad_s, 31);
    cfg->scale_rad_s_q28.coef[0] = q(2.0 * decay / device->gain, 28);
    cfg->rebalance_scale_rad_s_q28.coef[0] = q(2.0 * growth_rate(device) / device->gain, 28);
    cfg->decay_per_s_q22.coef[0] = q(decay, 22);
}

struct gyro_cfg fixture_cfg(const struct fixture_device *device)
{
    struct gyro_cfg cfg = {.lockin = {.decimation = 10, .normalise_q31 = q(4.0 / 100.0, 31), .reference_shift = lockin_reference_shift(10)}, .loops_per_slow = 5};
    set_acquisition(&cfg, device);
    set_loops(&cfg, device);
    set_polynomials(&cfg, device);
    cfg.loop_delay_samples_q16 = 1u << 15; /* the plant takes each force at once; its hold is half a sample late */
    cfg.thermometer = (struct gyro_thermometer_cfg){0, 1 << 20, INT32_MIN, INT32_MAX};
    cfg.tuning = fixture_tuning(device->sample_rate_hz, device->center_freq_hz, device->gain);
    cfg.monitor = (struct gyro_monitor_cfg){
        .phase_limit_i32 = q(0.5 / 360.0, 32),
        .amplitude_limit_q30 = q(0.01 * device->amplitude, 30),
        .hold_ticks = 500,
        .adc_limit_q31 = q(0.999, 31),
    };
    cfg.dac_shift = 16;
    cfg.loop = device->loop;
    cfg.compensation = device->compensation;
    cfg.calibration_valid = true;
    return cfg;
}

void fixture_plant_init(struct fixture_plant *plant, const struct fixture_device *device)
{
    double period = 1.0 / device->sample_rate_hz;
    double k = two_pi() * device->freq_hz;
    double decay = k / (2.0 * device->quality);
    double w = sqrt(k * k - decay * decay);
    double shrink = exp(-decay * period), c = cos(w * period), s = sin(w * period);
    *plant = (struct fixture_plant){
        .position_rr = shrink * (c + decay / w * s),
        .position_rv = shrink * s / w,
        .velocity_rr = -shrink * k * k / w * s,
        .velocity_rv = shrink * (c - decay / w * s),
        .full_force = device->force_margin * device->amplitude * 2.0 * decay * k,
        .kick = 0.5 * period * device->gain * (device->rate_rad_s + device->bias_rad_s),
    };
    plant->force_r = (1.0 - plant->position_rr) / (k * k);
    plant->force_v = plant->position_rv;
}

/* Each mode moves freely under its held force; mode 2 gets half of the Coriolis kick before and half after. */
void fixture_plant_step(struct fixture_plant *plant, int32_t drive_q31, int32_t rebalance_q31)
{
    double force1 = plant->full_force * drive_q31 * 0x1p-31, force2 = plant->full_force * rebalance_q31 * 0x1p-31;
    plant->v2 += plant->kick * plant->v1;
    double x1 = plant->position_rr * plant->x1 + plant->position_rv * plant->v1 + plant->force_r * force1;
    double v1 = plant->velocity_rr * plant->x1 + plant->velocity_rv * plant->v1 + plant->force_v * force1;
    double x2 = plant->position_rr * plant->x2 + plant->position_rv * plant->v2 + plant->force_r * force2;
    double v2 = plant->velocity_rr * plant->x2 + plant->velocity_rv * plant->v2 + plant->force_v * force2;
    plant->x1 = x1;
    plant->v1 = v1;
    plant->x2 = x2;
    plant->v2 = v2 + plant->kick * v1;
}

int32_t fixture_adc_q31(const struct fixture_device *device, double position, double noise)
{
    uint32_t bits = device->adc_bits == 0 ? 31 : device->adc_bits;
    double full = ldexp(1.0, (int)bits - 1);
    double code = rint((position + device->adc_noise * noise) * full);
    code = fmin(fmax(code, -full), full - 1.0);
    return (int32_t)((int64_t)code * (INT64_C(1) << (32 - bits)));
}

struct gyro_output fixture_sample(const struct fixture_device *device, const struct gyro_cfg *cfg, struct gyro_state *state,
                                  struct fixture_plant *plant, struct random_state *random)
{
    struct gyro_input input = {fixture_adc_q31(device, plant->x1, random_gauss(random)),
                               fixture_adc_q31(device, plant->x2, random_gauss(random)), 0};
    struct gyro_output output = gyro_step(cfg, state, &input);
    fixture_plant_step(plant, output.drive_q31, output.rebalance_q31);
    return output;
}
