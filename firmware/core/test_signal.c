#include "core/test_signal.h"

#include "core/oscillator.h"

/* Range: |level| <= 2^31 times a cosine of at most 2^30 (1 + 3e-6), >> 30: levels are limited to 0.9999 when they are set. */
static int32_t modulate(int32_t level_q31, int32_t cosine_q30)
{
    return (int32_t)(((int64_t)level_q31 * cosine_q30) >> 30);
}

struct test_signal_force test_signal_step(const struct test_signal_cfg *cfg, struct test_signal_state *state)
{
    struct test_signal_force force = {cfg->in_phase_q31, cfg->quadrature_q31};
    if (cfg->freq_u32 == 0) {
        state->phase_u32 = 0;
        return force;
    }
    int32_t cosine_q30 = oscillator_phasor(state->phase_u32).cosine_q30;
    state->phase_u32 += cfg->freq_u32;
    force.in_phase_q31 = modulate(force.in_phase_q31, cosine_q30);
    force.quadrature_q31 = modulate(force.quadrature_q31, cosine_q30);
    return force;
}
