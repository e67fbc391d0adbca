/* The envelope twin's own structures, shared by its files.
 *
 * All amplitudes are in the frame of the primary's own phase, in which the primary is a real number a:
 *
 *   a'  = -l1 a + Re(to_primary A2) + push11 level cos(psi)
 *   A2' = (-l2 + j (detuning - shift)) A2 + to_secondary a + push22 e^(j psi) (in_phase - j quadrature)
 *
 * with l = z k, psi = the forces' phase error, shift = what coupling and psi do to the primary's frequency. The firmware's oscillator runs
 * behind that frame by the angle phi of the phase loop, which turns what is measured and what is pushed. */
#ifndef SIM_ENVELOPE_INTERNAL_H
#define SIM_ENVELOPE_INTERNAL_H

#include "sim/effect_set.h"
#include "sim/envelope.h"
#include "sim/envelope_filter.h"
#include "sim/envelope_firmware.h"
#include "sim/linear_map.h"
#include "sim/phasor.h"
#include "sim/thermal.h"

struct phasor_span {
    struct span re, im;
};

static inline struct phasor phasor_span_mean(const struct phasor_span *s)
{
    return (struct phasor){s->re.mean, s->im.mean};
}

static inline struct phasor phasor_span_end(const struct phasor_span *s)
{
    return (struct phasor){s->re.end, s->im.end};
}

/* The plant at one instant. */
struct envelope_physics {
    double primary_rad_s;          /* natural frequency of the primary in the turning shell */
    double detuning_rad_s;         /* of the secondary above it */
    double decay[2];               /* l1, l2; 1/s */
    struct phasor to_primary;      /* 1/s */
    struct phasor to_secondary;
    double push[2][2];             /* FS/s of mode [.] per FS of channel [.] at the carrier */
    double pickoff[2];             /* gains */
    double force_phase_rad;        /* by which forces lead the velocity, firmware's correction left out */
    double sense_phase_rad;        /* by which the secondary pickoff lags the primary one */
    struct phasor feedthrough;     /* FS per FS of drive level, in the primary's frame */
    double tone_fs, tone_rad_s;    /* electrical tone on the secondary pickoff */
    double clock_ratio;
};

/* The firmware counts in samples: a clock that changes is a frequency that changes, and the loop has to follow it. */
static inline double envelope_counted_rad_s(const struct envelope_physics *physics)
{
    return physics->primary_rad_s * physics->clock_ratio;
}

/* What the firmware makes of the temperature at one instant. */
struct envelope_tables {
    double bias_rad_s, scale_rad_s, decay_per_s, demodulation_rad, drive_phase_rad;
};

enum envelope_channel {
    ENVELOPE_PRIMARY_I, ENVELOPE_PRIMARY_Q, ENVELOPE_SECONDARY_I, ENVELOPE_SECONDARY_Q, ENVELOPE_FREQUENCY, ENVELOPE_LEVEL,
    ENVELOPE_REBALANCE_I, ENVELOPE_REBALANCE_Q, ENVELOPE_TEMPERATURE, ENVELOPE_RATE, ENVELOPE_UNCOMPENSATED, ENVELOPE_QUADRATURE,
    ENVELOPE_SET_POINT, ENVELOPE_SHELL, ENVELOPE_CHANNELS
};

/* Ends of the step before, of what is published late and of what is filtered. */
struct envelope_last {
    double temperature, ratio_re, ratio_im, rate, uncompensated, rebalance_re, rebalance_im, secondary_re, secondary_im;
};

/* Everything that changes with time and can be put back when a step has to be done tick by tick. */
struct envelope_motion {
    struct thermal_point temperature;
    double sensed_degc;                      /* of the thermometer's element, effects included */
    double rate_rad_s;
    struct envelope_physics physics;
    struct envelope_tables tables;           /* at the published temperature; bias without compensation's delay for G2 */
    double amplitude, drive_integral, level; /* a, FS; FS of force */
    double phi_rad, integral_rad_s;          /* phase loop; frequency above the tuning's centre */
    struct phasor secondary;                 /* A2 */
    struct phasor rebalance_integral;        /* of K z2, FS of force */
    struct phasor rebalance;                 /* acting: -in_phase + j quadrature, in the primary's frame */
    struct phasor coupling;                  /* into the primary, at the last two ends */
    struct phasor coupling_before;
    double decoupled, removed_rad_s;         /* decoupler's output over e^(j phi); what it removes, as a rate */
    double tone_rad;                         /* phase of the electrical tone against the oscillator */
    struct envelope_filter_state filter[2];  /* compensated, uncompensated */
    struct envelope_last last;
    uint64_t tick;                           /* slow ticks done */
    uint64_t tone_start;                     /* tick of the last change of the test signal */
    uint64_t careful_until;                  /* single ticks before this one */
    uint64_t amplitude_command;              /* tick at whose beginning the set-point changed last, or the drive went on or off */
    uint64_t next_event;
    bool found;                              /* acquisition is over */
};

/* Maps for steps of one length, and the loop gains for which they hold. */
struct envelope_maps {
    double step_s;
    uint32_t ticks;
    struct thermal_plan thermal;
    struct linear_map pll, drive, rebalance;
    struct { double decay, proportional, integral; } drive_for;
    struct { struct phasor pole, proportional, integral; } rebalance_for;
    struct envelope_filter_map filter;
};

struct envelope {
    struct twin_cfg plant;
    struct envelope_cfg cfg;
    struct resonator resonator;
    struct envelope_firmware as_calibrated, firmware;
    struct effect_set effects, effects_saved;
    double carrier_gain;                     /* fundamental of a force held for a sample, over the force */
    double rebalance_delay_s, drive_delay_s, pll_delay_s;
    double command_delay_s;                  /* from the publication at which a command is taken over to the force */
    double amplitude_late_s, force_late_s, temperature_late_s; /* published means against the step's own time */
    double sampled_late_s;                   /* the same of what is sampled at publication: frequency, level */
    struct envelope_maps coarse, single;
    struct envelope_motion motion;
    const struct envelope_profile *profile;  /* during a run */
    uint64_t single_ticks;
};

/* One step's inputs, and what its parts hand on to each other. */
struct envelope_step {
    struct envelope_maps *maps;
    double step_s;
    struct span rate;
    double chamber_end_degc;

    struct envelope_physics middle, end;
    struct span temperature;                 /* published shift from T0 */
    struct span bias;
    struct envelope_tables tables;           /* at the end */
    double scale_mean, decay_mean, demodulation_mean;

    double psi_rad;                          /* phase error of the forces against the velocity, phi included */
    struct phasor turn;                      /* e^(j psi) */
    struct span amplitude, level;
    double shift_rad_s;
    double frequency_mean, phi_mean;
    struct phasor_span leak;                 /* on the secondary pickoff, over e^(j phi) */
    struct phasor_span test, secondary, measured, rebalance; /* measured: z2 over e^(j phi) */
    struct span removed;
    double shell_mean;
};

/* envelope_physics.c */
void envelope_physics_at(const struct envelope *e, const struct effect_context *now, double rate_rad_s, double rate_dot_rad_s2,
                         struct envelope_physics *physics);
struct envelope_tables envelope_tables_at(const struct envelope *e, double shift_degc);

/* envelope_primary.c; false: a limit was reached, the step must be done tick by tick */
void envelope_pll_build(const struct envelope_firmware *firmware, double delay_s, struct envelope_maps *maps);
bool envelope_primary(struct envelope *e, struct envelope_step *step);

/* envelope_secondary.c; the same */
bool envelope_secondary(struct envelope *e, struct envelope_step *step);

/* envelope_settle.c: the steady state under the first step's inputs */
void envelope_settle(struct envelope *e);

#endif
