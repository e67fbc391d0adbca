/* Test force on the secondary axis: a constant or a slow tone, in step with the Coriolis force (in phase) or with the displacement
 * (quadrature). Added to the rebalance force; used for scale-factor self-test, identification and phase calibration. */
#ifndef WINEGLASS_CORE_TEST_SIGNAL_H
#define WINEGLASS_CORE_TEST_SIGNAL_H

#include <stdint.h>

struct test_signal_cfg {
    int32_t in_phase_q31;   /* of rebalance full scale; zero: none */
    int32_t quadrature_q31;
    uint32_t freq_u32;      /* tone, turns per loop tick, 2^32 = one turn; zero: a constant (step) */
};

struct test_signal_state {
    uint32_t phase_u32;
};

struct test_signal_force {
    int32_t in_phase_q31, quadrature_q31;
};

/* Once per loop tick. A tone begins at its crest. */
struct test_signal_force test_signal_step(const struct test_signal_cfg *cfg, struct test_signal_state *state);

#endif
