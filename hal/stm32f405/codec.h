/* The external stereo codec on I2S2, full duplex through DMA. Left is the primary axis, right the secondary one: both pickoffs are
 * sampled at the same instant, both forces leave at the same instant. The codec needs no control port. */
#ifndef HAL_STM32F405_CODEC_H
#define HAL_STM32F405_CODEC_H

#include <stdbool.h>
#include <stdint.h>

/* background: frames begin to arrive; forces stay at zero until codec_connect(). */
void codec_start(void);
void codec_connect(void);

/* background: no force and no signal processing while the flash is busy and the processor stands still. */
void codec_pause(void);
void codec_resume(void);

/* background: frames so far (modulo 2^32), frames that the interrupt was too late for, and whether the codes of both channels move. */
uint32_t codec_frames(void);
uint32_t codec_samples_lost(void);
bool codec_moves(void);

/* Called by the interrupt for every frame of a connected codec; main.c has it. */
void codec_frame(const int32_t adc_raw[2], int32_t dac_raw[2]);

#endif
