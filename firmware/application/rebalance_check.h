/* Whether the rebalance loop is sound: gains, limits and scale factor are there, and the loop is stable with room to spare. */
#ifndef WINEGLASS_APPLICATION_REBALANCE_CHECK_H
#define WINEGLASS_APPLICATION_REBALANCE_CHECK_H

#include <stdbool.h>

#include "core/gyro.h"

/* The two parts of the rebalance force cannot leave 32 bit together. */
bool rebalance_limits_fit(const struct rebalance_cfg *rebalance);

/* Gains, limits and a positive scale factor are there. */
bool rebalance_is_described(const struct gyro_cfg *gyro);

/* At least 30 degrees of phase margin and 6 dB of gain margin, by a condition that suffices:
 *
 *   b Kp D <= 0.7   and   Ki/Kp <= b Kp / 4 + 1/tau
 *
 * b = scale coupling / 2, growth of the measured secondary amplitude per unit of force; D from motion to the middle of its force:
 * decimator N - 1, task slots 4, hold of a loop tick (N - 1) / 2, and the loop delay of ADC and DAC, in samples. b is the one at the calibration
 * temperature; it moves with 1/f only. tools/wineglass/rebalance.py has the same condition, and the margins themselves. */
bool rebalance_is_stable(const struct gyro_cfg *gyro);

#endif
