/* Chamber -> shell -> thermometer: two one-pole lags, exact for a chamber temperature that is linear within each block. */
#ifndef SIM_THERMAL_H
#define SIM_THERMAL_H

#include <stdbool.h>
#include <stdint.h>

/* cdef begin */
struct thermal_cfg {
    uint32_t shell_imposed;        /* 0/1; 0; 1: the profile's temperature is the shell's own, no chamber lag */
    uint32_t reserved;             /* 0 */
    double initial_degc;           /* degC; 25; chamber, shell and thermometer at the start, in equilibrium */
    double shell_time_constant_s;  /* s; 60; 0 = the shell follows at once */
    double thermometer_lag_s;      /* s; 0; thermometer behind the shell; 0 = none */
    double thermometer_offset_degc;/* degC; 0; temperature at code 0 */
    double thermometer_lsb_degc;   /* degC; 1/65536 (ideal); code = round((measured - offset) / lsb) */
    double thermometer_noise_degc; /* degC rms per reading; 0 */
};
/* cdef end */

/* Temperatures at one instant. */
struct thermal_point {
    double chamber_degc, shell_degc, thermometer_degc;
};

/* Response of both lags over a fixed time: deviations from the chamber that are kept, and those that a ramp of 1 degC/s adds. */
struct thermal_map {
    double duration_s;
    double shell_kept, shell_ramp;
    double thermometer_kept, thermometer_shell, thermometer_ramp;
};

struct thermal_plan {
    struct thermal_map half, whole; /* over half a block and a whole one */
    bool shell_follows, thermometer_follows; /* without any lag */
};

void thermal_init(const struct thermal_cfg *cfg, double block_s, struct thermal_plan *plan, struct thermal_point *now);

/* One block: the chamber runs linearly from now->chamber_degc to chamber_end_degc. *middle gets the temperatures at half time. */
void thermal_step(const struct thermal_plan *plan, struct thermal_point *now, double chamber_end_degc,
                  struct thermal_point *middle);

/* Thermometer code of a temperature, saturated to 32 bit without its lowest value (which means invalid). */
int32_t thermometer_code(const struct thermal_cfg *cfg, double measured_degc);

double thermometer_degc(const struct thermal_cfg *cfg, int32_t code);

#endif
