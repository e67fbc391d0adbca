#include <math.h>

#include "sim/elementary.h"
#include "sim/twin_internal.h"

double twin_oscillator_turns(const struct twin *twin)
{
    return (double)(int64_t)(twin->device->board.app.gyro.oscillator.phase_u64 >> 11) * 0x1p-53;
}

double twin_oscillator_hz(const struct twin *twin)
{
    return (double)twin->device->board.app.gyro.oscillator.freq_u64 * 0x1p-64 * twin->cfg.sample_rate_hz;
}

/* From x = Re(z) and x' = Re(j w z) of a steady motion: z = x - j x' / w, with w near enough the mean resonance; then turned back. */
struct twin_phasor twin_phasor(const struct twin *twin, int mode)
{
    struct elementary_pair reference = elementary_cos_sin_turns(twin_oscillator_turns(twin));
    const struct resonator_coefs *coefs = &twin->parameters.resonator;
    double frequency = sqrt(0.5 * (coefs->stiffness[0] + coefs->stiffness[1]));
    double real = twin->motion.mode[mode][0];
    double imaginary = -twin->motion.mode[mode][1] * (twin->resonator.velocity_scale_rad_s / frequency);
    return (struct twin_phasor){
        real * reference.cosine + imaginary * reference.sine,
        imaginary * reference.cosine - real * reference.sine,
    };
}

void twin_truth(const struct twin *twin, struct twin_truth *truth)
{
    struct plant_parameters parameters;
    struct effect_context at = twin_context(twin, 0.0);
    at.shell_degc = twin->temperature.shell_degc;
    twin_parameters_at(twin, &at, twin->parameters.resonator.rate_rad_s, twin->parameters.resonator.rate_dot_rad_s2, &parameters);
    const struct resonator_coefs now = parameters.resonator;
    double primary_rad_s = sqrt(now.stiffness[0] - now.rate_rad_s * now.rate_rad_s);
    struct twin_phasor primary = twin_phasor(twin, 0);
    struct twin_phasor secondary = twin_phasor(twin, 1);
    *truth = (struct twin_truth){
        .time_s = (double)twin->sample / twin->cfg.sample_rate_hz,
        .shell_degc = twin->temperature.shell_degc,
        .resonance_hz = resonator_quadrature_rad_s(&now) / ELEMENTARY_TWO_PI,
        .primary_frequency_hz = primary_rad_s / ELEMENTARY_TWO_PI,
        .quality_factor = sqrt(now.stiffness[0]) / now.damping[0],
        .bias_rad_s = now.cross_damping_12 / now.angular_gain,
        .oscillator_hz = twin_oscillator_hz(twin),
        .primary_amplitude = sqrt(primary.i * primary.i + primary.q * primary.q),
        .primary_phase_rad = atan2(primary.q, primary.i),
        .secondary_i = secondary.i,
        .secondary_q = secondary.q,
        .samples = twin->sample,
        .adc_saturations = twin->adc_saturations,
        .dac_saturations = twin->dac_saturations,
    };
}

void noise_fill(uint64_t seed, uint32_t stream, uint64_t n, double *values)
{
    struct noise_table table;
    struct noise_state state;
    noise_table_init(&table);
    noise_init(&state, seed, stream);
    noise_gaussian(&table, &state, n, values);
}
