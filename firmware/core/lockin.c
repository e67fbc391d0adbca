#include "core/lockin.h"

#include "core/fixed.h"

void lockin_reset(struct lockin_state *state)
{
    *state = (struct lockin_state){{0, 0, 0, 0}, {0, 0, 0, 0}};
}

/* Amplitude = 2 x mean; the products are Q29 and the filter's gain N^2, so Q30 = sum x 4 / N^2.
 * Range: |sum| <= 2^29 N^2 <= 2^39; (sum >> 4) normalise <= 2^25 N^2 2^33 / N^2 = 2^58. The result reaches 2^31 only for a full-scale input
 * beside an oscillator that stands still; it is clamped then. */
static int32_t cic_output(const struct lockin_cfg *cfg, struct cic_state *state)
{
    uint64_t first = state->integral2 - state->comb1;
    state->comb1 = state->integral2;
    uint64_t second = first - state->comb2;
    state->comb2 = first;
    int64_t sum = (int64_t)second;
    bool clamped = false;
    return fixed_saturate_i32(fixed_round_shift(fixed_round_shift(sum, 4) * cfg->normalise_q31, 27), &clamped);
}

struct complex_q30 lockin_output(const struct lockin_cfg *cfg, struct lockin_state *state)
{
    struct complex_q30 amplitude = {cic_output(cfg, &state->in_phase), cic_output(cfg, &state->quadrature)};
    return amplitude;
}
