#include "sim/electronics.h"

void adc_init(const struct electronics_cfg *cfg, int channel, struct adc_channel *adc)
{
    adc->codes_per_fs = (double)(INT64_C(1) << (cfg->adc_bits - 1));
    adc->offset_codes = cfg->adc_offset_fs[channel] * adc->codes_per_fs;
    adc->low_code = -adc->codes_per_fs;
    adc->high_code = adc->codes_per_fs - 1.0;
    adc->noise_codes = cfg->adc_noise_rms_fs[channel] * adc->codes_per_fs;
}

void dac_init(const struct electronics_cfg *cfg, struct dac_channel *dac)
{
    int64_t full_scale = INT64_C(1) << (cfg->dac_bits - 1);
    dac->fs_per_code = 1.0 / (double)full_scale;
    dac->low_code = (int32_t)-full_scale;
    dac->high_code = (int32_t)(full_scale - 1);
}
