#include "sim/sampling.h"

#include <math.h>
#include <string.h>

void sampling_plan_init(double period_s, const struct sampling_delays *delays, struct sampling_plan *plan)
{
    plan->period_s = period_s;
    plan->latency_samples = (uint32_t)floor(delays->latency_samples);
    plan->latency_fraction = delays->latency_samples - floor(delays->latency_samples);
    plan->drive_feedthrough = delays->drive_feedthrough;
    plan->drive_edge_feedthrough = delays->drive_edge_feedthrough;
    plan->fractions = plan->latency_fraction != 0.0 || plan->drive_feedthrough != 0.0 || plan->drive_edge_feedthrough != 0.0;
    plan->delays = false;
    for (int channel = 0; channel < 2; channel++) {
        double delay = delays->pickoff_samples[channel];
        double whole = delay > 0.0 ? floor(delay) : 0.0;
        plan->delay_samples[channel] = (uint32_t)whole;
        plan->delay_fraction[channel] = delay - whole;
        plan->fractions = plan->fractions || plan->delay_fraction[channel] != 0.0;
        plan->delays = plan->delays || plan->delay_samples[channel] != 0;
    }
}

static void subtract(pair a[2][2], pair b[2][2], pair difference[2][2])
{
    for (int channel = 0; channel < 2; channel++) {
        for (int mode = 0; mode < 2; mode++) {
            difference[channel][mode] = a[channel][mode] - b[channel][mode];
        }
    }
}

/* The new force acts during the last (1 - fraction) of the interval, the old one before. */
static void split_force(const struct sampling_plan *plan, const struct resonator_coefs *coefs, double velocity_scale_rad_s,
                        struct sampling_map *map)
{
    struct resonator_map rest;
    resonator_map_over(coefs, velocity_scale_rad_s, (1.0 - plan->latency_fraction) * plan->period_s, &rest);
    memcpy(map->late, rest.input, sizeof map->late);
    subtract(map->whole.input, rest.input, map->early);
}

/* Backwards by the delay; when that reaches beyond the switching instant, the part before it saw the old force. */
static void look_back(const struct sampling_plan *plan, const struct resonator_coefs *coefs, double velocity_scale_rad_s, int mode,
                      struct sampling_view *view)
{
    struct resonator_map back;
    pair early[2][2] = {{{0.0, 0.0}}};
    resonator_map_over(coefs, velocity_scale_rad_s, -plan->delay_fraction[mode] * plan->period_s, &back);
    double beyond = plan->delay_fraction[mode] - (1.0 - plan->latency_fraction);
    if (beyond > 0.0) {
        struct resonator_map before;
        resonator_map_over(coefs, velocity_scale_rad_s, -beyond * plan->period_s, &before);
        memcpy(early, before.input, sizeof early);
        subtract(back.input, before.input, back.input);
    }
    for (int from = 0; from < 2; from++) {
        view->on_mode[from] = (pair){matrix4_get(&back.transition, 2 * mode, 2 * from),
                                     matrix4_get(&back.transition, 2 * mode, 2 * from + 1)};
    }
    view->late = (pair){back.input[0][mode][0], back.input[1][mode][0]};
    view->early = (pair){early[0][mode][0], early[1][mode][0]};
}

void sampling_map_at(const struct sampling_plan *plan, const struct resonator_coefs *coefs, double velocity_scale_rad_s,
                     struct sampling_map *map)
{
    resonator_map_over(coefs, velocity_scale_rad_s, plan->period_s, &map->whole);
    if (plan->fractions) {
        split_force(plan, coefs, velocity_scale_rad_s, map);
        look_back(plan, coefs, velocity_scale_rad_s, 0, &map->view[0]);
        look_back(plan, coefs, velocity_scale_rad_s, 1, &map->view[1]);
        map->view[1].late[0] += plan->drive_feedthrough + plan->drive_edge_feedthrough;
        map->view[1].early[0] -= plan->drive_edge_feedthrough;
    }
}
