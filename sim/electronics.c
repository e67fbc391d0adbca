#include "sim/electronics.h"

void adc_init(const struct electronics_cfg *cfg, struct adc *adc)
{
    int64_t full_scale = INT64_C(1) << (cfg->adc_bits - 1);
    adc->codes_per_fs = pair_of((double)full_scale);
    adc->offset_codes = (pair){cfg->adc_offset_fs[0], cfg->adc_offset_fs[1]} * adc->codes_per_fs;
    adc->noise_codes = (pair){cfg->adc_noise_rms_fs[0], cfg->adc_noise_rms_fs[1]} * adc->codes_per_fs;
    adc->low_code = -full_scale;
    adc->high_code = full_scale - 1;
    adc->lowest_bits = ELECTRONICS_MAGIC_BITS - (uint64_t)full_scale;
    adc->code_span = 2 * (uint64_t)full_scale - 1;
}

void adc_set_gain(struct adc *adc, const double gain[2])
{
    adc->codes_per_fs = pair_of((double)-adc->low_code) * (pair){gain[0], gain[1]};
}

void dac_init(const struct electronics_cfg *cfg, struct dac *dac)
{
    int64_t full_scale = INT64_C(1) << (cfg->dac_bits - 1);
    dac->fs_per_code = pair_of(1.0 / (double)full_scale);
    dac->low_code = (int32_t)-full_scale;
    dac->high_code = (int32_t)(full_scale - 1);
}

int32_t adc_saturate(const struct adc *adc, double wanted_codes, uint64_t *saturated)
{
    (*saturated)++;
    return (int32_t)(wanted_codes > 0.0 ? adc->high_code : adc->low_code);
}
