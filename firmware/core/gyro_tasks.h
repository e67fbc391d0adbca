/* The parts of gyro_step() that do not run at every sample. One task a sample; docs/DESIGN.md has the schedule. Internal to the core. */
#ifndef WINEGLASS_CORE_GYRO_TASKS_H
#define WINEGLASS_CORE_GYRO_TASKS_H

#include "core/fixed.h"
#include "core/gyro.h"

#define GYRO_LOOP_TASKS 3u /* slots 0 to 2 after every loop tick belong to the loops; those behind to the rate, once a slow period */

/* The last slot: the window of the lock-ins is full. Begins the next one. */
void gyro_loop_tick(const struct gyro_cfg *cfg, struct gyro_state *state);

/* Task of a slot < GYRO_LOOP_TASKS. */
void gyro_loop_task(const struct gyro_cfg *cfg, struct gyro_state *state, uint32_t slot);

/* Task of a later slot after the first loop tick of a slow period; true when `signals` has just been published. */
bool gyro_slow_task(const struct gyro_cfg *cfg, struct gyro_state *state, uint32_t slot, int32_t thermometer_raw);

/* Phasor of 90 degrees plus the loop delay and the phase correction, at the present frequency. */
struct phasor_q30 gyro_drive_lead(const struct gyro_cfg *cfg, const struct gyro_state *state);

bool gyro_amplitude_in_range(const struct gyro_cfg *cfg, const struct gyro_state *state);

/* The rebalance loops are closed: wanted, and there is a primary to refer to. */
bool gyro_secondary_is_controlled(const struct gyro_cfg *cfg, const struct gyro_state *state);

/* |a - b| / 2, which fits 32 bit. */
int32_t gyro_half_distance(int32_t a, int32_t b);

/* rad in Q31 -> 2^32 = one turn: divided by pi. Range: 2^31 / pi. */
static inline uint32_t gyro_turns_from_rad_q31(int32_t angle_rad_q31)
{
    return (uint32_t)fixed_mul_q31(angle_rad_q31, INT32_C(683565276));
}

#endif
