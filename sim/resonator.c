#include "sim/resonator.h"

#include <math.h>

#include "sim/elementary.h"
#include "sim/matrix4.h"

void resonator_init(const struct resonator_cfg *cfg, struct resonator *resonator)
{
    struct elementary_pair split = elementary_cos_sin_turns(cfg->split_axis_deg / 180.0);
    struct elementary_pair decay = elementary_cos_sin_turns(cfg->decay_axis_deg / 180.0);
    resonator->cfg = *cfg;
    resonator->velocity_scale_rad_s = ELEMENTARY_TWO_PI * cfg->frequency_hz;
    resonator->split_cosine = split.cosine;
    resonator->split_sine = split.sine;
    resonator->decay_cosine = decay.cosine;
}

static inline double frequency_hz(const struct resonator_cfg *cfg, double shift_degc)
{
    double ppm = shift_degc * (cfg->frequency_slope_ppm_per_degc + shift_degc * cfg->frequency_curvature_ppm_per_degc2);
    return cfg->frequency_hz * (1.0 + 1e-6 * ppm);
}

static inline double quality_factor(const struct resonator_cfg *cfg, double shift_degc)
{
    double knee = cfg->quality_knee_degc - cfg->reference_degc;
    double below = shift_degc < knee ? shift_degc : knee;
    double change = cfg->quality_slope_per_degc * below + cfg->quality_slope_above_per_degc * (shift_degc - below);
    return cfg->quality_factor * (1.0 + change);
}

static inline double bias_rad_s(const struct resonator_cfg *cfg, double shift_degc)
{
    double sum = cfg->bias_rad_s[5];
    for (int i = 4; i >= 0; i--) {
        sum = sum * shift_degc + cfg->bias_rad_s[i];
    }
    return sum;
}

/* k1^2 = k^2 + k D cos 2a, k2^2 = k^2 - k D cos 2a, K12 = k D sin 2a + g k quadrature; decay rates 2 z k = k / Q. */
void resonator_coefs_at(const struct resonator *resonator, double temperature_degc, double rate_rad_s, double rate_dot_rad_s2,
                        struct resonator_coefs *coefs)
{
    const struct resonator_cfg *cfg = &resonator->cfg;
    double shift = temperature_degc - cfg->reference_degc;
    double k = ELEMENTARY_TWO_PI * frequency_hz(cfg, shift);
    double split = ELEMENTARY_TWO_PI * (cfg->split_hz + cfg->split_slope_hz_per_degc * shift);
    double damping = k / quality_factor(cfg, shift);
    double mismatch = 0.5 * cfg->decay_mismatch * resonator->decay_cosine;
    double cross_damping = cfg->angular_gain * bias_rad_s(cfg, shift);
    *coefs = (struct resonator_coefs){
        .stiffness = {k * (k + split * resonator->split_cosine), k * (k - split * resonator->split_cosine)},
        .cross_stiffness = k * (split * resonator->split_sine + cfg->angular_gain * cfg->quadrature_rad_s),
        .damping = {damping * (1.0 + mismatch), damping * (1.0 - mismatch)},
        .cross_damping_12 = cross_damping,
        .cross_damping_21 = cross_damping,
        .angular_gain = cfg->angular_gain,
        .rate_rad_s = rate_rad_s,
        .rate_dot_rad_s2 = rate_dot_rad_s2,
        .force = {{cfg->drive_force_fs_s2, 0.0}, {0.0, cfg->rebalance_force_fs_s2}},
    };
}

/* The symmetric damping matrix must not be indefinite. Comparisons are written so that NaN fails them. */
bool resonator_is_passive(const struct resonator *resonator, double temperature_degc)
{
    struct resonator_coefs c;
    resonator_coefs_at(resonator, temperature_degc, 0.0, 0.0, &c);
    double cross = 0.5 * (c.cross_damping_12 + c.cross_damping_21);
    return c.stiffness[0] > 0.0 && c.stiffness[1] > 0.0 && isfinite(c.stiffness[0]) && isfinite(c.stiffness[1])
           && c.cross_stiffness * c.cross_stiffness < c.stiffness[0] * c.stiffness[1]
           && c.damping[0] >= 0.0 && c.damping[1] >= 0.0 && cross * cross <= c.damping[0] * c.damping[1];
}

/* y' = a y, y = (x1, x1'/k, x2, x2'/k), times the duration. */
static inline struct matrix4 scaled_motion(const struct resonator_coefs *c, double k, double duration_s)
{
    double centrifugal = c->rate_rad_s * c->rate_rad_s;
    double euler = 0.5 * c->angular_gain * c->rate_dot_rad_s2;
    double coriolis = c->angular_gain * c->rate_rad_s;
    pair per_k = pair_of(duration_s / k);
    pair duration = pair_of(duration_s);
    return (struct matrix4){{
        {(pair){0.0, centrifugal - c->stiffness[0]} * per_k, (pair){0.0, euler - c->cross_stiffness} * per_k},
        {(pair){k, -c->damping[0]} * duration, (pair){0.0, coriolis + c->cross_damping_12} * duration},
        {(pair){0.0, -euler - c->cross_stiffness} * per_k, (pair){0.0, centrifugal - c->stiffness[1]} * per_k},
        {(pair){0.0, c->cross_damping_21 - coriolis} * duration, (pair){k, -c->damping[1]} * duration},
    }};
}

/* d(transition)/d(rate): the integral of R(k (h - s)) (0 0; 0 g) R(k s) over the interval, R the rotation by k s in (x, x'/k). In closed form
 * (g/2)(h R(k h) - sin(k h)/k (1 0; 0 -1)); what damping, split and f(T) change in it is below 1e-3 of it. */
static void set_turned(double angular_gain, double k, double duration_s, struct resonator_map *map)
{
    struct elementary_pair angle = elementary_cos_sin_turns(k * duration_s / ELEMENTARY_TWO_PI);
    double half = 0.5 * angular_gain;
    double through = half * duration_s * angle.cosine;
    double across = half * duration_s * angle.sine;
    double standing = half * angle.sine / k;
    map->turned[0] = (pair){through - standing, -across};
    map->turned[1] = (pair){across, through + standing};
}

void resonator_map_over(const struct resonator_coefs *coefs, double velocity_scale_rad_s, double duration_s,
                        struct resonator_map *map)
{
    struct matrix4 phi1;
    struct matrix4 a = scaled_motion(coefs, velocity_scale_rad_s, duration_s);
    matrix4_exponential(&a, &map->transition, &phi1);
    for (int channel = 0; channel < 2; channel++) {
        pair on_primary = pair_of(coefs->force[0][channel] * (duration_s / velocity_scale_rad_s));
        pair on_secondary = pair_of(coefs->force[1][channel] * (duration_s / velocity_scale_rad_s));
        for (int mode = 0; mode < 2; mode++) {
            map->input[channel][mode] = phi1.column[1][mode] * on_primary + phi1.column[3][mode] * on_secondary;
        }
    }
    set_turned(coefs->angular_gain, velocity_scale_rad_s, duration_s, map);
}

/* Real part of q1 / x1 at w, times |D2|^2 > 0, with D_i = k_i^2 - W^2 - w^2 + j w 2 z_i k_i and mode 2 eliminated. */
static double in_phase_stiffness(const struct resonator_coefs *c, double w)
{
    double centrifugal = c->rate_rad_s * c->rate_rad_s;
    double euler = 0.5 * c->angular_gain * c->rate_dot_rad_s2;
    double coriolis = c->angular_gain * c->rate_rad_s;
    double d1 = c->stiffness[0] - centrifugal - w * w;
    double d2 = c->stiffness[1] - centrifugal - w * w;
    double d2_imaginary = w * c->damping[1];
    double to1 = -c->cross_stiffness - euler; /* force on 1 = (to1 + j w to1_v) x2 */
    double to1_v = w * (c->cross_damping_21 - coriolis);
    double to2 = -c->cross_stiffness + euler;
    double to2_v = w * (c->cross_damping_12 + coriolis);
    double loop = to1 * to2 - to1_v * to2_v;
    double loop_imaginary = to1 * to2_v + to1_v * to2;
    return d1 * (d2 * d2 + d2_imaginary * d2_imaginary) - (loop * d2 + loop_imaginary * d2_imaginary);
}

/* Secant steps from the uncoupled frequency. */
double resonator_quadrature_rad_s(const struct resonator_coefs *coefs)
{
    double w = sqrt(coefs->stiffness[0] - coefs->rate_rad_s * coefs->rate_rad_s);
    double previous = w - 0.01 * coefs->damping[0] - 1e-9 * w;
    double f_previous = in_phase_stiffness(coefs, previous);
    for (int i = 0; i < 50; i++) {
        double f = in_phase_stiffness(coefs, w);
        double change = f == f_previous ? 0.0 : f * (w - previous) / (f - f_previous);
        previous = w;
        f_previous = f;
        w -= change;
        if (fabs(change) < 1e-14 * w) {
            break;
        }
    }
    return w;
}
