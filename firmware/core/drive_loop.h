/* Drive loop of the primary mode: a PLL that holds the force in step with the velocity (the 90 degree condition) and an AGC
 * that holds the amplitude. Runs once per loop tick, on the polar form of the primary amplitude. */
#ifndef WINEGLASS_CORE_DRIVE_LOOP_H
#define WINEGLASS_CORE_DRIVE_LOOP_H

#include <stdbool.h>
#include <stdint.h>

#include "core/polar.h"

struct drive_loop_cfg {
    uint32_t pll_proportional_q32; /* Kp T: turns per sample per turn of phase error; T sample period */
    uint32_t pll_integral_q32;     /* Ki T T_loop: the same, per loop tick */
    int32_t phase_set_point_i32;   /* angle of the primary amplitude that the PLL holds; 0 but for phase calibration */
    uint64_t freq_min_u64;         /* limits of the integrator, turns per sample */
    uint64_t freq_max_u64;
    int32_t amplitude_q30;         /* set-point, of ADC full scale */
    int32_t agc_proportional_q16;  /* force (of full scale) per amplitude (of full scale) */
    int32_t agc_integral_q24;      /* the same, per loop tick */
    int32_t drive_max_q31;         /* limit of the force, of DAC full scale */
    bool off;                      /* no force, the AGC's integral is held: a ring-down; the PLL goes on */
};

struct drive_loop_state {
    uint64_t freq_integral_u64;
    uint64_t freq_u64;          /* total frequency: integral and proportional part */
    int64_t drive_integral_q54;
    int32_t drive_q31;          /* force amplitude, 0 .. drive_max */
    int32_t phase_error_i32;    /* 2^32 = one turn; positive: resonance above the oscillator */
    int32_t amplitude_q30;      /* measured */
    bool saturated;             /* the force stood at its limit in this tick */
};

/* Start at a known frequency with the force at its limit's given fraction. */
void drive_loop_reset(struct drive_loop_state *state, uint64_t freq_u64, int32_t drive_q31);

void drive_loop_step(const struct drive_loop_cfg *cfg, struct drive_loop_state *state, struct polar primary);

/* Instead of a step, when there is nothing to hear: no force, frequency and integrals held. */
void drive_loop_hold(struct drive_loop_state *state, int32_t amplitude_q30);

#endif
