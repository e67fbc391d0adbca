#include "sim/envelope_firmware.h"

#include <math.h>

#define TWO_PI 6.283185307179586
#define TURN_I32 (TWO_PI * 0x1p-32)

static struct envelope_polynomial polynomial(const struct thermal_polynomial *fixed, int fraction_bits)
{
    struct envelope_polynomial result = {.order = fixed->order};
    for (uint32_t i = 0; i <= THERMAL_POLYNOMIAL_MAX_ORDER; i++) {
        result.coef[i] = ldexp(fixed->coef[i], -fraction_bits) / pow(THERMAL_POLYNOMIAL_SPAN_DEGC, i);
    }
    return result;
}

static void take_polynomials(const struct gyro_cfg *gyro, struct envelope_firmware *firmware)
{
    firmware->bias_rad_s = polynomial(&gyro->bias_rad_s_q31, 31);
    firmware->scale_rad_s = polynomial(&gyro->scale_rad_s_q28, 28);
    firmware->rebalance_scale_rad_s = polynomial(&gyro->rebalance_scale_rad_s_q28, 28);
    firmware->decay_per_s = polynomial(&gyro->decay_per_s_q22, 22);
    firmware->demodulation_rad = polynomial(&gyro->demodulation_phase_rad_q31, 31);
    firmware->drive_phase_rad = polynomial(&gyro->drive_phase_rad_q31, 31);
}

static void take_clock(const struct calibration *calibration, struct envelope_firmware *firmware)
{
    const struct gyro_cfg *gyro = &calibration->gyro;
    firmware->sample_s = 1000.0 / calibration->sample_rate_millihz;
    firmware->decimation = gyro->lockin.decimation;
    firmware->slow_samples = gyro->lockin.decimation * gyro->loops_per_slow;
    firmware->tick_s = firmware->sample_s * gyro->lockin.decimation;
    firmware->slow_s = firmware->sample_s * firmware->slow_samples;
    firmware->reference_degc = 1e-3 * calibration->reference_temperature_mdegc;
    firmware->shift_per_code_degc = ldexp(gyro->thermometer.gain_degc_q36, -36);
    firmware->shift_offset_raw = gyro->thermometer.offset_raw;
    firmware->center_rad_s = TWO_PI * ldexp((double)gyro->tuning.center_freq_u64, -64) / firmware->sample_s;
    firmware->coupling_gain = ldexp(gyro->tuning.coupling_gain_q44, -44) / firmware->sample_s;
    firmware->loop_delay_samples = ldexp(gyro->loop_delay_samples_q16, -16);
}

static void take_loops(const struct gyro_cfg *gyro, struct envelope_firmware *firmware)
{
    firmware->pll_kp = ldexp(gyro->drive.pll_proportional_q32, -32) / firmware->sample_s;
    firmware->pll_ki = ldexp(gyro->drive.pll_integral_q32, -32) / (firmware->sample_s * firmware->tick_s);
    firmware->phase_set_point_rad = TURN_I32 * gyro->drive.phase_set_point_i32;
    firmware->amplitude_fs = ldexp(gyro->drive.amplitude_q30, -30);
    firmware->agc_kp = ldexp(gyro->drive.agc_proportional_q16, -16);
    firmware->agc_ki = ldexp(gyro->drive.agc_integral_q24, -24) / firmware->tick_s;
    firmware->drive_max_fs = ldexp(gyro->drive.drive_max_q31, -31);
    firmware->rebalance_kp = ldexp(gyro->rebalance.proportional_q16, -16);
    firmware->rebalance_ki = ldexp(gyro->rebalance.integral_q24, -24) / firmware->tick_s;
    firmware->in_phase_limit_fs = ldexp(gyro->rebalance.in_phase_limit_q31, -31);
    firmware->quadrature_limit_fs = ldexp(gyro->rebalance.quadrature_limit_q31, -31);
    firmware->test_in_phase_fs = ldexp(gyro->test_signal.in_phase_q31, -31);
    firmware->test_quadrature_fs = ldexp(gyro->test_signal.quadrature_q31, -31);
    firmware->test_hz = ldexp(gyro->test_signal.freq_u32, -32) / firmware->tick_s;
}

/* One chirp, as a device in order needs. */
static void take_acquisition(const struct acquisition_cfg *cfg, struct envelope_firmware *firmware)
{
    double chirp_s = ldexp(firmware->tick_s, (int)cfg->chirp_ticks_log2);
    double listen_s = 2.0 * ldexp(firmware->tick_s, (int)cfg->listen_ticks_log2);
    double band_rad_s = TWO_PI * ldexp((double)(cfg->freq_end_u64 - cfg->freq_start_u64), -64) / firmware->sample_s;
    firmware->chirp_rad_s2 = band_rad_s / chirp_s;
    firmware->chirp_center_s = 0.5 * chirp_s;
    firmware->acquisition_s = chirp_s + firmware->tick_s * cfg->settle_ticks + listen_s;
}

void envelope_firmware_init(const struct calibration *calibration, struct envelope_firmware *firmware)
{
    *firmware = (struct envelope_firmware){
        .loop = calibration->gyro.loop,
        .compensation = calibration->gyro.compensation,
        .output_filter = calibration->gyro.output_filter,
    };
    take_clock(calibration, firmware);
    take_polynomials(&calibration->gyro, firmware);
    take_loops(&calibration->gyro, firmware);
    take_acquisition(&calibration->gyro.acquisition, firmware);
}
