#include "sim/effect_set.h"

#include <math.h>
#include <string.h>

#include "sim/elementary.h"

_Static_assert(sizeof((struct effect_setting *)0)->value == EFFECT_PARAMETERS * sizeof(double), "one value per parameter");

/* ---- the catalogue ----------------------------------------------------------------------------------------------------- */

uint32_t effect_count(void)
{
    return effect_list_length;
}

int32_t effect_find(const char *id)
{
    for (uint32_t i = 0; id && i < effect_list_length; i++) {
        if (strcmp(effect_list[i]->id, id) == 0) {
            return (int32_t)i;
        }
    }
    return -1;
}

const char *effect_text(uint32_t effect, uint32_t field)
{
    if (effect >= effect_list_length || field > 2) {
        return NULL;
    }
    const struct effect *record = effect_list[effect];
    return field == 0 ? record->id : field == 1 ? record->equation : record->appearance;
}

uint32_t effect_stage(uint32_t effect)
{
    return effect < effect_list_length ? effect_list[effect]->stage : 0;
}

uint32_t effect_parameter_count(uint32_t effect)
{
    uint32_t count = 0;
    while (effect < effect_list_length && count < EFFECT_PARAMETERS && effect_list[effect]->parameter[count].name) {
        count++;
    }
    return count;
}

const struct effect_parameter *effect_parameter(uint32_t effect, uint32_t index)
{
    return index < effect_parameter_count(effect) ? &effect_list[effect]->parameter[index] : NULL;
}

/* ---- switching on ------------------------------------------------------------------------------------------------------ */

static bool setting_sound(const struct effect_setting *setting)
{
    if (setting->effect >= effect_list_length) {
        return false;
    }
    for (uint32_t i = 0; i < effect_parameter_count(setting->effect); i++) {
        const struct effect_parameter *parameter = effect_parameter(setting->effect, i);
        if (!(setting->value[i] >= parameter->low && setting->value[i] <= parameter->high)) {
            return false;
        }
    }
    return true;
}

static bool setting_acts(const struct effect_setting *setting)
{
    bool acts = false;
    for (uint32_t i = 0; i < effect_parameter_count(setting->effect); i++) {
        bool shape = effect_parameter(setting->effect, i)->kind == EFFECT_SHAPE;
        acts = acts || (!shape && setting->value[i] != 0.0);
    }
    return acts;
}

static void switch_on(struct effect_set *set, const struct effect_setting *setting)
{
    const struct effect *effect = effect_list[setting->effect];
    struct effect_active *active = &set->active[set->count++];
    active->effect = effect;
    memcpy(active->value, setting->value, sizeof setting->value);
    if (effect->prepare) {
        effect->prepare(active->value);
    }
    set->parameters = set->parameters || effect->parameters;
    set->advance = set->advance || effect->advance;
    set->thermometer = set->thermometer || effect->thermometer;
    set->reading = set->reading || effect->reading;
    set->firmware = set->firmware || effect->firmware;
    set->pickoff = set->pickoff || effect->pickoff;
    set->lost = set->lost || effect->lost;
    set->averaged = set->averaged || effect->averaged;
}

bool effect_set_init(struct effect_set *set, const struct effect_setting *settings, uint32_t count)
{
    memset(set, 0, sizeof *set);
    for (uint32_t i = 0; i < count; i++) {
        if (!setting_sound(&settings[i]) || set->count == EFFECT_SET) {
            memset(set, 0, sizeof *set);
            return false;
        }
        if (setting_acts(&settings[i])) {
            switch_on(set, &settings[i]);
        }
    }
    return true;
}

void effect_set_reset(struct effect_set *set)
{
    for (uint32_t i = 0; i < set->count; i++) {
        memset(set->active[i].state, 0, sizeof set->active[i].state);
    }
}

/* ---- asking ------------------------------------------------------------------------------------------------------------ */

void effect_set_parameters(const struct effect_set *set, const struct effect_context *now, struct plant_parameters *p)
{
    for (uint32_t i = 0; set->parameters && i < set->count; i++) {
        const struct effect_active *active = &set->active[i];
        if (active->effect->parameters) {
            active->effect->parameters(active->value, active->state, now, p);
        }
    }
}

void effect_set_averaged(const struct effect_set *set, const struct effect_context *now, struct plant_parameters *p)
{
    for (uint32_t i = 0; set->averaged && i < set->count; i++) {
        const struct effect_active *active = &set->active[i];
        if (active->effect->averaged) {
            active->effect->averaged(active->value, now, p);
        }
    }
}

void effect_set_advance(struct effect_set *set, const struct effect_context *now)
{
    for (uint32_t i = 0; set->advance && i < set->count; i++) {
        struct effect_active *active = &set->active[i];
        if (active->effect->advance) {
            active->effect->advance(active->value, active->state, now);
        }
    }
}

double effect_set_thermometer(struct effect_set *set, const struct effect_context *now, double degc)
{
    for (uint32_t i = 0; set->thermometer && i < set->count; i++) {
        struct effect_active *active = &set->active[i];
        if (active->effect->thermometer) {
            degc = active->effect->thermometer(active->value, active->state, now, degc);
        }
    }
    return degc;
}

double effect_set_reading(const struct effect_set *set, const struct effect_context *now, double degc, double spread_degc, double noise_degc)
{
    for (uint32_t i = 0; set->reading && i < set->count; i++) {
        const struct effect_active *active = &set->active[i];
        if (active->effect->reading) {
            degc = active->effect->reading(active->value, now, degc, spread_degc, noise_degc);
        }
    }
    return degc;
}

int32_t effect_set_lost(const struct effect_set *set, uint64_t first, uint64_t last)
{
    int32_t lost = 0;
    for (uint32_t i = 0; set->lost && i < set->count; i++) {
        const struct effect_active *active = &set->active[i];
        if (active->effect->lost) {
            lost += active->effect->lost(active->value, first, last);
        }
    }
    return lost;
}

void effect_set_firmware(const struct effect_set *set, struct gyro_cfg *gyro)
{
    for (uint32_t i = 0; set->firmware && i < set->count; i++) {
        const struct effect_active *active = &set->active[i];
        if (active->effect->firmware) {
            active->effect->firmware(active->value, gyro);
        }
    }
}

void effect_set_pickoff(const struct effect_set *set, const struct effect_context *now, uint64_t sample,
                        const double velocity_fs_s[2], double displacement_fs[2])
{
    for (uint32_t i = 0; i < set->count; i++) {
        const struct effect_active *active = &set->active[i];
        if (active->effect->pickoff) {
            active->effect->pickoff(active->value, now, sample, velocity_fs_s, displacement_fs);
        }
    }
}

/* ---- laws that several effects share ----------------------------------------------------------------------------------- */

double effect_one_pole(double element, double from, double to, double duration_s, double lag_s)
{
    if (lag_s <= 0.0) {
        return to;
    }
    double slope = duration_s > 0.0 ? (to - from) / duration_s : 0.0;
    double behind = slope * lag_s;
    return to - behind + (element - from + behind) * exp(-duration_s / lag_s);
}

double effect_part_within(const struct effect_context *now, double begin_s, double lasts_s)
{
    double from = now->time_s - 0.5 * now->duration_s, to = from + now->duration_s;
    double inside_s = fmin(to, begin_s + lasts_s) - fmax(from, begin_s);
    if (now->duration_s <= 0.0) {
        return now->time_s >= begin_s && now->time_s < begin_s + lasts_s ? 1.0 : 0.0;
    }
    return inside_s > 0.0 ? inside_s / now->duration_s : 0.0;
}

double effect_curve(const double *knots, const struct effect_context *now)
{
    double place = (now->shell_degc + 50.0) / 10.0;
    place = place < 0.0 ? 0.0 : place > EFFECT_KNOTS - 1 ? EFFECT_KNOTS - 1 : place;
    int here = place < EFFECT_KNOTS - 2 ? (int)place : EFFECT_KNOTS - 2;
    double x = place - here, y = 1.0 - x;
    double before = knots[here > 0 ? here - 1 : 0], after = knots[here < EFFECT_KNOTS - 2 ? here + 2 : EFFECT_KNOTS - 1];
    double near = knots[here] * (4.0 - x * x * (6.0 - 3.0 * x)) + knots[here + 1] * (4.0 - y * y * (6.0 - 3.0 * y));
    return (before * y * y * y + near + after * x * x * x) / 6.0;
}

/* ---- noise ------------------------------------------------------------------------------------------------------------- */

static uint64_t mix(uint64_t z)
{
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    return z ^ (z >> 31);
}

static double uniform(uint64_t bits)
{
    return ((double)(bits >> 11) + 0.5) * 0x1p-53;
}

/* Box and Muller, from two hashes of (seed, stream, place). */
double effect_noise(uint64_t seed, uint32_t stream, uint64_t place)
{
    const uint64_t golden = UINT64_C(0x9E3779B97F4A7C15);
    uint64_t key = mix(mix(seed + golden) ^ (stream * golden));
    double radius = sqrt(-2.0 * elementary_log(uniform(mix(key ^ (2 * place * golden)))));
    return radius * elementary_cos_sin_turns(uniform(mix(key ^ ((2 * place + 1) * golden)))).cosine;
}
