/* The resonator between two conversions: one sample interval with the force switching where the DAC's latency puts it, and the
 * displacements as the pickoffs' delays see them. Exact for held forces; whole samples are delay lines, fractions are maps. */
#ifndef SIM_SAMPLING_H
#define SIM_SAMPLING_H

#include <stdbool.h>
#include <stdint.h>

#include "sim/resonator.h"

#define SAMPLING_HISTORY 64 /* more than the longest latency, 24 samples and what an effect adds, plus 2 */

/* What an effect may change from block to block; all in samples. */
struct sampling_delays {
    double latency_samples;     /* from conversion to force, at least 0 */
    double pickoff_samples[2];  /* from displacement to conversion, above -1: a lead sees the present force going on */
    double drive_feedthrough;   /* of the drive force that acts at the conversion, on the secondary pickoff; FS/FS */
    double drive_edge_feedthrough; /* of what that force is more than the one before; FS/FS */
};

/* Delays taken apart. */
struct sampling_plan {
    double period_s;
    uint32_t latency_samples;   /* whole part of the DAC latency */
    double latency_fraction;    /* 0 <= fraction < 1 */
    uint32_t delay_samples[2];  /* whole part of the pickoffs' delays */
    double delay_fraction[2];   /* the rest, below 1; negative: a lead */
    double drive_feedthrough, drive_edge_feedthrough;
    bool fractions;             /* the displacements need the views: any fraction, or a feedthrough */
    bool delays;                /* any whole sample of delay */
};

/* One displacement that was delay_fraction ago, from the state and the two forces of the interval. */
struct sampling_view {
    pair on_mode[2];
    pair late, early;
};

/* Set per block. */
struct sampling_map {
    struct resonator_map whole;
    pair late[2][2], early[2][2];   /* [channel][mode]: force after and before the DAC's switching instant */
    struct sampling_view view[2];   /* primary, secondary */
};

/* What the last samples left behind, at the sample's number modulo the length. */
struct sampling_history {
    pair force[SAMPLING_HISTORY];        /* as computed at that sample */
    pair displacement[SAMPLING_HISTORY]; /* as seen at that sample, before whole samples of delay */
};

void sampling_plan_init(double period_s, const struct sampling_delays *delays, struct sampling_plan *plan);

void sampling_map_at(const struct sampling_plan *plan, const struct resonator_coefs *coefs, double velocity_scale_rad_s,
                     struct sampling_map *map);

static inline pair sampling_past(const pair history[SAMPLING_HISTORY], uint64_t sample, uint32_t age)
{
    return history[(sample - age) % SAMPLING_HISTORY];
}

static inline double sampling_look(const struct sampling_view *view, const struct resonator_state *state, pair late, pair early)
{
    pair from_state = view->on_mode[0] * state->mode[0] + view->on_mode[1] * state->mode[1];
    pair from_force = view->late * late + view->early * early;
    return (from_state[0] + from_state[1]) + (from_force[0] + from_force[1]);
}

/* The interval that ends at `sample`, with fractions of a sample. */
static inline pair sampling_step_fractions(const struct sampling_plan *plan, const struct sampling_map *map,
                                           const struct sampling_history *history, uint64_t sample, double rate_rad_s,
                                           struct resonator_state *state)
{
    pair late = sampling_past(history->force, sample, plan->latency_samples + 1);
    pair early = sampling_past(history->force, sample, plan->latency_samples + 2);
    pair pushed[2];
    for (int mode = 0; mode < 2; mode++) {
        pushed[mode] = (map->late[0][mode] * pair_of(late[0]) + map->late[1][mode] * pair_of(late[1]))
                       + (map->early[0][mode] * pair_of(early[0]) + map->early[1][mode] * pair_of(early[1]));
    }
    resonator_turn(&map->whole, state, rate_rad_s, pushed);
    resonator_step(&map->whole, state, pushed);
    return (pair){sampling_look(&map->view[0], state, late, early), sampling_look(&map->view[1], state, late, early)};
}

/* Advance to `sample`; returns what the ADC converts there, primary and secondary displacement. rate_rad_s: of this interval beside the
 * map's; a constant 0 costs nothing. */
static inline pair sampling_step(const struct sampling_plan *plan, const struct sampling_map *map, struct sampling_history *history,
                                 uint64_t sample, double rate_rad_s, struct resonator_state *state)
{
    pair seen;
    if (plan->fractions) {
        seen = sampling_step_fractions(plan, map, history, sample, rate_rad_s, state);
    } else {
        pair pushed[2];
        resonator_push(&map->whole, sampling_past(history->force, sample, plan->latency_samples + 1), pushed);
        resonator_turn(&map->whole, state, rate_rad_s, pushed);
        resonator_step(&map->whole, state, pushed);
        seen = (pair){state->mode[0][0], state->mode[1][0]};
    }
    if (plan->delays) {
        history->displacement[sample % SAMPLING_HISTORY] = seen;
        seen = (pair){sampling_past(history->displacement, sample, plan->delay_samples[0])[0],
                      sampling_past(history->displacement, sample, plan->delay_samples[1])[1]};
    }
    return seen;
}

/* The forces computed at `sample`, as fractions of DAC full scale. */
static inline void sampling_push_force(struct sampling_history *history, uint64_t sample, pair force)
{
    history->force[sample % SAMPLING_HISTORY] = force;
}

#endif
