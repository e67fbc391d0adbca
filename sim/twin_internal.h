/* The twin's own state, shared by the files that run, check and describe it. */
#ifndef SIM_TWIN_INTERNAL_H
#define SIM_TWIN_INTERNAL_H

#include "hal/host/wineglass_device.h"
#include "sim/effect_set.h"
#include "sim/noise.h"
#include "sim/sampling.h"
#include "sim/twin.h"

enum twin_stream { TWIN_STREAM_ADC_PRIMARY, TWIN_STREAM_ADC_SECONDARY, TWIN_STREAM_THERMOMETER, TWIN_STREAM_COUNT };

struct twin {
    struct twin_cfg cfg;
    struct wg_device *device;

    /* Set once. */
    struct resonator resonator;
    struct thermal_plan thermal_plan;
    struct sampling_plan sampling_plan;
    struct adc adc;
    struct dac dac;
    struct noise_table noise_table;

    /* Of the present block. */
    struct plant_parameters parameters;
    struct sampling_map map;
    double *noise[2]; /* block_samples Gaussian numbers per ADC channel */

    /* What changes with time. */
    struct thermal_point temperature;
    struct resonator_state motion;
    struct sampling_history history;
    struct noise_state stream[TWIN_STREAM_COUNT];
    struct effect_set effects;
    struct effect_context now; /* of the present block's middle */
    int32_t thermometer_code;
    int32_t dac_codes[2]; /* the device's last ones, while effects may lose samples */
    uint64_t sample;
    uint64_t adc_saturations, dac_saturations;
};

/* TWIN_OK or what is wrong. */
int32_t twin_check_cfg(const struct twin_cfg *cfg);
int32_t twin_check_profile(const struct twin *twin, const struct twin_profile *profile);

/* The plant under these circumstances, effects included. */
void twin_parameters_at(const struct twin *twin, const struct effect_context *now, double rate_rad_s, double rate_dot_rad_s2,
                        struct plant_parameters *parameters);

/* What effects may look at, `blocks` after the present block's beginning. */
struct effect_context twin_context(const struct twin *twin, double blocks);

/* Phase of the device's oscillator at the last sample, in turns. */
double twin_oscillator_turns(const struct twin *twin);
double twin_oscillator_hz(const struct twin *twin);

struct twin_phasor {
    double i, q;
};

/* Complex amplitude of one mode at the last sample: x = Re((i + j q) exp(j phase)). */
struct twin_phasor twin_phasor(const struct twin *twin, int mode);

#endif
