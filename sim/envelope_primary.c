/* The primary mode with its two loops over one step: amplitude under the AGC, phase under the PLL.
 *
 * Measurements are `delay` old when they act: x(t - delay) is taken as x - delay x', which is exact to first order in the frequency of
 * whatever happens and keeps the loops at two states each. */
#include <math.h>

#include "sim/envelope_internal.h"

#define LEAST_AMPLITUDE 1e-3   /* FS; below, the primary has no phase worth the name */
#define MAP_TOLERANCE   2e-3   /* of the loop gain, before a map is built again; the rest is a correction of the input */

/* ---- phase ------------------------------------------------------------------------------------------------------------- */

/* phi' = w - integral - Kp phi (t - delay), integral' = Ki phi; w counts from the tuning's centre. */
void envelope_pll_build(const struct envelope_firmware *firmware, double delay_s, struct envelope_maps *maps)
{
    double faster = 1.0 / (1.0 - firmware->pll_kp * delay_s);
    const struct linear_system system = {
        .states = 2, .inputs = 1,
        .m = {{-faster * firmware->pll_kp, -faster}, {firmware->pll_ki, 0.0}},
        .b = {{faster}, {0.0}},
    };
    linear_map_build(&system, maps->step_s, &maps->pll);
}

/* What pushes the primary sideways shifts its frequency: A1' = j shift a. */
static double frequency_shift(const struct envelope *e, const struct envelope_step *step)
{
    if (step->amplitude.mean < LEAST_AMPLITUDE) {
        return 0.0;
    }
    return (e->motion.coupling.im + step->middle.push[0][0] * step->level.mean * step->turn.im) / step->amplitude.mean;
}

static void run_phase(struct envelope *e, struct envelope_step *step)
{
    struct envelope_motion *motion = &e->motion;
    double state[2] = {motion->phi_rad - e->firmware.phase_set_point_rad, motion->integral_rad_s};
    double mean[2];
    step->shift_rad_s = frequency_shift(e, step);
    struct span natural =
        span_through(envelope_counted_rad_s(&motion->physics), envelope_counted_rad_s(&step->middle), envelope_counted_rad_s(&step->end));
    double above = step->shift_rad_s - e->firmware.center_rad_s;
    struct span wanted = {natural.start + above, natural.mean + above, natural.end + above};
    linear_map_step(&step->maps->pll, 2, 1, state, &wanted, mean);
    double phi_before = motion->phi_rad;
    motion->phi_rad = state[0] + e->firmware.phase_set_point_rad;
    motion->integral_rad_s = state[1];
    step->phi_mean = mean[0] + e->firmware.phase_set_point_rad;
    double published = natural.mean - e->sampled_late_s / step->step_s * (natural.end - natural.start);
    step->frequency_mean = published + step->shift_rad_s - (motion->phi_rad - phi_before) / step->step_s;
}

/* ---- amplitude --------------------------------------------------------------------------------------------------------- */

/* Gains of the loop at this instant, as force on the amplitude. */
struct gains {
    double push;                   /* FS/s per FS of force */
    double proportional, integral; /* 1/s, 1/s^2, from amplitude to amplitude */
};

static struct gains gains_of(const struct envelope *e, const struct envelope_step *step)
{
    double push = step->middle.push[0][0] * step->turn.re;
    double loop = push * step->middle.pickoff[0];
    return (struct gains){push, loop * e->firmware.agc_kp, loop * e->firmware.agc_ki};
}

/* With x = a - set point: x' = -l1 x - P x (t - delay) + w (t - delay) + input, w' = -I x, w the integral's push. */
static void build_drive(const struct envelope *e, const struct envelope_step *step, struct gains gains)
{
    struct envelope_maps *maps = step->maps;
    double delay = e->drive_delay_s;
    double faster = 1.0 / (1.0 - gains.proportional * delay);
    double decay = step->middle.decay[0];
    const struct linear_system system = {
        .states = 2, .inputs = 1,
        .m = {{-faster * (decay + gains.proportional - delay * gains.integral), faster}, {-gains.integral, 0.0}},
        .b = {{faster}, {0.0}},
    };
    linear_map_build(&system, step->step_s, &maps->drive);
    maps->drive_for.decay = decay;
    maps->drive_for.proportional = gains.proportional;
    maps->drive_for.integral = gains.integral;
}

static void refresh_drive(const struct envelope *e, const struct envelope_step *step, struct gains gains)
{
    const struct envelope_maps *maps = step->maps;
    double tolerance = MAP_TOLERANCE * fabs(gains.proportional);
    bool stale = !(fabs(gains.proportional - maps->drive_for.proportional) <= tolerance
                   && fabs(step->middle.decay[0] - maps->drive_for.decay) <= tolerance
                   && fabs(gains.integral - maps->drive_for.integral) <= MAP_TOLERANCE * fabs(gains.integral));
    if (stale) {
        build_drive(e, step, gains);
    }
}

/* The coupling's course is taken from its last two values. */
static struct span coupling_course(const struct envelope_motion *motion)
{
    double change = motion->coupling.re - motion->coupling_before.re;
    return (struct span){motion->coupling.re, motion->coupling.re + 0.5 * change, motion->coupling.re + change};
}

static bool within_limits(const struct envelope *e, struct span level)
{
    double most = e->firmware.drive_max_fs;
    return level.mean >= 0.0 && level.mean <= most && level.end >= 0.0 && level.end <= most;
}

static bool run_free(struct envelope *e, struct envelope_step *step, struct gains gains, double set_point)
{
    struct envelope_motion *motion = &e->motion;
    refresh_drive(e, step, gains);
    const struct envelope_maps *maps = step->maps;
    double decay = step->middle.decay[0];
    double x0 = motion->amplitude - set_point;
    double state[2] = {x0, motion->drive_integral * gains.push};
    double mean[2];
    struct span coupling = coupling_course(motion);
    double constant = -decay * set_point;
    double correction = (maps->drive_for.decay - decay) * x0 + constant;
    struct span input = {coupling.start + correction, coupling.mean + correction, coupling.end + correction};
    linear_map_step(&maps->drive, 2, 1, state, &input, mean);
    step->amplitude = (struct span){motion->amplitude, mean[0] + set_point, state[0] + set_point};
    double per_push = 1.0 / gains.push;
    double faster = 1.0 / (1.0 - gains.proportional * e->drive_delay_s);
    double slope_end = faster * (state[1] + coupling.end + constant
                                 - (decay + gains.proportional - e->drive_delay_s * gains.integral) * state[0]);
    step->level = (struct span){
        motion->level,
        per_push * ((state[0] - x0) / step->step_s + decay * step->amplitude.mean - coupling.mean),
        per_push * (slope_end + decay * step->amplitude.end - coupling.end),
    };
    motion->drive_integral = state[1] * per_push;
    return within_limits(e, step->level);
}

/* One loop tick of the firmware with its limits, anti-windup included. Returns the force. */
static double clamped_level(const struct envelope_firmware *firmware, double error_fs, double duration_s, double *integral)
{
    double most = firmware->drive_max_fs;
    double wanted = firmware->agc_kp * error_fs + *integral;
    bool held = (wanted > most && error_fs > 0.0) || (wanted < 0.0 && error_fs < 0.0);
    if (!held) {
        *integral = smaller(larger(*integral + firmware->agc_ki * error_fs * duration_s, 0.0), most);
    }
    return smaller(larger(wanted, 0.0), most);
}

/* A single slow tick, loop tick by loop tick, with the force at a limit for a part of it. A command of its beginning acts a little later. */
static void run_limited(struct envelope *e, struct envelope_step *step, struct gains gains)
{
    struct envelope_motion *motion = &e->motion;
    const struct envelope_firmware *firmware = &e->firmware;
    uint32_t parts = firmware->slow_samples / firmware->decimation;
    double part_s = firmware->tick_s;
    double decay = step->middle.decay[0];
    double waiting_s = motion->tick == motion->amplitude_command ? e->command_delay_s : 0.0;
    double a = motion->amplitude, level = motion->level, sum = 0.0, level_sum = 0.0;
    for (uint32_t i = 0; i < parts; i++) {
        double slope = gains.push * level + motion->coupling.re - decay * a;
        double error_fs = firmware->amplitude_fs - step->middle.pickoff[0] * (a + slope * (0.5 * part_s - e->drive_delay_s));
        double commanded = firmware->drive_off ? 0.0 : clamped_level(firmware, error_fs, part_s, &motion->drive_integral);
        double old = smaller(larger(waiting_s / part_s - i, 0.0), 1.0);
        double acting = commanded + old * (motion->level - commanded);
        double final = (gains.push * acting + motion->coupling.re) / decay;
        double next = final + (a - final) * (1.0 - decay * part_s * (1.0 - 0.5 * decay * part_s));
        sum += 0.5 * (a + next);
        level_sum += acting;
        level = commanded;
        a = next;
    }
    step->amplitude = (struct span){motion->amplitude, sum / parts, a};
    double mean = level_sum / parts;
    step->level = (struct span){2.0 * mean - level, mean, level};
}

static bool beyond_limits(const struct envelope *e, const struct envelope_step *step)
{
    const struct envelope_motion *motion = &e->motion;
    double error_fs = e->firmware.amplitude_fs - step->middle.pickoff[0] * motion->amplitude;
    double wanted = e->firmware.agc_kp * error_fs + motion->drive_integral;
    return wanted >= e->firmware.drive_max_fs || wanted <= 0.0;
}

/* Below half the set-point the rebalance loop opens. */
static bool passes_half(const struct envelope *e, const struct envelope_step *step)
{
    double half = 0.5 * e->firmware.amplitude_fs / step->middle.pickoff[0];
    return (step->amplitude.start > half) != (step->amplitude.end > half);
}

/* The drive is off: a' = -l1 a + coupling, its integral waits. */
static void run_ringing(struct envelope *e, struct envelope_step *step)
{
    struct envelope_motion *motion = &e->motion;
    double decay = step->middle.decay[0];
    double coupling = coupling_course(motion).mean;
    double left = exp(-decay * step->step_s);
    double end = motion->amplitude * left + coupling * (1.0 - left) / decay;
    double mean = (coupling - (end - motion->amplitude) / step->step_s) / decay;
    step->amplitude = (struct span){motion->amplitude, mean, end};
    step->level = span_of(0.0);
}

/* After a command a single tick is also done loop tick by loop tick. */
static bool run_controlled(struct envelope *e, struct envelope_step *step)
{
    bool commanded = step->maps == &e->single && e->motion.tick == e->motion.amplitude_command;
    if (e->firmware.drive_off && !commanded) {
        run_ringing(e, step);
        return step->maps == &e->single || !passes_half(e, step);
    }
    double integral = e->motion.drive_integral;
    struct gains gains = gains_of(e, step);
    bool single = step->maps == &e->single;
    bool limited = beyond_limits(e, step) || commanded;
    if (!limited && run_free(e, step, gains, e->firmware.amplitude_fs / step->middle.pickoff[0])) {
        return true;
    }
    if (single) {
        e->motion.drive_integral = integral;
        run_limited(e, step, gains);
    }
    return false;
}

/* Before the drive loop closes the shell only rings. */
static void run_silent(struct envelope *e, struct envelope_step *step)
{
    e->motion.phi_rad = 0.0;
    e->motion.integral_rad_s = envelope_counted_rad_s(&step->end) - e->firmware.center_rad_s;
    step->frequency_mean = e->firmware.center_rad_s;
    step->amplitude = step->level = span_of(0.0);
}

bool envelope_primary(struct envelope *e, struct envelope_step *step)
{
    struct envelope_motion *motion = &e->motion;
    bool free = true;
    step->psi_rad = step->middle.force_phase_rad + step->tables.drive_phase_rad - motion->phi_rad;
    step->turn = phasor_turn(step->psi_rad);
    if (motion->found) {
        free = run_controlled(e, step);
        run_phase(e, step);
    } else {
        run_silent(e, step);
    }
    motion->amplitude = step->amplitude.end;
    motion->level = step->level.end;
    return free;
}
