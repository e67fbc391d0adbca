/* Cold start: find a resonance that is known only within a per cent.
 *
 * Chirp the drive over the band at full force, stop, listen to the shell ring: the slope of its phase is its frequency and the phase
 * itself says where to start the oscillator, so the drive loop begins in lock and only the amplitude has to grow. A shell that rings
 * too faintly gets a chirp four times slower; one that decays too fast to be heard (very low Q) starts the loop at the band's centre. */
#ifndef WINEGLASS_CORE_ACQUISITION_H
#define WINEGLASS_CORE_ACQUISITION_H

#include <stdbool.h>
#include <stdint.h>

#include "core/polar.h"

struct acquisition_cfg {
    uint64_t freq_start_u64;   /* chirp from here … */
    uint64_t freq_end_u64;     /* … to here */
    uint32_t chirp_ticks_log2; /* duration 2^n loop ticks */
    uint32_t settle_ticks;     /* the decimator forgets the drive */
    uint32_t listen_ticks_log2;/* each half of the listening time: 2^n loop ticks */
    int32_t audible_q30;       /* least amplitude that counts as ringing */
    uint32_t attempts;         /* chirps before starting at the centre */
    uint32_t decimation;       /* samples per loop tick */
};

enum acquisition_phase { ACQUISITION_CHIRP, ACQUISITION_SETTLE, ACQUISITION_LISTEN, ACQUISITION_DONE };

struct acquisition_state {
    uint32_t phase;            /* enum acquisition_phase */
    uint32_t tick;
    uint32_t attempt;
    int32_t last_angle_i32;
    int64_t unwrapped;         /* ringing phase since listening began, 2^32 = one turn; |.| < 2^32 2^14 */
    int64_t half_sum[2];       /* sums of the unwrapped phase over the two halves */
    int32_t least_q30;         /* least amplitude heard; zero once the phase has jumped */
};

struct acquisition_output {
    uint64_t freq_u64;   /* oscillator frequency from now on */
    uint32_t advance_u32;/* add this to the oscillator's phase once, at hand-over */
    bool force_on;       /* drive at full force */
    bool done;           /* hand over to the drive loop now */
};

void acquisition_reset(const struct acquisition_cfg *cfg, struct acquisition_state *state);

/* Once per loop tick until `done`. */
struct acquisition_output acquisition_step(const struct acquisition_cfg *cfg, struct acquisition_state *state,
                                           struct polar primary);

#endif
