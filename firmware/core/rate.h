/* Rate from the secondary amplitude relative to the primary: z2 conj(z1) / |z1|^2, times the scale factor. Using the primary as the
 * reference takes the drive loop's phase error and amplitude error out of the result. */
#ifndef WINEGLASS_CORE_RATE_H
#define WINEGLASS_CORE_RATE_H

#include <stdbool.h>
#include <stdint.h>

#include "core/lockin.h"

/* Secondary over primary, range +-4: the part in phase with the primary and the one 90 degrees ahead of it. Not valid, and zero, when |z1| is
 * below 2^-6. */
struct rate_ratio {
    int32_t in_phase_q29, quadrature_q29;
    bool valid;
};

struct rate_ratio rate_ratio_q29(struct complex_q30 primary, struct complex_q30 secondary, bool *overflow);

/* ratio times scale (rad/s per unit, Q28) -> rad/s in Q28. */
int32_t rate_scale_q28(int32_t ratio_q29, int32_t scale_rad_s_q28, bool *overflow);

/* One-pole image of what the decoupler removed, in rate units: tau x' + x = bias, with decay rate 1/tau. It gives the uncompensated rate while the
 * decoupler is on. */
struct rate_state {
    int64_t removed_rad_s_q46; /* |.| < 2^46 */
};

/* decay_per_tick_q31 = decay rate times the slow period. */
int32_t rate_removed_step_q28(struct rate_state *state, int32_t bias_rad_s_q31, int32_t decay_per_tick_q31);

#endif
