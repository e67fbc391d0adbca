/* Magnitude and angle of a complex amplitude: turned by a point of the oscillator's table, then a series. */
#ifndef WINEGLASS_CORE_POLAR_H
#define WINEGLASS_CORE_POLAR_H

#include <stdint.h>

#include "core/lockin.h"

struct polar {
    int32_t magnitude_q30;
    int32_t angle_i32; /* 2^32 = one turn, so +-2^31 = +-180 degrees */
};

/* Angle within 1e-6 rad and magnitude within 1e-7 of full scale for magnitudes above 2^-10; zero in, zero out. */
struct polar polar_from_complex(struct complex_q30 value);

#endif
