/* The two modes of the resonator, in double precision: what they are at a temperature and a rate, and their exact motion under
 * forces that are held over a sample.
 *
 *   x1'' + 2 z1 k1 x1' + (k1^2 - W^2) x1 + K12 x2 = q1 - g W x2' - (g/2) W' x2 + 2 z21 k2 x2'
 *   x2'' + 2 z2 k2 x2' + (k2^2 - W^2) x2 + K12 x1 = q2 + g W x1' + (g/2) W' x1 + 2 z12 k1 x1'
 *
 * (paper eqs 1, 2, 12 with g = 2 and unit coefficients of W^2 and W'). x1 primary, x2 secondary displacement in units of ADC full scale.
 * Sign convention: z12 > 0 pushes the secondary mode exactly as a positive rate does. */
#ifndef SIM_RESONATOR_H
#define SIM_RESONATOR_H

#include <stdbool.h>
#include <stdint.h>

#include "sim/matrix4.h"

/* cdef begin */
/* The device. Temperature shifts t are from reference_degc. */
struct resonator_cfg {
    double reference_degc;                    /* degC; 25; T0 of every polynomial below */
    double frequency_hz;                      /* Hz; 5000; mean of the two modes at T0 */
    double frequency_slope_ppm_per_degc;      /* ppm/degC; 0 */
    double frequency_curvature_ppm_per_degc2; /* ppm/degC^2; 0 */
    double quality_factor;                    /* 1; 1e4; Q = 1/(2 z) at T0 */
    double quality_slope_per_degc;            /* 1/degC; 0; relative to Q at T0, below the knee */
    double quality_knee_degc;                 /* degC; 1000; temperature (not shift) at which the slope changes */
    double quality_slope_above_per_degc;      /* 1/degC; 0; relative to Q at T0, above the knee */
    double decay_mismatch;                    /* 1; 0; difference of the two decay rates over their mean, along decay_axis_deg. Acts on
                                                 z1 and z2 only: its cross part belongs to bias_rad_s, which is the total */
    double decay_axis_deg;                    /* deg; 0; axis of the larger decay rate, mode space */
    double split_hz;                          /* Hz; 0; frequency of the stiff axis minus that of the soft axis */
    double split_slope_hz_per_degc;           /* Hz/degC; 0 */
    double split_axis_deg;                    /* deg; 0; stiff axis, mode space: 0 = primary stiffer, 45 = pure cross stiffness */
    double quadrature_rad_s;                  /* rad/s; 0; extra cross stiffness as the rate its force equals: K12 += g k quadrature */
    double angular_gain;                      /* 1; 2; g */
    double bias_rad_s[6];                     /* rad/s per degC^i; 0; total cross damping as rate: z12 = z21 = g bias(t) / (2 k) */
    double drive_force_fs_s2;                 /* FS/s^2; none; acceleration of the primary mode per full scale of the drive DAC */
    double rebalance_force_fs_s2;             /* FS/s^2; none; the same, secondary mode and rebalance DAC */
};
/* cdef end */

/* The equations' coefficients over one block of samples. An effect changes these before they become matrices. */
struct resonator_coefs {
    double stiffness[2];       /* k1^2, k2^2; rad^2/s^2 */
    double cross_stiffness;    /* K12; rad^2/s^2 */
    double damping[2];         /* 2 z1 k1, 2 z2 k2; 1/s */
    double cross_damping_12;   /* 2 z12 k1: force on mode 2 per x1'; 1/s */
    double cross_damping_21;   /* 2 z21 k2: force on mode 1 per x2'; 1/s */
    double angular_gain;       /* g */
    double rate_rad_s;         /* W */
    double rate_dot_rad_s2;    /* W' */
    double force[2][2];        /* FS/s^2 per DAC full scale: [mode][channel], channel 0 drive, 1 rebalance */
};

/* Per mode displacement and velocity over one fixed k, so that all four numbers are amplitudes. */
struct resonator_state {
    pair mode[2]; /* (x, x'/k), FS */
};

/* One held interval: state' = transition state + input force. */
struct resonator_map {
    struct matrix4 transition;
    pair input[2][2]; /* [channel][mode] per DAC full scale */
    pair turned[2];   /* what x, x'/k of mode 1 add to mode 2 per rad/s of rate beside the map's; mode 1 gets it from mode 2, negative */
};

/* A device with what follows from it once and for all. */
struct resonator {
    struct resonator_cfg cfg;
    double velocity_scale_rad_s; /* k of the scaled coordinates: the nominal frequency */
    double split_cosine, split_sine, decay_cosine; /* of twice the axis angles */
};

void resonator_init(const struct resonator_cfg *cfg, struct resonator *resonator);

/* True when the device can exist at this temperature: positive finite stiffness, and damping that only takes energy. */
bool resonator_is_passive(const struct resonator *resonator, double temperature_degc);

void resonator_coefs_at(const struct resonator *resonator, double temperature_degc, double rate_rad_s, double rate_dot_rad_s2,
                        struct resonator_coefs *coefs);

/* Exact map over duration_s of held force; a negative duration runs backwards. */
void resonator_map_over(const struct resonator_coefs *coefs, double velocity_scale_rad_s, double duration_s,
                        struct resonator_map *map);

/* Frequency at which x1 lags a force on mode 1 by exactly 90 degrees while mode 2 moves freely; rad/s. */
double resonator_quadrature_rad_s(const struct resonator_coefs *coefs);

/* What the held forces add over the interval. */
static inline void resonator_push(const struct resonator_map *map, pair force, pair pushed[2])
{
    for (int mode = 0; mode < 2; mode++) {
        pushed[mode] = map->input[0][mode] * pair_of(force[0]) + map->input[1][mode] * pair_of(force[1]);
    }
}

/* What a rate that differs by rate_rad_s from the map's adds over the interval: the derivative of the transition by the rate. */
static inline void resonator_turn(const struct resonator_map *map, const struct resonator_state *state, double rate_rad_s, pair pushed[2])
{
    if (rate_rad_s == 0.0) {
        return;
    }
    pair on_x = map->turned[0] * pair_of(rate_rad_s);
    pair on_v = map->turned[1] * pair_of(rate_rad_s);
    pushed[0] -= on_x * pair_of(state->mode[1][0]) + on_v * pair_of(state->mode[1][1]);
    pushed[1] += on_x * pair_of(state->mode[0][0]) + on_v * pair_of(state->mode[0][1]);
}

static inline void resonator_step(const struct resonator_map *map, struct resonator_state *state, const pair pushed[2])
{
    pair x1 = pair_of(state->mode[0][0]);
    pair v1 = pair_of(state->mode[0][1]);
    pair x2 = pair_of(state->mode[1][0]);
    pair v2 = pair_of(state->mode[1][1]);
    const pair (*column)[2] = map->transition.column;
    for (int mode = 0; mode < 2; mode++) {
        state->mode[mode] = ((column[0][mode] * x1 + pushed[mode]) + column[1][mode] * v1)
                            + (column[2][mode] * x2 + column[3][mode] * v2);
    }
}

#endif
