#include "application/rebalance_check.h"

#include "application/limits.h"

/* Range: squares below 2^62, their sum below 2^63. */
bool rebalance_limits_fit(const struct rebalance_cfg *rebalance)
{
    int64_t in_phase = rebalance->in_phase_limit_q31;
    int64_t quadrature = rebalance->quadrature_limit_q31;
    return in_phase * in_phase + quadrature * quadrature <= DRIVE_MAX_Q31 * DRIVE_MAX_Q31;
}

bool rebalance_is_described(const struct gyro_cfg *gyro)
{
    return gyro->rebalance.proportional_q16 > 0 && gyro->rebalance.in_phase_limit_q31 > 0 &&
           gyro->rebalance_scale_rad_s_q28.coef[0] > 0;
}

/* (N - 1) + 4 + (N - 1)/2 + loop delay. Range: N <= 32, loop delay < 64 samples: below 2^23. */
static int64_t delay_samples_q16(const struct gyro_cfg *gyro)
{
    return (3 * (int64_t)gyro->lockin.decimation + 5) * 32768 + gyro->loop_delay_samples_q16;
}

/* Crossover times sample period. b T = scale coupling / 2: Q28 Q44 -> Q40, below 2^29; times the gain < 2^31, Q56 -> Q40. */
static int64_t crossover_per_sample_q40(const struct gyro_cfg *gyro)
{
    int64_t growth_q40 = ((int64_t)gyro->rebalance_scale_rad_s_q28.coef[0] * gyro->tuning.coupling_gain_q44) >> 33;
    return (growth_q40 * gyro->rebalance.proportional_q16) >> 16;
}

/* Range: 0.7 2^56 over at least 2^19; once the first condition holds the crossover is below 0.05 in Q24, below 2^20; the decay rate
 * 2^31 2^31 >> 44 = 2^18; so the right side is below 2^21 2^31 2^5 = 2^57, the left 2^30 2^18. */
bool rebalance_is_stable(const struct gyro_cfg *gyro)
{
    int64_t crossover_q40 = crossover_per_sample_q40(gyro);
    if (crossover_q40 > (INT64_C(7) << 56) / 10 / delay_samples_q16(gyro)) {
        return false;
    }
    int64_t decay_q24 = ((int64_t)gyro->decay_per_s_q22.coef[0] * gyro->tuning.sample_period_q46) >> 44;
    int64_t allowed_q40 = ((crossover_q40 >> 16) + 4 * decay_q24) * gyro->rebalance.proportional_q16 * gyro->lockin.decimation;
    return ((int64_t)gyro->rebalance.integral_q24 << 18) <= allowed_q40;
}
