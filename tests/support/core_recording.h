/* What a closed run of the gyro did at every sample, for references that are computed elsewhere (tests/python). */
#ifndef SUPPORT_CORE_RECORDING_H
#define SUPPORT_CORE_RECORDING_H

#include <stddef.h>
#include <stdint.h>

#include "support/gyro_fixture.h"

/* One sample: the codes that went in, the phase they were mixed with, and the state after the sample. */
struct recorded_sample {
    uint64_t freq_u64;          /* oscillator, from the next sample on */
    uint32_t phase_u32;         /* used in this sample */
    int32_t primary_q31, secondary_q31;
    int32_t bias_rad_s_q31, decay_per_s_q22; /* in force for the decoupler from the next sample on */
    int32_t rate_rad_s_q28;     /* published; new where slow_tick is set */
    uint32_t status;
    uint32_t slow_tick;
};

/* Runs `settle` samples and then records `count` more. Returns 0, or -1 when the gyro was not locked at the end of the settling. */
int core_record(const struct fixture_device *device, uint64_t seed, size_t settle, size_t count, struct recorded_sample *samples);

/* Decoupler from rest with given coefficients (gain, a1, a1 low, eps): rounded output and exact output before rounding (Q61). */
int core_decoupler(const int32_t coefs[5], const int32_t *primary_q31, size_t count, int32_t *out_q31, int64_t *out_q61);

/* Tuning of fixture_tuning(); returns 0 when refused. */
int core_retune(double sample_rate_hz, double center_freq_hz, double freq_hz, int32_t decay_per_s_q22, int32_t bias_rad_s_q31,
                int32_t coefs[5]);

/* Output filter settled at zero. */
void core_output_filter(uint32_t choice, const int32_t *values, size_t count, int32_t *out);

/* Thermal polynomial; returns how many values were clamped. */
size_t core_polynomial(const int32_t coef[6], uint32_t order, const int32_t *argument_q31, size_t count, int32_t *out);

#endif
