/* The secondary mode over one step: free, or held at rest by the rebalance loop. */
#include <math.h>

#include "sim/envelope_internal.h"

#define MAP_TOLERANCE 2e-3 /* of the loop gain */
#define HELD_PARTS    5    /* pieces of a single tick while a rebalance force stands at its limit */

/* ---- what acts --------------------------------------------------------------------------------------------------------- */

static double clamp(double value, double limit)
{
    return smaller(larger(value, -limit), limit);
}

static double tone(const struct envelope *e, uint64_t tick)
{
    double turns = (double)(tick - e->motion.tone_start) * e->firmware.slow_s * e->firmware.test_hz;
    return cos(6.283185307179586 * (turns - floor(turns)));
}

/* in_phase - j quadrature of the test force. */
static void take_test(const struct envelope *e, struct envelope_step *step)
{
    const struct envelope_firmware *firmware = &e->firmware;
    double in_phase = clamp(firmware->test_in_phase_fs, firmware->in_phase_limit_fs);
    double quadrature = clamp(firmware->test_quadrature_fs, firmware->quadrature_limit_fs);
    struct span course = span_of(1.0);
    if (firmware->test_hz != 0.0) {
        double start = tone(e, e->motion.tick);
        double end = tone(e, e->motion.tick + step->maps->ticks);
        course = (struct span){start, 0.5 * (start + end), end};
    }
    step->test = (struct phasor_span){span_scale(course, in_phase), span_scale(course, -quadrature)};
}

static struct phasor acting(const struct envelope_physics *physics, struct phasor turn, double amplitude, double level,
                            struct phasor test)
{
    struct phasor pushed = {physics->push[1][0] * level + physics->push[1][1] * test.re, physics->push[1][1] * test.im};
    return phasor_add(phasor_scale(physics->to_secondary, amplitude), phasor_product(turn, pushed));
}

/* Everything but the secondary's own motion and the rebalance force. */
static struct phasor_span forcing(const struct envelope *e, const struct envelope_step *step)
{
    struct phasor first = {step->test.re.start, step->test.im.start};
    struct phasor between = {span_middle(step->test.re), span_middle(step->test.im)};
    struct phasor last = {step->test.re.end, step->test.im.end};
    struct phasor start = acting(&e->motion.physics, step->turn, step->amplitude.start, step->level.start, first);
    struct phasor middle =
        acting(&step->middle, step->turn, span_middle(step->amplitude), span_middle(step->level), between);
    struct phasor end = acting(&step->end, step->turn, step->amplitude.end, step->level.end, last);
    return (struct phasor_span){span_through(start.re, middle.re, end.re), span_through(start.im, middle.im, end.im)};
}

static struct phasor_span span_times(struct phasor factor, const struct phasor_span *x)
{
    return (struct phasor_span){
        span_subtract(span_scale(x->re, factor.re), span_scale(x->im, factor.im)),
        span_add(span_scale(x->re, factor.im), span_scale(x->im, factor.re)),
    };
}

static struct phasor_span phasor_span_add(const struct phasor_span *a, const struct phasor_span *b)
{
    return (struct phasor_span){span_add(a->re, b->re), span_add(a->im, b->im)};
}

static bool leaks(const struct envelope_step *step)
{
    return step->middle.feedthrough.re != 0.0 || step->middle.feedthrough.im != 0.0 || step->middle.tone_fs != 0.0;
}

/* An electrical tone turns against the oscillator. */
static struct phasor_span tone_course(struct envelope *e, const struct envelope_step *step)
{
    struct envelope_motion *motion = &e->motion;
    double angle = (step->middle.tone_rad_s - step->frequency_mean / step->middle.clock_ratio) * step->step_s;
    struct phasor start = phasor_scale(phasor_turn(motion->tone_rad), step->middle.tone_fs);
    struct phasor middle = phasor_scale(phasor_turn(motion->tone_rad + 0.5 * angle), step->middle.tone_fs);
    struct phasor end = phasor_scale(phasor_turn(motion->tone_rad + angle), step->middle.tone_fs);
    motion->tone_rad = remainder(motion->tone_rad + angle, 6.283185307179586);
    return (struct phasor_span){span_through(start.re, middle.re, end.re), span_through(start.im, middle.im, end.im)};
}

/* What gets into the pickoff besides motion: of the drive, of a tone. */
static void take_leak(struct envelope *e, struct envelope_step *step)
{
    const struct phasor by = step->middle.feedthrough;
    step->leak = (struct phasor_span){span_scale(step->level, by.re), span_scale(step->level, by.im)};
    if (step->middle.tone_fs != 0.0) {
        struct phasor_span tone = tone_course(e, step);
        step->leak = phasor_span_add(&step->leak, &tone);
    }
}

static struct phasor pole_of(const struct envelope_step *step)
{
    return (struct phasor){-step->middle.decay[1], step->middle.detuning_rad_s - step->shift_rad_s};
}

/* ---- free -------------------------------------------------------------------------------------------------------------- */

/* phi_k(z) = sum z^n / (n + k)!, k = 0 .. 4, phi_0 = e^z */
struct phi {
    struct phasor of[5];
};

static struct phi phi_of(struct phasor z)
{
    static const double inverse_factorial[17] = {
        1.0, 1.0, 1.0 / 2, 1.0 / 6, 1.0 / 24, 1.0 / 120, 1.0 / 720, 1.0 / 5040, 1.0 / 40320, 1.0 / 362880, 1.0 / 3628800,
        1.0 / 39916800, 1.0 / 479001600, 1.0 / 6227020800, 1.0 / 87178291200, 1.0 / 1307674368000, 1.0 / 20922789888000,
    };
    struct phi phi;
    int order = phasor_power(z) < 0.04 ? 6 : 12; /* remainders 0.2^7/11! = 3e-13, 1.5^13/17! = 5e-13 */
    struct phasor sum = {inverse_factorial[order + 4], 0.0};
    for (int n = order - 1; n >= 0; n--) {
        sum = phasor_product(sum, z);
        sum.re += inverse_factorial[n + 4];
    }
    phi.of[4] = sum;
    for (int k = 3; k >= 0; k--) {
        phi.of[k] = phasor_product(phi.of[k + 1], z);
        phi.of[k].re += inverse_factorial[k];
    }
    return phi;
}

/* x' = pole x + input, the input a parabola p0 + p1 s + p2 s^2. */
static struct phasor_span relax(struct phasor pole, double step_s, struct phasor x, const struct phasor_span *input)
{
    struct phi phi = phi_of(phasor_scale(pole, step_s));
    struct phasor p0 = {input->re.start, input->im.start};
    struct phasor p1 = {6.0 * input->re.mean - 4.0 * input->re.start - 2.0 * input->re.end,
                        6.0 * input->im.mean - 4.0 * input->im.start - 2.0 * input->im.end};
    struct phasor p2 = {6.0 * (input->re.start + input->re.end - 2.0 * input->re.mean),
                        6.0 * (input->im.start + input->im.end - 2.0 * input->im.mean)}; /* twice p2 */
    struct phasor end = phasor_product(phi.of[0], x);
    struct phasor mean = phasor_product(phi.of[1], x);
    struct phasor sum = phasor_add(phasor_product(phi.of[1], p0), phasor_product(phi.of[2], p1));
    end = phasor_add(end, phasor_scale(phasor_add(sum, phasor_product(phi.of[3], p2)), step_s));
    sum = phasor_add(phasor_product(phi.of[2], p0), phasor_product(phi.of[3], p1));
    mean = phasor_add(mean, phasor_scale(phasor_add(sum, phasor_product(phi.of[4], p2)), step_s));
    return (struct phasor_span){{x.re, mean.re, end.re}, {x.im, mean.im, end.im}};
}

/* The decoupler follows the primary with the calibrated decay rate; both its gain and its memory are real. The second part of the same
 * relaxation is what it removes as a rate. */
static void decouple(struct envelope *e, struct envelope_step *step)
{
    struct envelope_motion *motion = &e->motion;
    if (e->firmware.compensation != GYRO_COMPENSATION_G2 || !motion->found) {
        step->removed = span_of(0.0);
        return;
    }
    double decay = step->decay_mean;
    double gain = 0.5 * e->firmware.coupling_gain * step->middle.pickoff[0];
    struct phasor_span input = {span_product(span_scale(step->bias, gain), step->amplitude), span_scale(step->bias, decay)};
    struct phasor x = {motion->decoupled, motion->removed_rad_s};
    struct phasor_span followed = relax((struct phasor){-decay, 0.0}, step->step_s, x, &input);
    motion->decoupled = followed.re.end;
    motion->removed_rad_s = followed.im.end;
    step->measured.re = span_subtract(step->measured.re, followed.re);
    step->removed = followed.im;
}

/* ---- measured ---------------------------------------------------------------------------------------------------------- */

static double demodulation_rad(const struct envelope_step *step)
{
    return step->demodulation_mean;
}

static struct phasor sense(const struct envelope_step *step)
{
    return phasor_scale(phasor_turn(-step->middle.sense_phase_rad), step->middle.pickoff[1]);
}

/* Pickoff's gain and lag, leak; the demodulation phase turns all of it, the decoupler's part included. */
static void measure(struct envelope_step *step)
{
    step->measured = span_times(sense(step), &step->secondary);
    if (leaks(step)) {
        step->measured = phasor_span_add(&step->measured, &step->leak);
    }
}

static void demodulate(struct envelope_step *step)
{
    double angle = demodulation_rad(step);
    if (angle != 0.0) {
        step->measured = span_times(phasor_turn(angle), &step->measured);
    }
}

static bool run_open(struct envelope *e, struct envelope_step *step)
{
    struct envelope_motion *motion = &e->motion;
    struct phasor_span input = forcing(e, step);
    step->secondary = relax(pole_of(step), step->step_s, motion->secondary, &input);
    motion->secondary = phasor_span_end(&step->secondary);
    motion->rebalance_integral = motion->rebalance = (struct phasor){0.0, 0.0};
    step->rebalance = (struct phasor_span){span_of(0.0), span_of(0.0)};
    measure(step);
    decouple(e, step);
    demodulate(step);
    return true;
}

/* ---- rebalanced -------------------------------------------------------------------------------------------------------- */

struct loop {
    struct phasor push, per_push;         /* of the rebalance force, phase error included; FS/s per FS; and its reciprocal */
    struct phasor pole;                   /* of the free mode */
    struct phasor proportional, integral; /* of the loop, 1/s and 1/s^2 */
    struct phasor faster;                 /* 1 / (1 - proportional delay) */
    struct phasor inner;                  /* pole - proportional + delay integral */
};

static struct loop loop_of(const struct envelope *e, const struct envelope_step *step)
{
    struct phasor without_phi = phasor_product(step->turn, phasor_turn(e->motion.phi_rad));
    struct phasor through = phasor_product(sense(step), phasor_turn(demodulation_rad(step)));
    struct loop loop = {.push = phasor_scale(without_phi, step->middle.push[1][1]), .pole = pole_of(step)};
    struct phasor gain = phasor_product(loop.push, through);
    loop.per_push = phasor_divide((struct phasor){1.0, 0.0}, loop.push);
    double delay = e->rebalance_delay_s;
    loop.proportional = phasor_scale(gain, e->firmware.rebalance_kp);
    loop.integral = phasor_scale(gain, e->firmware.rebalance_ki);
    loop.faster = phasor_divide((struct phasor){1.0, 0.0},
                                (struct phasor){1.0 - delay * loop.proportional.re, -delay * loop.proportional.im});
    loop.inner = phasor_add(phasor_subtract(loop.pole, loop.proportional), phasor_scale(loop.integral, delay));
    return loop;
}

static void set_block(double m[LINEAR_STATES][LINEAR_STATES], int row, int column, struct phasor value)
{
    m[row][column] = m[row + 1][column + 1] = value.re;
    m[row][column + 1] = -value.im;
    m[row + 1][column] = value.im;
}

/* x' = faster (inner x - w + input), w' = integral x, w the integral's push. */
static void build_rebalance(const struct envelope_step *step, const struct loop *loop)
{
    struct linear_system system = {.states = 4, .inputs = 2};
    struct envelope_maps *maps = step->maps;
    set_block(system.m, 0, 0, phasor_product(loop->faster, loop->inner));
    set_block(system.m, 0, 2, phasor_scale(loop->faster, -1.0));
    set_block(system.m, 2, 0, loop->integral);
    system.b[0][0] = system.b[1][1] = loop->faster.re;
    system.b[0][1] = -loop->faster.im;
    system.b[1][0] = loop->faster.im;
    linear_map_build(&system, step->step_s, &maps->rebalance);
    maps->rebalance_for.pole = loop->pole;
    maps->rebalance_for.proportional = loop->proportional;
    maps->rebalance_for.integral = loop->integral;
}

static bool near(struct phasor a, struct phasor b, double tolerance)
{
    return phasor_power(phasor_subtract(a, b)) <= tolerance * tolerance;
}

static void refresh_rebalance(const struct envelope_step *step, const struct loop *loop)
{
    const struct envelope_maps *maps = step->maps;
    double tolerance = MAP_TOLERANCE * phasor_size(loop->proportional);
    bool sound = near(loop->proportional, maps->rebalance_for.proportional, tolerance)
                 && near(loop->pole, maps->rebalance_for.pole, tolerance)
                 && near(loop->integral, maps->rebalance_for.integral, MAP_TOLERANCE * phasor_size(loop->integral));
    if (!sound) {
        build_rebalance(step, loop);
    }
}

/* The leak reads as motion: x = A2 + leak over the pickoff's gain. */
static struct phasor_span leak_as_motion(const struct envelope_step *step)
{
    if (!leaks(step)) {
        return (struct phasor_span){span_of(0.0), span_of(0.0)};
    }
    return span_times(phasor_divide((struct phasor){1.0, 0.0}, sense(step)), &step->leak);
}

/* Input of the loop in terms of x: forcing - pole offset + offset'. */
static struct phasor_span loop_input(const struct envelope *e, const struct envelope_step *step, const struct loop *loop,
                                     const struct phasor_span *offset)
{
    struct phasor_span input = forcing(e, step);
    if (!leaks(step)) {
        return input;
    }
    struct phasor_span moved = span_times(phasor_scale(loop->pole, -1.0), offset);
    input = phasor_span_add(&input, &moved);
    double slope_re = (offset->re.end - offset->re.start) / step->step_s;
    double slope_im = (offset->im.end - offset->im.start) / step->step_s;
    input.re = span_add(input.re, span_of(slope_re));
    input.im = span_add(input.im, span_of(slope_im));
    return input;
}

static struct phasor_span add_constant(const struct phasor_span *x, struct phasor c)
{
    return (struct phasor_span){span_add(x->re, span_of(c.re)), span_add(x->im, span_of(c.im))};
}

static void run_loop(struct envelope *e, struct envelope_step *step, const struct loop *loop)
{
    struct envelope_motion *motion = &e->motion;
    refresh_rebalance(step, loop);
    struct phasor_span offset = leak_as_motion(step);
    struct phasor_span input = loop_input(e, step, loop, &offset);
    struct phasor x0 = {motion->secondary.re + offset.re.start, motion->secondary.im + offset.im.start};
    struct phasor w0 = phasor_product(loop->push, motion->rebalance_integral);
    struct phasor stale = phasor_product(phasor_subtract(loop->pole, step->maps->rebalance_for.pole), x0);
    struct phasor_span corrected = add_constant(&input, stale);
    double state[4] = {x0.re, x0.im, w0.re, w0.im};
    double mean[4];
    linear_map_step(&step->maps->rebalance, 4, 2, state, &corrected.re, mean);
    struct phasor x1 = {state[0], state[1]};
    struct phasor w1 = {state[2], state[3]};
    struct phasor x_mean = {mean[0], mean[1]};
    struct phasor change = phasor_scale(phasor_subtract(x1, x0), 1.0 / step->step_s);
    struct phasor pushed_mean =
        phasor_subtract(phasor_add(phasor_product(loop->pole, x_mean), phasor_span_mean(&input)), change);
    struct phasor sum = phasor_subtract(phasor_add(phasor_product(loop->inner, x1), phasor_span_end(&input)), w1);
    struct phasor pushed_end = phasor_subtract(phasor_add(phasor_product(loop->pole, x1), phasor_span_end(&input)),
                                               phasor_product(loop->faster, sum));
    struct phasor r_mean = phasor_product(pushed_mean, loop->per_push);
    struct phasor r_end = phasor_product(pushed_end, loop->per_push);
    step->rebalance = (struct phasor_span){{motion->rebalance.re, r_mean.re, r_end.re}, {motion->rebalance.im, r_mean.im, r_end.im}};
    step->secondary = (struct phasor_span){{motion->secondary.re, x_mean.re - offset.re.mean, x1.re - offset.re.end},
                                           {motion->secondary.im, x_mean.im - offset.im.mean, x1.im - offset.im.end}};
    motion->rebalance_integral = phasor_product(w1, loop->per_push);
}

static bool beyond(struct phasor force, struct phasor test, const struct envelope_firmware *firmware)
{
    double in_phase = firmware->in_phase_limit_fs;
    double quadrature = firmware->quadrature_limit_fs;
    return fabs(force.re) > in_phase || fabs(force.im) > quadrature || fabs(test.re - force.re) > in_phase
           || fabs(test.im - force.im) > quadrature;
}

/* One axis of the controller for a short while: force and integral, with the firmware's anti-windup. */
static double held_axis(const struct envelope_firmware *firmware, double error, double limit, double duration_s, double *integral)
{
    double wanted = firmware->rebalance_kp * error + *integral;
    bool held = (wanted > limit && error > 0.0) || (wanted < -limit && error < 0.0);
    if (!held) {
        *integral = clamp(*integral + firmware->rebalance_ki * error * duration_s, limit);
    }
    return clamp(wanted, limit);
}

/* A force at its limit: piece by piece, each with constant forces. */
static void run_held(struct envelope *e, struct envelope_step *step, const struct loop *loop)
{
    struct envelope_motion *motion = &e->motion;
    const struct envelope_firmware *firmware = &e->firmware;
    double part_s = step->step_s / HELD_PARTS;
    struct phasor_span input = forcing(e, step);
    struct phasor through = phasor_product(sense(step), phasor_turn(demodulation_rad(step)));
    struct phasor sum = {0.0, 0.0}, force_sum = {0.0, 0.0};
    struct phasor test = {step->test.re.mean, step->test.im.mean};
    struct phasor start = motion->secondary;
    struct phasor force = motion->rebalance;
    for (int i = 0; i < HELD_PARTS; i++) {
        struct phasor error = phasor_product(through, motion->secondary);
        force.re = held_axis(firmware, error.re, firmware->in_phase_limit_fs, part_s, &motion->rebalance_integral.re);
        force.im = held_axis(firmware, error.im, firmware->quadrature_limit_fs, part_s, &motion->rebalance_integral.im);
        struct phasor total = {clamp(test.re - force.re, firmware->in_phase_limit_fs) - test.re,
                               clamp(test.im - force.im, firmware->quadrature_limit_fs) - test.im};
        struct phasor constant = phasor_add(phasor_span_mean(&input), phasor_product(loop->push, total));
        struct phasor_span drive = {span_of(constant.re), span_of(constant.im)};
        struct phasor_span moved = relax(loop->pole, part_s, motion->secondary, &drive);
        sum = phasor_add(sum, phasor_span_mean(&moved));
        force_sum = phasor_add(force_sum, force);
        motion->secondary = phasor_span_end(&moved);
    }
    sum = phasor_scale(sum, 1.0 / HELD_PARTS);
    force_sum = phasor_scale(force_sum, 1.0 / HELD_PARTS);
    step->secondary = (struct phasor_span){{start.re, sum.re, motion->secondary.re}, {start.im, sum.im, motion->secondary.im}};
    step->rebalance = (struct phasor_span){{motion->rebalance.re, force_sum.re, force.re}, {motion->rebalance.im, force_sum.im, force.im}};
}

static struct phasor wanted_force(const struct envelope *e, const struct envelope_step *step)
{
    struct phasor through = phasor_product(sense(step), phasor_turn(demodulation_rad(step)));
    struct phasor error = phasor_product(through, e->motion.secondary);
    return phasor_add(phasor_scale(error, e->firmware.rebalance_kp), e->motion.rebalance_integral);
}

static bool run_rebalance(struct envelope *e, struct envelope_step *step)
{
    struct envelope_motion *motion = &e->motion;
    struct loop loop = loop_of(e, step);
    struct phasor test = {step->test.re.start, step->test.im.start};
    bool free = !beyond(wanted_force(e, step), test, &e->firmware);
    if (free) {
        run_loop(e, step, &loop);
        struct phasor test_end = {step->test.re.end, step->test.im.end};
        free = !beyond(phasor_span_end(&step->rebalance), test_end, &e->firmware)
               && !beyond(phasor_span_mean(&step->rebalance), test_end, &e->firmware);
    } else {
        run_held(e, step, &loop);
    }
    motion->secondary = phasor_span_end(&step->secondary);
    motion->rebalance = phasor_span_end(&step->rebalance);
    measure(step);
    demodulate(step);
    step->removed = span_of(0.0);
    return free;
}

/* ---- both -------------------------------------------------------------------------------------------------------------- */

static bool is_controlled(const struct envelope *e, const struct envelope_step *step)
{
    return e->firmware.loop == GYRO_LOOP_REBALANCE && e->motion.found
           && step->middle.pickoff[0] * step->amplitude.start > 0.5 * e->firmware.amplitude_fs;
}

static struct phasor coupling_of(const struct envelope_physics *physics, struct phasor turn, struct phasor secondary,
                                 struct phasor test, struct phasor rebalance)
{
    struct phasor pushed = phasor_scale(phasor_product(turn, phasor_subtract(test, rebalance)), physics->push[0][1]);
    return phasor_add(phasor_product(physics->to_primary, secondary), pushed);
}

/* What the secondary does to the primary, for the next step. The frequency, which the phase loop follows at once, has been computed with the
 * value at the step's beginning, and is put right here. */
static void couple(struct envelope *e, struct envelope_step *step)
{
    struct envelope_motion *motion = &e->motion;
    struct phasor mean = coupling_of(&step->middle, step->turn, phasor_span_mean(&step->secondary), phasor_span_mean(&step->test),
                                     phasor_span_mean(&step->rebalance));
    if (motion->found && motion->amplitude > 1e-3) {
        step->frequency_mean += (mean.im - motion->coupling.im) / step->amplitude.mean;
    }
    motion->coupling_before = motion->coupling;
    motion->coupling =
        coupling_of(&step->end, step->turn, motion->secondary, phasor_span_end(&step->test), motion->rebalance);
}

bool envelope_secondary(struct envelope *e, struct envelope_step *step)
{
    take_test(e, step);
    take_leak(e, step);
    bool free = is_controlled(e, step) ? run_rebalance(e, step) : run_open(e, step);
    couple(e, step);
    return free;
}
