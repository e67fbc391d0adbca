/* Converters: what stands between displacement and code, and between code and force. */
#ifndef SIM_ELECTRONICS_H
#define SIM_ELECTRONICS_H

#include <stdint.h>
#include <string.h>

#include "sim/pair.h"

/* cdef begin */
/* Channel 0 is the primary pickoff or the drive, channel 1 the secondary pickoff or the rebalance force.
 * Noise rms from a signal-to-noise ratio: rms of a full-scale sine, sqrt(1/2), times 10^(-snr_db/20). */
struct electronics_cfg {
    uint32_t adc_bits;           /* 8..32; 16; 32 with zero noise = quantiser switched off */
    uint32_t dac_bits;           /* 8..32; 16; the firmware delivers codes of this width */
    double adc_noise_rms_fs[2];  /* FS rms; 2.236e-5 (90 dB); white Gaussian before quantisation */
    double adc_offset_fs[2];     /* FS; 0 */
    double adc_delay_samples;    /* samples, 0..24; 0; the code of instant t holds the displacement of t - delay */
    double adc_secondary_delay_samples; /* samples, 0..24; 0; what the secondary channel is later than the primary */
    double dac_latency_samples;  /* samples, 0..24; 1; the code computed at sample n acts from n + latency for one sample */
};
/* cdef end */

/* Both pickoff channels, one per half of each pair. */
struct adc {
    pair codes_per_fs; /* 2^(bits-1) */
    pair offset_codes;
    pair noise_codes;  /* rms */
    int64_t low_code, high_code;
    uint64_t lowest_bits, code_span; /* representation of the lowest code after ELECTRONICS_MAGIC; high - low */
};

/* Both force channels. Forces are fractions of full scale. */
struct dac {
    pair fs_per_code;
    int32_t low_code, high_code;
};

void adc_init(const struct electronics_cfg *cfg, struct adc *adc);

/* Gains of what stands between displacement and converter; 1 after adc_init. */
void adc_set_gain(struct adc *adc, const double gain[2]);

void dac_init(const struct electronics_cfg *cfg, struct dac *dac);

/* 1.5 x 2^52: a double near it has the integer part as the low bits of its representation, rounded with ties to even. */
#define ELECTRONICS_MAGIC 6755399441055744.0
#define ELECTRONICS_MAGIC_BITS UINT64_C(0x4338000000000000)

/* Nearest integer, ties to even, |value| <= 2^51; the same on every machine and no call of a function. */
static inline double round_to_even(double value)
{
    return (value + ELECTRONICS_MAGIC) - ELECTRONICS_MAGIC;
}

/* Out of the converter's range, or not a number, which becomes the lowest code. */
int32_t adc_saturate(const struct adc *adc, double wanted_codes, uint64_t *saturated);

/* The low half of the representation is the code, as that of ELECTRONICS_MAGIC is zero. With a wanted value beyond 2^51 it is no integer
 * any more, but outside the range all the same: doubles of one sign are ordered as their representations are. */
static inline int32_t adc_round(const struct adc *adc, double shifted, double wanted_codes, uint64_t *saturated)
{
    uint64_t bits;
    memcpy(&bits, &shifted, sizeof bits);
    if (__builtin_expect(bits - adc->lowest_bits > adc->code_span, 0)) {
        return adc_saturate(adc, wanted_codes, saturated);
    }
    return (int32_t)(uint32_t)bits;
}

/* One conversion of both channels. noise: standard Gaussian numbers. *saturated counts the codes that were clamped. */
static inline void adc_convert(const struct adc *adc, pair displacement_fs, pair noise, int32_t code[2], uint64_t *saturated)
{
    pair wanted = displacement_fs * adc->codes_per_fs + (adc->offset_codes + noise * adc->noise_codes);
    pair shifted = wanted + pair_of(ELECTRONICS_MAGIC);
    code[0] = adc_round(adc, shifted[0], wanted[0], saturated);
    code[1] = adc_round(adc, shifted[1], wanted[1], saturated);
}

/* Codes beyond the converter's width saturate and are counted. */
static inline int32_t dac_clamp(const struct dac *dac, int32_t code, uint64_t *saturated)
{
    if (__builtin_expect(code < dac->low_code || code > dac->high_code, 0)) {
        (*saturated)++;
        return code < dac->low_code ? dac->low_code : dac->high_code;
    }
    return code;
}

static inline pair dac_convert(const struct dac *dac, const int32_t code[2], uint64_t *saturated)
{
    int32_t drive = dac_clamp(dac, code[0], saturated);
    int32_t rebalance = dac_clamp(dac, code[1], saturated);
    return (pair){drive, rebalance} * dac->fs_per_code;
}

#endif
