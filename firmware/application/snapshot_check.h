/* May the signal processing go on from a snapshot? Every number of it is held against what the signal processing itself would leave there. */
#ifndef WINEGLASS_APPLICATION_SNAPSHOT_CHECK_H
#define WINEGLASS_APPLICATION_SNAPSHOT_CHECK_H

#include <stdbool.h>

#include "application/snapshot.h"

/* True when no sequence of inputs can lead from there to a result outside its type, a shift or an index outside its range or a division
 * by zero: the range proofs beside the kernels begin from these bounds. */
bool snapshot_is_sound(const struct snapshot *snapshot);

#endif
