/* From the plant's parameters to the coefficients of the envelopes. */
#include <math.h>

#include "sim/elementary.h"
#include "sim/envelope_internal.h"

#define MOST_LOOP     0.6 /* proportional gain of the rebalance loop times its delay; with more it chatters */
#define LEAST_PICKOFF 0.3 /* gain of the secondary pickoff, below which that loop does not settle on what is read */

/* k^2 - W^2 of both modes: frequency of the primary, distance of the secondary (k2^2 - k1^2) / (2 k1), exact to second order where it
 * matters: the static answer of a mode that is far away. */
static void take_frequencies(const struct resonator_coefs *c, struct envelope_physics *physics)
{
    physics->primary_rad_s = sqrt(c->stiffness[0] - c->rate_rad_s * c->rate_rad_s);
    physics->detuning_rad_s = (c->stiffness[1] - c->stiffness[0]) / (2.0 * physics->primary_rad_s);
    physics->decay[0] = 0.5 * c->damping[0];
    physics->decay[1] = 0.5 * c->damping[1];
}

/* Forces at the carrier over 2 j w: a velocity's share stays real, a displacement's turns by -90 degrees. */
static void take_couplings(const struct resonator_coefs *c, double carrier_gain, struct envelope_physics *physics)
{
    double per_2w = 0.5 / physics->primary_rad_s;
    double coriolis = c->angular_gain * c->rate_rad_s;
    double euler = 0.5 * c->angular_gain * c->rate_dot_rad_s2;
    physics->to_secondary = (struct phasor){0.5 * (c->cross_damping_12 + coriolis), per_2w * (c->cross_stiffness - euler)};
    physics->to_primary = (struct phasor){0.5 * (c->cross_damping_21 - coriolis), per_2w * (c->cross_stiffness + euler)};
    for (int mode = 0; mode < 2; mode++) {
        for (int channel = 0; channel < 2; channel++) {
            physics->push[mode][channel] = c->force[mode][channel] * carrier_gain * per_2w;
        }
    }
}

/* The firmware sees the primary at phase phi, so the true primary leads by the way from displacement to code; a force commanded
 * with the calibrated lead arrives after DAC latency, half a held sample and the force's own delay. */
static void take_phases(const struct envelope *e, const struct path_parameters *path, struct envelope_physics *physics)
{
    const struct electronics_cfg *electronics = &e->plant.electronics;
    double w = physics->primary_rad_s;
    double sample_s = e->firmware.sample_s * path->clock_ratio;
    double spare_samples =
        e->firmware.loop_delay_samples - (electronics->dac_latency_samples + 0.5) - electronics->adc_delay_samples;
    physics->clock_ratio = path->clock_ratio;
    physics->pickoff[0] = path->pickoff_gain[0];
    physics->pickoff[1] = path->pickoff_gain[1];
    physics->force_phase_rad = w * (sample_s * spare_samples - path->force_delay_s - path->pickoff_delay_s[0]);
    double secondary_later_s = sample_s * electronics->adc_secondary_delay_samples + path->pickoff_delay_s[1] - path->pickoff_delay_s[0];
    physics->sense_phase_rad = w * secondary_later_s;
    physics->tone_fs = path->tone_fs;
    physics->tone_rad_s = path->tone_rad_s;
    physics->feedthrough = (struct phasor){0.0, 0.0};
    if (path->drive_feedthrough != 0.0 || path->drive_edge_feedthrough != 0.0) {
        double lead_samples = e->firmware.loop_delay_samples - electronics->dac_latency_samples - 1.0;
        struct phasor now = phasor_turn(0.25 * ELEMENTARY_TWO_PI + w * sample_s * lead_samples);
        struct phasor before = phasor_turn(0.25 * ELEMENTARY_TWO_PI + w * sample_s * (lead_samples - 1.0));
        physics->feedthrough = phasor_add(phasor_scale(now, path->drive_feedthrough + path->drive_edge_feedthrough),
                                          phasor_scale(before, -path->drive_edge_feedthrough));
    }
}

/* Under the rebalance loop the secondary rests at zero. Where a converter jumps there, its gain is many times the usual or the opposite of it, and the
 * loop chatters across the jump until it is blurred to a gain with which it can live: that is what slow signals meet. */
static void blur_jump(const struct envelope *e, struct envelope_physics *physics)
{
    if (e->firmware.loop != GYRO_LOOP_REBALANCE) {
        return;
    }
    double per_gain = fabs(e->firmware.rebalance_kp * physics->push[1][1]) * e->rebalance_delay_s;
    double most = per_gain > 0.0 ? larger(MOST_LOOP / per_gain, LEAST_PICKOFF) : INFINITY;
    physics->pickoff[1] = smaller(larger(physics->pickoff[1], LEAST_PICKOFF), most);
}

void envelope_physics_at(const struct envelope *e, const struct effect_context *now, double rate_rad_s, double rate_dot_rad_s2,
                         struct envelope_physics *physics)
{
    struct plant_parameters p;
    resonator_coefs_at(&e->resonator, now->shell_degc, rate_rad_s, rate_dot_rad_s2, &p.resonator);
    p.path = path_nominal();
    effect_set_parameters(&e->effects, now, &p);
    effect_set_averaged(&e->effects, now, &p);
    take_frequencies(&p.resonator, physics);
    take_couplings(&p.resonator, e->carrier_gain, physics);
    take_phases(e, &p.path, physics);
    blur_jump(e, physics);
}

struct envelope_tables envelope_tables_at(const struct envelope *e, double shift_degc)
{
    const struct envelope_firmware *firmware = &e->firmware;
    return (struct envelope_tables){
        .bias_rad_s = envelope_polynomial(&firmware->bias_rad_s, shift_degc),
        .scale_rad_s = envelope_polynomial(envelope_scale(firmware), shift_degc),
        .decay_per_s = envelope_polynomial(&firmware->decay_per_s, shift_degc),
        .demodulation_rad = envelope_polynomial(&firmware->demodulation_rad, shift_degc),
        .drive_phase_rad = envelope_polynomial(&firmware->drive_phase_rad, shift_degc),
    };
}
