/* Complex numbers as plain structures: products without the library's care for infinities, which costs more than the product. */
#ifndef SIM_PHASOR_H
#define SIM_PHASOR_H

#include <math.h>

struct phasor {
    double re, im;
};

static inline struct phasor phasor_add(struct phasor a, struct phasor b)
{
    return (struct phasor){a.re + b.re, a.im + b.im};
}

static inline struct phasor phasor_subtract(struct phasor a, struct phasor b)
{
    return (struct phasor){a.re - b.re, a.im - b.im};
}

static inline struct phasor phasor_scale(struct phasor a, double factor)
{
    return (struct phasor){a.re * factor, a.im * factor};
}

static inline struct phasor phasor_product(struct phasor a, struct phasor b)
{
    return (struct phasor){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

static inline double phasor_power(struct phasor a)
{
    return a.re * a.re + a.im * a.im;
}

static inline struct phasor phasor_divide(struct phasor a, struct phasor b)
{
    double per_power = 1.0 / phasor_power(b);
    return (struct phasor){(a.re * b.re + a.im * b.im) * per_power, (a.im * b.re - a.re * b.im) * per_power};
}

static inline double phasor_size(struct phasor a)
{
    return sqrt(phasor_power(a));
}

/* exp(j angle); the angles of a gyro in order are tiny, and then the series is exact to the last bit. */
static inline struct phasor phasor_turn(double angle_rad)
{
    if (fabs(angle_rad) < 1e-4) {
        return (struct phasor){1.0 - 0.5 * angle_rad * angle_rad, angle_rad};
    }
    return (struct phasor){cos(angle_rad), sin(angle_rad)};
}

#endif
