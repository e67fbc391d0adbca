/* Everything about the plant that may differ from block to block, in one place: what the twins simulate with, and what effects change.
 * Both twins, the sampled one and the envelope, take the same structure. */
#ifndef SIM_PLANT_PARAMETERS_H
#define SIM_PLANT_PARAMETERS_H

#include "sim/resonator.h"

/* Channel 0 is the primary pickoff or the drive, channel 1 the secondary pickoff or the rebalance force. */
struct path_parameters {
    double pickoff_gain[2];        /* 1; displacement to ADC input */
    double pickoff_delay_s[2];     /* s; 0; beyond the electronics' own ADC delay */
    double force_delay_s;          /* s; 0; beyond the electronics' own DAC latency */
    double drive_feedthrough;      /* FS/FS; 0; drive DAC output on the secondary pickoff */
    double drive_edge_feedthrough; /* FS/FS; 0; its last step, as through a capacitance */
    double clock_ratio;            /* 1; true over nominal sample period */
    double tone_fs, tone_rad_s;    /* FS; 0; envelope twin only: electrical tone on the secondary pickoff, alias nearest the carrier */
};

struct plant_parameters {
    struct resonator_coefs resonator;
    struct path_parameters path;
};

static inline struct path_parameters path_nominal(void)
{
    return (struct path_parameters){.pickoff_gain = {1.0, 1.0}, .clock_ratio = 1.0};
}

#endif
