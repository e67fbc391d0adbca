/* Two doubles handled by one instruction: (displacement, scaled velocity) of one mode. Vector types of gcc and clang; every operation
 * rounds like its scalar twin, so results do not depend on the machine. Needs 16-byte alignment, which malloc gives. */
#ifndef SIM_PAIR_H
#define SIM_PAIR_H

typedef double pair __attribute__((vector_size(16)));

static inline pair pair_of(double both)
{
    return (pair){both, both};
}

#endif
