/* Converters: what stands between displacement and code, and between code and force. */
#ifndef SIM_ELECTRONICS_H
#define SIM_ELECTRONICS_H

#include <math.h>
#include <stdint.h>

/* cdef begin */
/* Channel 0 is the primary pickoff or the drive, channel 1 the secondary pickoff or the rebalance force.
 * Noise rms from a signal-to-noise ratio: rms of a full-scale sine, sqrt(1/2), times 10^(-snr_db/20). */
struct electronics_cfg {
    uint32_t adc_bits;           /* 8..32; 16; 32 with zero noise = quantiser switched off */
    uint32_t dac_bits;           /* 8..32; 16; the firmware delivers codes of this width */
    double adc_noise_rms_fs[2];  /* FS rms; 2.236e-5 (90 dB); white Gaussian before quantisation */
    double adc_offset_fs[2];     /* FS; 0 */
    double adc_delay_samples;    /* samples, 0..7; 0; the code of instant t holds the displacement of t - delay */
    double dac_latency_samples;  /* samples, 0..7; 1; the code computed at sample n acts from n + latency for one sample */
};
/* cdef end */

struct adc_channel {
    double codes_per_fs;  /* 2^(bits-1) */
    double offset_codes;
    double low_code, high_code;
    double noise_codes;   /* rms */
};

/* Round to the nearest integer, ties to even; exact for |value| <= 2^51. Written out so that no compiler calls a function for it. */
static inline double round_to_even(double value)
{
    const double magic = 6755399441055744.0; /* 1.5 x 2^52 */
    return (value + magic) - magic;
}

/* One conversion. *saturated counts the codes that were clamped; what is not a number becomes the lowest code. */
static inline int32_t adc_convert(const struct adc_channel *adc, double displacement_fs, double noise, uint64_t *saturated)
{
    double wanted = displacement_fs * adc->codes_per_fs + (adc->offset_codes + noise * adc->noise_codes);
    double code = wanted > adc->low_code ? wanted : adc->low_code;
    code = code < adc->high_code ? code : adc->high_code;
    *saturated += code != wanted;
    return (int32_t)(int64_t)round_to_even(code);
}

/* Force as a fraction of full scale. Codes beyond the converter's width saturate. */
struct dac_channel {
    double fs_per_code;
    int32_t low_code, high_code;
};

static inline double dac_convert(const struct dac_channel *dac, int32_t code, uint64_t *saturated)
{
    int32_t clamped = code < dac->low_code ? dac->low_code : code;
    clamped = clamped > dac->high_code ? dac->high_code : clamped;
    *saturated += clamped != code;
    return clamped * dac->fs_per_code;
}

void adc_init(const struct electronics_cfg *cfg, int channel, struct adc_channel *adc);

void dac_init(const struct electronics_cfg *cfg, struct dac_channel *dac);

#endif
