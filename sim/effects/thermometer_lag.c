/* The thermometer follows the shell late. */
#include <math.h>

#include "sim/effects/effect.h"

enum { ELEMENT, INPUT, STARTED };

/* One pole behind an input that runs straight over the block or step. */
static double follow(const double *values, double *state, const struct effect_context *now, double degc)
{
    if (state[STARTED] == 0.0) {
        state[ELEMENT] = state[INPUT] = degc;
        state[STARTED] = 1.0;
        return degc;
    }
    double kept = exp(-now->duration_s / values[0]);
    double slope = now->duration_s > 0.0 ? (degc - state[INPUT]) / now->duration_s : 0.0;
    double behind = slope * values[0];
    state[ELEMENT] = degc - behind + (state[ELEMENT] - state[INPUT] + behind) * kept;
    state[INPUT] = degc;
    return state[ELEMENT];
}

const struct effect effect_thermometer_lag = {
    .id = "thermometer_lag",
    .stage = EFFECT_STAGE_TEMPERATURE,
    .equation = "lag Tm' + Tm = T",
    .appearance = "drive frequency and bias lead the measured temperature; compensated bias of opposite sign on heating and cooling",
    .parameter = {
        {"lag_s", "s", EFFECT_STRENGTH, 0.0, 0.0, 1e5, 20.0, "a sensor on the base instead of the shell: a third of the shell's time constant"},
    },
    .thermometer = follow,
};
