#include "float64_chain.h"

#include <math.h>

#define TURN 6.283185307179586

void float64_chain_init(struct float64_chain *chain, double freq_hz, double sample_rate_hz, double decay_per_s, double gain)
{
    double radius = exp(-decay_per_s / sample_rate_hz);
    *chain = (struct float64_chain){.step_rad = TURN * freq_hz / sample_rate_hz, .b0 = gain, .b2 = -gain * radius, .drive = {0.0, -0.5}};
    chain->a1 = 2.0 * radius * cos(chain->step_rad);
    chain->a2 = radius * radius;
}

static void integrate(double integral[2], double value)
{
    integral[0] += value;
    integral[1] += integral[0];
}

double float64_chain_step(struct float64_chain *chain, double primary, double secondary)
{
    chain->phase_rad += chain->step_rad;
    if (chain->phase_rad > TURN) {
        chain->phase_rad -= TURN;
    }
    double cosine = cos(chain->phase_rad), sine = sin(chain->phase_rad);
    double y = chain->b0 * primary + chain->b2 * chain->x2 + chain->a1 * chain->y1 - chain->a2 * chain->y2;
    chain->x2 = chain->x1;
    chain->x1 = primary;
    chain->y2 = chain->y1;
    chain->y1 = y;
    integrate(chain->integral[0], primary * cosine);
    integrate(chain->integral[1], -primary * sine);
    integrate(chain->integral[2], (secondary - y) * cosine);
    integrate(chain->integral[3], -(secondary - y) * sine);
    return chain->drive[0] * cosine + chain->drive[1] * sine;
}
