/* The firmware's kernels over arrays, for tests and tools. */
#include "hal/host/wineglass_device.h"

#include "application/crc32.h"
#include "core/output_filter.h"
#include "core/polar.h"
#include "core/rate.h"
#include "core/thermal_polynomial.h"

int64_t wg_thermal_polynomial_eval(const int32_t *coef, int32_t order, const int32_t *shift_q20, int32_t *out, size_t n)
{
    struct thermal_polynomial polynomial = {.order = (uint32_t)order};
    int64_t clamped = 0;
    if (order < 0 || order > THERMAL_POLYNOMIAL_MAX_ORDER) {
        return -1;
    }
    for (int32_t i = 0; i <= THERMAL_POLYNOMIAL_MAX_ORDER; i++) {
        polynomial.coef[i] = coef[i];
    }
    for (size_t i = 0; i < n; i++) {
        bool overflow = false;
        out[i] = thermal_polynomial_eval(&polynomial, thermal_polynomial_argument(shift_q20[i], &overflow), &overflow);
        clamped += overflow;
    }
    return clamped;
}

void wg_oscillator_eval(const uint32_t *phase_u32, int32_t *cosine_q30, int32_t *sine_q30, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        struct phasor_q30 phasor = oscillator_phasor(phase_u32[i]);
        cosine_q30[i] = phasor.cosine_q30;
        sine_q30[i] = phasor.sine_q30;
    }
}

int64_t wg_lockin_run(uint32_t decimation, uint64_t phase_u64, uint64_t freq_u64, const int32_t *pickoff_q31,
                      int32_t *in_phase_q30, int32_t *quadrature_q30, size_t n)
{
    struct oscillator_state oscillator = {phase_u64, freq_u64};
    struct lockin_state lockin;
    int64_t outputs = 0;
    if (decimation < 2 || decimation > LOCKIN_MAX_DECIMATION) {
        return -1;
    }
    uint64_t normalise_q31 = (UINT64_C(4) << 31) / (decimation * decimation);
    struct lockin_cfg cfg = {decimation, normalise_q31 > INT32_MAX ? INT32_MAX : (int32_t)normalise_q31, lockin_reference_shift(decimation)};
    lockin_reset(&lockin);
    for (size_t i = 0; i < n; i++) {
        lockin_step(&lockin, pickoff_q31[i], lockin_reference(cfg.reference_shift, oscillator_phasor(oscillator_step(&oscillator))));
        if ((i + 1) % decimation == 0) {
            struct complex_q30 amplitude = lockin_output(&cfg, &lockin);
            in_phase_q30[outputs] = amplitude.i_q30;
            quadrature_q30[outputs] = amplitude.q_q30;
            outputs++;
        }
    }
    return outputs;
}

int64_t wg_decoupler_run(const int64_t *tuning, uint64_t freq_u64, int32_t decay_per_s_q22, int32_t bias_rad_s_q31,
                         const int32_t *primary_q31, int32_t *out_q31, size_t n)
{
    const struct decoupler_tuning constants = {
        (uint64_t)tuning[0], tuning[1], (int32_t)tuning[2], (int32_t)tuning[3], (int32_t)tuning[4], (int32_t)tuning[5],
    };
    struct decoupler_coefs coefs;
    struct decoupler_state state;
    int64_t clamped = 0;
    if (!decoupler_retune(&constants, freq_u64, decay_per_s_q22, bias_rad_s_q31, &coefs)) {
        return -1;
    }
    decoupler_reset(&state);
    for (size_t i = 0; i < n; i++) {
        bool overflow = false;
        out_q31[i] = decoupler_step(&coefs, &state, primary_q31[i], &overflow);
        clamped += overflow;
    }
    return clamped;
}

int64_t wg_output_filter_run(uint32_t choice, int32_t start, const int32_t *values, int32_t *out, size_t n)
{
    struct output_filter_state state;
    int64_t clamped = 0;
    output_filter_reset(&state, start);
    for (size_t i = 0; i < n; i++) {
        bool overflow = false;
        out[i] = output_filter_step(choice, &state, values[i], &overflow);
        clamped += overflow;
    }
    return clamped;
}

void wg_polar_eval(const int32_t *i_q30, const int32_t *q_q30, int32_t *magnitude_q30, int32_t *angle_i32, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        struct polar polar = polar_from_complex((struct complex_q30){i_q30[i], q_q30[i]});
        magnitude_q30[i] = polar.magnitude_q30;
        angle_i32[i] = polar.angle_i32;
    }
}

void wg_rate_ratio_eval(const int32_t *primary_i_q30, const int32_t *primary_q_q30, const int32_t *secondary_i_q30,
                        const int32_t *secondary_q_q30, int32_t *ratio_q29, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        bool overflow = false;
        struct complex_q30 primary = {primary_i_q30[i], primary_q_q30[i]}, secondary = {secondary_i_q30[i], secondary_q_q30[i]};
        ratio_q29[i] = rate_ratio_q29(primary, secondary, &overflow).in_phase_q29;
    }
}

uint32_t wg_crc32(const uint8_t *bytes, size_t n)
{
    return crc32_update(0, bytes, n);
}
