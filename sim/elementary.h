/* Exponential, logarithm, sine and cosine from additions and multiplications only, within a few units in the last place.
 *
 * The C library's versions choose their instructions by the machine they run on and differ in the last bit from one release to
 * the next; these give the same bits everywhere. Not meant for speed: noise tails, tables, once per block. */
#ifndef SIM_ELEMENTARY_H
#define SIM_ELEMENTARY_H

/* -700 <= x <= 700 */
double elementary_exp(double x);

/* Normal x > 0 */
double elementary_log(double x);

struct elementary_pair {
    double cosine, sine;
};

/* Angle in turns, |turns| < 2^50. */
struct elementary_pair elementary_cos_sin_turns(double turns);

#define ELEMENTARY_TWO_PI 6.283185307179586

#endif
