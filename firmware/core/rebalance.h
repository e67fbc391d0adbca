/* Force-to-rebalance: two PI controllers null both parts of the secondary amplitude. The force that holds the in-phase part at zero is the
 * rate; the force that holds the other one is the quadrature. Runs once per loop tick.
 *
 * Envelope of the secondary (paper eq 3) with a force F exp(j phase), F = quadrature + j in_phase:
 *   A2' + A2 / tau = (g W / 2) A1 + (in_phase - j quadrature) b,   b = full-scale force / (2 w)
 * so the in-phase controller acts with a minus sign, the quadrature controller with a plus. */
#ifndef WINEGLASS_CORE_REBALANCE_H
#define WINEGLASS_CORE_REBALANCE_H

#include <stdbool.h>
#include <stdint.h>

#include "core/lockin.h"

struct rebalance_cfg {
    int32_t proportional_q16;       /* force (of full scale) per amplitude (of full scale) */
    int32_t integral_q24;           /* the same, per loop tick */
    int32_t in_phase_limit_q31;     /* limits of the two parts; the root of the sum of their squares is below 0.9999 */
    int32_t quadrature_limit_q31;
};

/* One controller. Range: |integral| <= 2^54 (force 1 in Q54). */
struct rebalance_axis {
    int64_t integral_q54;
    int32_t force_q31;
    bool saturated;
};

struct rebalance_state {
    struct rebalance_axis in_phase, quadrature;
};

void rebalance_reset(struct rebalance_state *state);

void rebalance_step(const struct rebalance_cfg *cfg, struct rebalance_state *state, struct complex_q30 secondary);

#endif
