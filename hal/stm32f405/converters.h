/* The board's converters, whichever they are: both pickoffs are sampled at one instant, both forces leave at one instant. converters.c is
 * what all have in common; codec.c drives the external codec, internal_converters.c the processor's own, for bring-up only. */
#ifndef HAL_STM32F405_CONVERTERS_H
#define HAL_STM32F405_CONVERTERS_H

#include <stdbool.h>
#include <stdint.h>

/* background: frames begin to arrive; forces stay at zero until converters_connect(). */
void converters_start(void);
void converters_connect(void);

/* background: no force and no signal processing while the flash is busy and the processor stands still. */
void converters_pause(void);
void converters_resume(void);

/* background: frames so far (modulo 2^32), frames that the interrupt was too late for, and whether the codes of both channels move. */
uint32_t converters_frames(void);
uint32_t converters_samples_lost(void);
bool converters_move(void);

/* Called by the interrupt for every frame of connected converters; main.c has it. */
void converters_frame(const int32_t adc_raw[2], int32_t dac_raw[2]);

/* ---- between the common part and the driver of the converters -------------------------------------------------------------------- */

/* interrupt: one frame's answer; zero forces until connected. `lost` frames went by unseen before it. */
void converters_exchange(const int32_t adc_raw[2], int32_t dac_raw[2]);
void converters_note_lost(uint32_t lost);

/* The driver has converters_start(), the interrupt for the vector table, and this: what it has missed until now is no loss. */
void converters_handler(void);
void converters_driver_forget(void);

#endif
