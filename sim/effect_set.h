/* The effects that are switched on in one twin, and the places where a twin asks them. */
#ifndef SIM_EFFECT_SET_H
#define SIM_EFFECT_SET_H

#include "sim/effects/effect.h"

struct effect_active {
    const struct effect *effect;
    double value[EFFECT_PARAMETERS + EFFECT_PREPARED];
    double state[EFFECT_STATES];
};

struct effect_set {
    uint32_t count;
    bool parameters, advance, thermometer, reading, firmware, pickoff, lost, averaged; /* any effect has the hook */
    struct effect_active active[EFFECT_SET];
};

/* cdef begin */
/* The catalogue. */
WG_EXPORT uint32_t effect_count(void);

/* Place of an id in the list, or -1. */
WG_EXPORT int32_t effect_find(const char *id);

/* Texts and numbers of a record; NULL or 0 beyond the list. field: 0 id, 1 equation, 2 appearance. */
WG_EXPORT const char *effect_text(uint32_t effect, uint32_t field);
WG_EXPORT uint32_t effect_stage(uint32_t effect);
WG_EXPORT uint32_t effect_parameter_count(uint32_t effect);
WG_EXPORT const struct effect_parameter *effect_parameter(uint32_t effect, uint32_t index);
/* cdef end */

/* False, with an empty set, when an effect is unknown, a value lies outside its bound, or there are too many. */
bool effect_set_init(struct effect_set *set, const struct effect_setting *settings, uint32_t count);

void effect_set_reset(struct effect_set *set);

void effect_set_parameters(const struct effect_set *set, const struct effect_context *now, struct plant_parameters *p);

/* The carrier's averages, for the envelope twin; after effect_set_parameters. */
void effect_set_averaged(const struct effect_set *set, const struct effect_context *now, struct plant_parameters *p);

void effect_set_advance(struct effect_set *set, const struct effect_context *now);

double effect_set_thermometer(struct effect_set *set, const struct effect_context *now, double degc);

double effect_set_reading(const struct effect_set *set, const struct effect_context *now, double degc, double spread_degc, double noise_degc);

int32_t effect_set_lost(const struct effect_set *set, uint64_t first, uint64_t last);

void effect_set_firmware(const struct effect_set *set, struct gyro_cfg *gyro);

void effect_set_pickoff(const struct effect_set *set, const struct effect_context *now, uint64_t sample,
                        const double velocity_fs_s[2], double displacement_fs[2]);

#endif
