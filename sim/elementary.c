#include "sim/elementary.h"

#include <math.h>

static const double ln2_high = 0x1.62e42fefa38p-1; /* ln 2 to 39 bits: whole multiples up to 2^13 are exact */
static const double ln2_low = 0x1.ef35793c7673p-45;

/* 1/k! */
static const double exp_series[14] = {
    1.0, 1.0, 1.0 / 2, 1.0 / 6, 1.0 / 24, 1.0 / 120, 1.0 / 720, 1.0 / 5040, 1.0 / 40320, 1.0 / 362880, 1.0 / 3628800,
    1.0 / 39916800, 1.0 / 479001600, 1.0 / 6227020800,
};

/* x = n ln 2 + r, |r| <= 0.35: Taylor series of order 13, remainder 0.35^14 / 14! = 5e-18. */
double elementary_exp(double x)
{
    double n = floor(x * 1.4426950408889634 + 0.5);
    double r = (x - n * ln2_high) - n * ln2_low;
    double sum = exp_series[13];
    for (int order = 12; order >= 0; order--) {
        sum = exp_series[order] + sum * r;
    }
    return ldexp(sum, (int)n);
}

/* x = 2^n m, sqrt(1/2) <= m < sqrt(2), s = (m-1)/(m+1), |s| <= 0.172: ln m = 2 (s + s^3/3 + ... ) up to s^21,
 * remainder 0.172^23 / 23 = 1e-19. */
double elementary_log(double x)
{
    int exponent;
    double mantissa = frexp(x, &exponent);
    if (mantissa < 0.7071067811865476) {
        mantissa *= 2.0;
        exponent--;
    }
    double s = (mantissa - 1.0) / (mantissa + 1.0);
    double sum = 0.0;
    for (int order = 21; order >= 3; order -= 2) {
        sum = (sum + 1.0 / order) * (s * s);
    }
    return exponent * ln2_high + (2.0 * (s + s * sum) + exponent * ln2_low);
}

/* |turns| <= 1/8, |angle| <= 0.786: Taylor series of order 17 and 18, remainder 0.786^19 / 19! = 8e-20. */
static struct elementary_pair first_octant(double turns)
{
    double angle = ELEMENTARY_TWO_PI * turns;
    double square = angle * angle;
    double sine = 1.0;
    double cosine = 1.0;
    for (int order = 18; order >= 2; order -= 2) {
        cosine = 1.0 - cosine * square / (order * (order - 1));
    }
    for (int order = 17; order >= 3; order -= 2) {
        sine = 1.0 - sine * square / (order * (order - 1));
    }
    return (struct elementary_pair){cosine, angle * sine};
}

struct elementary_pair elementary_cos_sin_turns(double turns)
{
    double quarters = floor(4.0 * turns + 0.5);
    struct elementary_pair p = first_octant(turns - 0.25 * quarters);
    switch ((int)(quarters - 4.0 * floor(0.25 * quarters))) {
    case 1:
        return (struct elementary_pair){-p.sine, p.cosine};
    case 2:
        return (struct elementary_pair){-p.cosine, -p.sine};
    case 3:
        return (struct elementary_pair){p.sine, -p.cosine};
    default:
        return p;
    }
}
