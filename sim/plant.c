/* The plant alone, for comparison with other integrators and for plants of others. */
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "sim/resonator.h"
#include "sim/twin.h"

/* Parameters and map of the block, recomputed only when a parameter changed. */
struct plant_block {
    struct resonator_coefs coefs;
    struct resonator_map map;
};

static void block_update(struct plant_block *block, const struct resonator *resonator, double period_s, double shell_degc,
                         double rate_rad_s, double rate_dot_rad_s2)
{
    struct resonator_coefs coefs;
    resonator_coefs_at(resonator, shell_degc, rate_rad_s, rate_dot_rad_s2, &coefs);
    if (memcmp(&coefs, &block->coefs, sizeof coefs) != 0) {
        block->coefs = coefs;
        resonator_map_over(&coefs, resonator->velocity_scale_rad_s, period_s, &block->map);
    }
}

static inline void unscale(const struct resonator_state *state, double velocity_scale_rad_s, double values[4])
{
    for (int mode = 0; mode < 2; mode++) {
        values[2 * mode] = state->mode[mode][0];
        values[2 * mode + 1] = state->mode[mode][1] * velocity_scale_rad_s;
    }
}

static void run_block(const struct resonator_map *map, double velocity_scale_rad_s, uint32_t n, const double *forces,
                      struct resonator_state *state, double *trajectory)
{
    struct resonator_state local = *state;
    for (uint32_t i = 0; i < n; i++) {
        pair pushed[2];
        resonator_push(map, forces ? (pair){forces[2 * i], forces[2 * i + 1]} : pair_of(0.0), pushed);
        resonator_step(map, &local, pushed);
        if (trajectory) {
            unscale(&local, velocity_scale_rad_s, trajectory + 4 * i);
        }
    }
    *state = local;
}

static bool all_finite(const double *values, uint64_t n)
{
    for (uint64_t i = 0; values && i < n; i++) {
        if (!isfinite(values[i])) {
            return false;
        }
    }
    return true;
}

static bool passive_everywhere(const struct resonator *resonator, const double *shell_degc, uint64_t n)
{
    for (uint64_t i = 0; shell_degc && i < n; i++) {
        if (!(shell_degc[i] == shell_degc[i > 0 ? i - 1 : 0] && i > 0) && !resonator_is_passive(resonator, shell_degc[i])) {
            return false;
        }
    }
    return true;
}

int32_t plant_run(const struct resonator_cfg *cfg, double sample_rate_hz, uint32_t block_samples, uint64_t n_blocks,
                  const double *shell_degc, const double *rate_rad_s, const double *rate_dot_rad_s2, const double *forces,
                  double *state, double *trajectory)
{
    struct resonator resonator;
    struct plant_block block;
    memset(&block, 0, sizeof block);
    resonator_init(cfg, &resonator);
    if (!(sample_rate_hz > 4.0 * cfg->frequency_hz) || !isfinite(sample_rate_hz) || block_samples == 0) {
        return TWIN_ERROR_SAMPLE_RATE;
    }
    if (!resonator_is_passive(&resonator, cfg->reference_degc)) {
        return TWIN_ERROR_RESONATOR;
    }
    if (!all_finite(shell_degc, n_blocks) || !all_finite(rate_rad_s, n_blocks) || !all_finite(rate_dot_rad_s2, n_blocks)
        || !passive_everywhere(&resonator, shell_degc, n_blocks)) {
        return TWIN_ERROR_PROFILE;
    }
    double k = resonator.velocity_scale_rad_s;
    struct resonator_state scaled = {{{state[0], state[1] / k}, {state[2], state[3] / k}}};
    for (uint64_t i = 0; i < n_blocks; i++) {
        block_update(&block, &resonator, 1.0 / sample_rate_hz, shell_degc ? shell_degc[i] : cfg->reference_degc,
                     rate_rad_s ? rate_rad_s[i] : 0.0, rate_dot_rad_s2 ? rate_dot_rad_s2[i] : 0.0);
        uint64_t first = i * block_samples;
        run_block(&block.map, k, block_samples, forces ? forces + 2 * first : NULL, &scaled,
                  trajectory ? trajectory + 4 * first : NULL);
    }
    unscale(&scaled, k, state);
    return TWIN_OK;
}
