/* The thermometer follows the shell late. */
#include "sim/effects/effect.h"

enum { ELEMENT, INPUT, STARTED, SECOND };

static double follow(const double *values, double *state, const struct effect_context *now, double degc)
{
    if (state[STARTED] == 0.0) {
        state[ELEMENT] = state[SECOND] = state[INPUT] = degc;
        state[STARTED] = 1.0;
        return degc;
    }
    double before = state[ELEMENT];
    state[ELEMENT] = effect_one_pole(before, state[INPUT], degc, now->duration_s, values[0]);
    state[SECOND] = effect_one_pole(state[SECOND], before, state[ELEMENT], now->duration_s, values[1]);
    state[INPUT] = degc;
    return state[SECOND];
}

const struct effect effect_thermometer_lag = {
    .id = "thermometer_lag",
    .stage = EFFECT_STAGE_TEMPERATURE,
    .equation = "lag E' + E = T, second Tm' + Tm = E",
    .appearance = "drive frequency and bias lead the measured temperature; compensated bias of opposite sign on heating and cooling",
    .parameter = {
        {"lag_s", "s", EFFECT_STRENGTH, 0.0, 0.0, 1e5, 20.0, "a sensor on the base instead of the shell: a third of the shell's time constant"},
        {"second_lag_s", "s", EFFECT_FORM, 0.0, 0.0, 1e5, 10.0, "heat that goes through a layer: half the first"},
    },
    .thermometer = follow,
};
