#include "core/rebalance.h"

#include "core/fixed.h"

void rebalance_reset(struct rebalance_state *state)
{
    *state = (struct rebalance_state){{0, 0, false}, {0, 0, false}};
}

/* Range: |error| < 2^31 in Q30, gains < 2^31, so products fit 62 bit; the proportional part is bounded to 2^62. The integral moves only while the force is free or the error takes it back from its limit. */
static void axis_step(const struct rebalance_cfg *cfg, struct rebalance_axis *axis, int32_t error_q30, int32_t limit_q31)
{
    bool clamped = false;
    int64_t limit_q54 = (int64_t)limit_q31 << 23;
    int64_t wanted_q54 = fixed_proportional_q54(error_q30, cfg->proportional_q16) + axis->integral_q54;
    bool held_high = wanted_q54 > limit_q54 && error_q30 > 0;
    bool held_low = wanted_q54 < -limit_q54 && error_q30 < 0;
    if (!held_high && !held_low) {
        int64_t integral_q54 = axis->integral_q54 + (int64_t)error_q30 * cfg->integral_q24;
        axis->integral_q54 = fixed_clamp_i64(integral_q54, -limit_q54, limit_q54, &clamped);
    }
    axis->saturated = false;
    axis->force_q31 = (int32_t)(fixed_clamp_i64(wanted_q54, -limit_q54, limit_q54, &axis->saturated) >> 23);
}

void rebalance_step(const struct rebalance_cfg *cfg, struct rebalance_state *state, struct complex_q30 secondary)
{
    axis_step(cfg, &state->in_phase, fixed_error(0, secondary.i_q30), cfg->in_phase_limit_q31);
    axis_step(cfg, &state->quadrature, secondary.q_q30, cfg->quadrature_limit_q31);
}
