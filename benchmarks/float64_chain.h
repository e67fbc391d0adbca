/* The sample path's arithmetic in double precision, for the comparison only: sine and cosine of the C library, a direct-form biquad, four mixers
 * with two integrators each, two forces. It does less than the firmware: no loops, no shaping, no monitors, no temperature. */
#ifndef WINEGLASS_BENCHMARKS_FLOAT64_CHAIN_H
#define WINEGLASS_BENCHMARKS_FLOAT64_CHAIN_H

struct float64_chain {
    double phase_rad, step_rad;
    double b0, b2, a1, a2, x1, x2, y1, y2;
    double integral[4][2];
    double drive[2];
};

void float64_chain_init(struct float64_chain *chain, double freq_hz, double sample_rate_hz, double decay_per_s, double gain);

/* Returns the drive force. */
double float64_chain_step(struct float64_chain *chain, double primary, double secondary);

#endif
