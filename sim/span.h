/* A quantity over one step of the envelope twin: its values at both ends and its mean, which together are a parabola. Linear
 * systems answer a parabola exactly (linear_map.h), and means are what telemetry sends. */
#ifndef SIM_SPAN_H
#define SIM_SPAN_H

struct span {
    double start, mean, end;
};

/* Not the C library's fmin and fmax, which are calls. */
static inline double smaller(double a, double b)
{
    return a < b ? a : b;
}

static inline double larger(double a, double b)
{
    return a > b ? a : b;
}

static inline struct span span_of(double both)
{
    return (struct span){both, both, both};
}

/* Through three points: Simpson's rule is exact for a parabola. */
static inline struct span span_through(double start, double middle, double end)
{
    return (struct span){start, (start + 4.0 * middle + end) / 6.0, end};
}

static inline double span_middle(struct span s)
{
    return 1.5 * s.mean - 0.25 * (s.start + s.end);
}

static inline struct span span_add(struct span a, struct span b)
{
    return (struct span){a.start + b.start, a.mean + b.mean, a.end + b.end};
}

static inline struct span span_subtract(struct span a, struct span b)
{
    return (struct span){a.start - b.start, a.mean - b.mean, a.end - b.end};
}

static inline struct span span_scale(struct span a, double factor)
{
    return (struct span){a.start * factor, a.mean * factor, a.end * factor};
}

/* Product of two quantities that vary smoothly. */
static inline struct span span_product(struct span a, struct span b)
{
    return span_through(a.start * b.start, span_middle(a) * span_middle(b), a.end * b.end);
}

/* The same quantity seen `steps` (a fraction of the step) later than it happens. Means are exact to second order, and what one step loses
 * the next one gains: a.start must be the end of the step before. A constant stays one to the last bit. */
static inline struct span span_late(struct span a, double steps)
{
    double slope_start = (a.mean - a.start) * 4.0 - (a.end - a.mean) * 2.0;
    double slope_end = (a.end - a.mean) * 4.0 - (a.mean - a.start) * 2.0;
    return (struct span){a.start - steps * slope_start, a.mean - steps * (a.end - a.start), a.end - steps * slope_end};
}

#endif
