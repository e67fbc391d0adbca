/* Ranges that hold for a parameter wherever it comes from, calibration block or command. */
#ifndef WINEGLASS_APPLICATION_LIMITS_H
#define WINEGLASS_APPLICATION_LIMITS_H

#include <stdint.h>

/* Beyond 1/8 turn of frequency per turn of error and sample the loop, which runs every 8 samples or more, cannot be stable. */
#define PLL_PROPORTIONAL_MAX_Q32 (INT64_C(1) << 29)
#define PLL_INTEGRAL_MAX_Q32     (INT64_C(1) << 29)

#define AGC_PROPORTIONAL_MAX_Q16 (INT64_C(1000) << 16) /* full force for an error of 1/1000 of full scale */
#define AGC_INTEGRAL_MAX_Q24     (INT64_C(64) << 24)

#define REBALANCE_PROPORTIONAL_MAX_Q16 (INT64_C(32000) << 16) /* a shell of Q = 1e6 needs 17000 for 100 Hz */
#define REBALANCE_INTEGRAL_MAX_Q24     (INT64_C(64) << 24)

#define PHASE_SET_POINT_MAX_I32 (INT64_C(1) << 29) /* 45 degrees */

/* Phase calibration; times in means of 50 slow ticks. */
#define PHASE_SETTLE_MIN   2     /* a mean that began before the step, and one for the oscillator to follow */
#define PHASE_SETTLE_MAX   12000
#define PHASE_MEASURE_MAX  2000
#define PHASE_STEP_MIN_I32 (INT64_C(1) << 23) /* 0.012 rad */
#define PHASE_STEP_MAX_I32 (INT64_C(1) << 28) /* 0.39 rad: the drive level rises by 8 % */

/* An audio codec's filters take 12 samples in and 10 out. Beyond 64 samples the sum of all delays would leave rebalance_check.c's range. */
#define LOOP_DELAY_MAX_SAMPLES INT64_C(64)

#define AMPLITUDE_MIN_Q30 (INT64_C(1) << 25)  /* 1/32 of full scale: rate needs a primary above 1/64 */
#define AMPLITUDE_MAX_Q30 INT64_C(1052266988) /* 0.98: room for the overshoot */
#define DRIVE_MAX_Q31     INT64_C(2147268900) /* 0.9999: the force must not leave 32 bit, see core/gyro.c */

#endif
