/* The shell is not quite linear: its frequency depends on the square of the amplitude (Duffing). */
#include <math.h>

#include "sim/effects/effect.h"

static void apply(const double *values, const double *state, const struct effect_context *now, struct plant_parameters *p)
{
    (void)state;
    double change = 1e-6 * values[0] * pow(now->amplitude_fs, 2.0 + values[2]);
    double primary = 1.0 + change;
    double secondary = 1.0 + values[1] * change;
    p->resonator.stiffness[0] *= primary * primary;
    p->resonator.stiffness[1] *= secondary * secondary;
}

const struct effect effect_amplitude_frequency = {
    .id = "amplitude_frequency",
    .stage = EFFECT_STAGE_PRIMARY,
    .equation = "k1 -> k1 (1 + b a^(2 + p)), k2 -> k2 (1 + r b a^(2 + p)), a primary amplitude in FS",
    .appearance = "drive frequency at amplitude steps and in the ring-down; with r other than 1 a frequency split",
    .parameter = {
        {"frequency_ppm", "ppm at 1 FS", EFFECT_STRENGTH, 0.0, -500.0, 500.0, 2.0,
         "electrostatic softening and midplane stretching of micrometre amplitudes over millimetre shells"},
        {"on_secondary", "1", EFFECT_SHAPE, 1.0, -1.0, 3.0, 1.0,
         "1: the shell softens alike in all directions; 1/3 to 3 for a stretched one, after the phase of its motion"},
        {"power_beyond_square", "1", EFFECT_FORM, 0.0, -1.5, 6.0, 1.0, "gaps that close give a fourth power beside the square"},
    },
    .parameters = apply,
};
