/* The resonator between two conversions: one sample interval with the force switching where the DAC's latency puts it, and the
 * displacement as the ADC's delay sees it. Exact for held forces; whole samples are delay lines, fractions are maps. */
#ifndef SIM_SAMPLING_H
#define SIM_SAMPLING_H

#include <stdbool.h>
#include <stdint.h>

#include "sim/resonator.h"

#define SAMPLING_HISTORY 16 /* more than the longest latency, 7 samples, plus 2 */

/* Set once. */
struct sampling_plan {
    double period_s;
    uint32_t latency_samples;   /* whole part of the DAC latency */
    double latency_fraction;    /* 0 <= fraction < 1 */
    uint32_t delay_samples;     /* whole part of the ADC delay */
    double delay_fraction;
    bool fractions;             /* any fraction is not zero */
};

/* One displacement that was delay_fraction ago, from the state and the two forces of the interval. */
struct sampling_view {
    pair on_mode[2];
    double late[2], early[2];
};

/* Set per block. */
struct sampling_map {
    struct resonator_map whole;
    pair late[2][2], early[2][2];   /* [channel][mode]: force after and before the DAC's switching instant */
    struct sampling_view view[2];   /* primary, secondary */
};

struct sampling_state {
    struct resonator_state resonator;
    double force[SAMPLING_HISTORY][2];        /* as computed at sample n, at n modulo the length */
    double displacement[SAMPLING_HISTORY][2]; /* as seen at sample n, before whole samples of delay */
};

void sampling_plan_init(double period_s, double adc_delay_samples, double dac_latency_samples, struct sampling_plan *plan);

void sampling_map_at(const struct sampling_plan *plan, const struct resonator_coefs *coefs, double velocity_scale_rad_s,
                     struct sampling_map *map);

static inline const double *sampling_past(const double history[SAMPLING_HISTORY][2], uint64_t sample, uint32_t age)
{
    return history[(sample - age) % SAMPLING_HISTORY];
}

/* The interval that ends at `sample`, with fractions of a sample; seen[] as the ADC finds it before whole samples of delay. */
void sampling_step_fractions(const struct sampling_plan *plan, const struct sampling_map *map, struct sampling_state *state,
                             uint64_t sample, double seen[2]);

/* Advance to `sample`; seen[] is what the ADC converts there. */
static inline void sampling_step(const struct sampling_plan *plan, const struct sampling_map *map, struct sampling_state *state,
                                 uint64_t sample, double seen[2])
{
    if (plan->fractions) {
        sampling_step_fractions(plan, map, state, sample, seen);
    } else {
        pair pushed[2];
        resonator_push(&map->whole, sampling_past(state->force, sample, plan->latency_samples + 1), pushed);
        resonator_step(&map->whole, &state->resonator, pushed);
        seen[0] = state->resonator.mode[0][0];
        seen[1] = state->resonator.mode[1][0];
    }
    if (plan->delay_samples != 0) {
        double *here = state->displacement[sample % SAMPLING_HISTORY];
        here[0] = seen[0];
        here[1] = seen[1];
        const double *past = sampling_past(state->displacement, sample, plan->delay_samples);
        seen[0] = past[0];
        seen[1] = past[1];
    }
}

/* The forces computed at `sample`, as fractions of DAC full scale. */
static inline void sampling_push_force(struct sampling_state *state, uint64_t sample, double drive, double rebalance)
{
    double *here = state->force[sample % SAMPLING_HISTORY];
    here[0] = drive;
    here[1] = rebalance;
}

#endif
