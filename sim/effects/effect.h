/* An effect: one way in which a real gyro differs from the nominal twin, as a record and a few functions. The same record serves the
 * sampled twin (firmware in the loop) and the envelope twin, alone and together with others. One file per effect in this folder;
 * the build finds it. docs/guides/add-an-effect.md shows how to write one.
 *
 * An effect whose strengths are all zero is not installed at all, so it costs nothing and changes no bit. */
#ifndef SIM_EFFECTS_EFFECT_H
#define SIM_EFFECTS_EFFECT_H

#include <stdbool.h>
#include <stdint.h>

#include "core/gyro.h"
#include "hal/host/wg_export.h"
#include "sim/plant_parameters.h"

/* cdef begin */
enum effect_limit { EFFECT_PARAMETERS = 24, EFFECT_PREPARED = 4, EFFECT_STATES = 8, EFFECT_SET = 16 };

enum effect_stage {
    EFFECT_STAGE_PRIMARY, EFFECT_STAGE_SECONDARY, EFFECT_STAGE_COUPLING, EFFECT_STAGE_ACTUATION, EFFECT_STAGE_PICKOFF,
    EFFECT_STAGE_CLOCK, EFFECT_STAGE_TEMPERATURE, EFFECT_STAGE_ENVIRONMENT, EFFECT_STAGE_FIRMWARE
};

enum effect_kind {
    EFFECT_SHAPE,    /* says how the effect acts; alone it changes nothing */
    EFFECT_STRENGTH, /* the effect is absent when all of these and all forms are zero */
    EFFECT_FORM      /* bends the law that the equation states; at zero it is as stated */
};

struct effect_parameter {
    const char *name;
    const char *unit;
    uint32_t kind;      /* enum effect_kind */
    double usual;       /* value of a shape that is not given; 0 for a strength or form */
    double low, high;   /* physical bound */
    double typical;     /* usual size in real devices, in magnitude */
    const char *source; /* where size and bound come from */
};

/* One effect switched on: its place in the list (effect_find) and its parameters in the record's order. */
struct effect_setting {
    uint32_t effect;
    uint32_t reserved;
    double value[24];
};
/* cdef end */

/* What a hook may look at. Times of a block (sampled twin) or a step (envelope twin). */
struct effect_context {
    double time_s;               /* since power-up, at the instant that is meant */
    double duration_s;           /* of the block or step */
    double rate_rad_s;           /* of the frame as its reference says, mean over the block or step */
    double shell_degc;           /* true temperature of the shell at that instant */
    double shell_slope_degc_s;
    double amplitude_fs;         /* of the primary, at the beginning of the block or step */
    double secondary_fs;         /* of the secondary, the same */
    double pickoff_noise_fs[2];  /* rms at both converters, as described */
    double reference_degc;       /* T0 of all polynomials */
    double velocity_scale_rad_s; /* nominal natural frequency k */
    double sample_rate_hz;       /* nominal */
    uint64_t seed;
};

struct effect {
    const char *id;
    uint32_t stage;               /* enum effect_stage */
    const char *equation;
    const char *appearance;       /* what it looks like, and in which channels */
    struct effect_parameter parameter[EFFECT_PARAMETERS];

    /* Hooks, each may be missing. `values` are the parameters, followed by EFFECT_PREPARED more that `prepare` may compute from them;
     * `state` is the effect's own memory, zero at power-up. */

    /* Once, when the effect is switched on. */
    void (*prepare)(double *values);

    /* Changes the plant's parameters. The state moves on by `advance`, never here: a hook may be asked twice about one step. */
    void (*parameters)(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p);

    /* Moves the state to the end of the block or step. */
    void (*advance)(const double *values, double *state, const struct effect_context *now);

    /* The temperature that the sensing element has, from the one it should have, at the end of the block or step. Called once. */
    double (*thermometer)(const double *values, double *state, const struct effect_context *now, double degc);

    /* The reading, from the sensing element's temperature with its noise. Envelope twin: the mean reading while the element goes evenly
     * from degc - spread/2 to degc + spread/2, over noise of that rms. Sampled twin: both are 0, noise is already added. */
    double (*reading)(const double *values, const struct effect_context *now, double degc, double spread_degc, double noise_degc);

    /* What the device computes with differs from what the calibration block says. Called once, at power-up. */
    void (*firmware)(const double *values, struct gyro_cfg *gyro);

    /* Sampled twin only: what stands at the ADC inputs at one sample, in FS; velocity_fs_s: of both modes then. */
    void (*pickoff)(const double *values, const struct effect_context *now, uint64_t sample, const double velocity_fs_s[2],
                    double displacement_fs[2]);

    /* How many of the samples first .. last the device does not get; below zero: gets twice. The sampled twin asks sample by sample. */
    int32_t (*lost)(const double *values, uint64_t first, uint64_t last);

    /* Envelope twin only: the change of parameters that is the same as `pickoff` averaged over the carrier. */
    void (*averaged)(const double *values, const struct effect_context *now, struct plant_parameters *p);
};

/* ---- for the effects' files -------------------------------------------------------------------------------------------- */

/* Shell's temperature from T0. */
static inline double effect_shift_degc(const struct effect_context *now)
{
    return now->shell_degc - now->reference_degc;
}

/* Since power-up. */
static inline double effect_hours(const struct effect_context *now)
{
    return now->time_s > 0.0 ? now->time_s / 3600.0 : 0.0;
}

/* Where one pole stands that was at `element`, `duration_s` after its input left `from` for `to` in a straight line. */
double effect_one_pole(double element, double from, double to, double duration_s, double lag_s);

/* Part of the block or step that lies between begin_s and begin_s + lasts_s: 0 to 1. */
double effect_part_within(const struct effect_context *now, double begin_s, double lasts_s);

/* A bias, as the rate that it looks like: cross damping, both ways. */
static inline void effect_add_bias(struct plant_parameters *p, double rate_rad_s)
{
    p->resonator.cross_damping_12 += p->resonator.angular_gain * rate_rad_s;
    p->resonator.cross_damping_21 += p->resonator.angular_gain * rate_rad_s;
}

/* A law over the temperature that is no polynomial: control points of a cubic B-spline every 10 degC from -50 to 120 degC, held beyond. So many parameters of
 * a record; `effect_curve` takes the place of the first. */
enum { EFFECT_KNOTS = 18 };
#define EFFECT_KNOT(degc, its_unit, most, usual_size)                                                                                                      \
    {"curve_" #degc "_degc", its_unit, EFFECT_FORM, 0.0, -(most), most, usual_size, "a law that is no polynomial: as large as its straight part"}
#define EFFECT_CURVE(its_unit, most, usual_size)                                                                                                           \
    EFFECT_KNOT(minus_50, its_unit, most, usual_size), EFFECT_KNOT(minus_40, its_unit, most, usual_size), EFFECT_KNOT(minus_30, its_unit, most, usual_size), \
    EFFECT_KNOT(minus_20, its_unit, most, usual_size), EFFECT_KNOT(minus_10, its_unit, most, usual_size), EFFECT_KNOT(0, its_unit, most, usual_size), \
    EFFECT_KNOT(10, its_unit, most, usual_size), EFFECT_KNOT(20, its_unit, most, usual_size), EFFECT_KNOT(30, its_unit, most, usual_size), \
    EFFECT_KNOT(40, its_unit, most, usual_size), EFFECT_KNOT(50, its_unit, most, usual_size), EFFECT_KNOT(60, its_unit, most, usual_size), \
    EFFECT_KNOT(70, its_unit, most, usual_size), EFFECT_KNOT(80, its_unit, most, usual_size), EFFECT_KNOT(90, its_unit, most, usual_size), \
    EFFECT_KNOT(100, its_unit, most, usual_size), EFFECT_KNOT(110, its_unit, most, usual_size), EFFECT_KNOT(120, its_unit, most, usual_size)

double effect_curve(const double *knots, const struct effect_context *now);

/* A standard Gaussian number for a place in time, the same in both twins whatever their steps are. */
double effect_noise(uint64_t seed, uint32_t stream, uint64_t place);

/* The list, in alphabetical order of ids; effect_list is made by the build from the files of this folder. */
extern const struct effect *const effect_list[];
extern const uint32_t effect_list_length;

#endif
