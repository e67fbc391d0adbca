/* The steady state of everything, to begin a run with. */
#include <math.h>

#include "sim/elementary.h"
#include "sim/envelope_internal.h"

#define ROUNDS 6 /* the couplings between the modes are small: each round gains at least a digit */

static struct phasor sense_of(const struct envelope_physics *physics)
{
    return phasor_scale(phasor_turn(-physics->sense_phase_rad), physics->pickoff[1]);
}

/* Level that holds the amplitude, and the frequency shift that goes with it. */
static double settle_drive(struct envelope *e, struct phasor turn)
{
    struct envelope_motion *motion = &e->motion;
    const struct envelope_physics *physics = &motion->physics;
    double push = physics->push[0][0];
    double level = (physics->decay[0] * motion->amplitude - motion->coupling.re) / (push * turn.re);
    motion->level = motion->drive_integral = fmin(fmax(level, 0.0), e->firmware.drive_max_fs);
    return (motion->coupling.im + push * motion->level * turn.im) / motion->amplitude;
}

static void settle_secondary(struct envelope *e, struct phasor turn, double shift_rad_s)
{
    struct envelope_motion *motion = &e->motion;
    const struct envelope_physics *physics = &motion->physics;
    struct phasor pole = {-physics->decay[1], physics->detuning_rad_s - shift_rad_s};
    struct phasor pushed = phasor_scale(turn, physics->push[1][0] * motion->level);
    struct phasor input = phasor_add(phasor_scale(physics->to_secondary, motion->amplitude), pushed);
    if (e->firmware.loop == GYRO_LOOP_OPEN) {
        motion->secondary = phasor_scale(phasor_divide(input, pole), -1.0);
        return;
    }
    struct phasor leak = phasor_scale(physics->feedthrough, motion->level);
    motion->secondary = phasor_scale(phasor_divide(leak, sense_of(physics)), -1.0);
    struct phasor held = phasor_add(input, phasor_product(pole, motion->secondary));
    struct phasor push = phasor_scale(turn, physics->push[1][1]);
    motion->rebalance = motion->rebalance_integral = phasor_divide(held, push);
}

static void settle_coupling(struct envelope *e, struct phasor turn)
{
    struct envelope_motion *motion = &e->motion;
    struct phasor pushed = phasor_scale(phasor_product(turn, motion->rebalance), -motion->physics.push[0][1]);
    motion->coupling = phasor_add(phasor_product(motion->physics.to_primary, motion->secondary), pushed);
    motion->coupling_before = motion->coupling;
}

/* The published rate before the filter, as envelope.c computes it, and what the two filters then hold. */
static void settle_output(struct envelope *e, struct phasor through)
{
    struct envelope_motion *motion = &e->motion;
    bool open = e->firmware.loop == GYRO_LOOP_OPEN;
    double bias = motion->tables.bias_rad_s;
    double scale = motion->tables.scale_rad_s / (motion->physics.pickoff[0] * motion->amplitude);
    struct phasor z2 = phasor_add(phasor_product(sense_of(&motion->physics), motion->secondary),
                                  phasor_scale(motion->physics.feedthrough, motion->level));
    double removed = 0.0;
    if (open && e->firmware.compensation == GYRO_COMPENSATION_G2) {
        motion->removed_rad_s = removed = bias;
        motion->decoupled = 0.5 * e->firmware.coupling_gain * motion->physics.pickoff[0] * bias * motion->amplitude
                            / motion->tables.decay_per_s;
        z2.re -= motion->decoupled;
    }
    struct phasor read = open ? phasor_product(z2, through) : motion->rebalance;
    double rate = read.re * scale;
    bool subtracts = e->firmware.compensation != GYRO_COMPENSATION_NONE && removed == 0.0;
    motion->last.ratio_re = read.re / (motion->physics.pickoff[0] * motion->amplitude);
    motion->last.ratio_im = read.im / (motion->physics.pickoff[0] * motion->amplitude);
    motion->last.rate = subtracts ? rate - bias : rate;
    motion->last.uncompensated = rate + removed;
    motion->last.rebalance_re = motion->rebalance.re;
    motion->last.rebalance_im = motion->rebalance.im;
    z2 = phasor_product(z2, through);
    motion->last.secondary_re = z2.re;
    motion->last.secondary_im = z2.im;
    envelope_filter_settle(e->firmware.output_filter, motion->last.rate, &motion->filter[0]);
    envelope_filter_settle(e->firmware.output_filter, motion->last.uncompensated, &motion->filter[1]);
}

void envelope_settle(struct envelope *e)
{
    struct envelope_motion *motion = &e->motion;
    double shift_rad_s = 0.0;
    struct phasor turn = phasor_turn(motion->physics.force_phase_rad + motion->tables.drive_phase_rad - e->firmware.phase_set_point_rad);
    motion->found = true;
    motion->phi_rad = e->firmware.phase_set_point_rad;
    motion->amplitude = e->firmware.amplitude_fs / motion->physics.pickoff[0];
    for (int i = 0; i < ROUNDS; i++) {
        shift_rad_s = settle_drive(e, turn);
        settle_secondary(e, turn, shift_rad_s);
        settle_coupling(e, turn);
    }
    motion->integral_rad_s = envelope_counted_rad_s(&motion->physics) + shift_rad_s - e->firmware.center_rad_s;
    settle_output(e, phasor_turn(motion->tables.demodulation_rad));
}
