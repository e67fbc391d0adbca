/* What is soldered around the processor, in one place. docs/guides/stm32f405.md has the pins and the wiring. */
#ifndef HAL_STM32F405_BOARD_H
#define HAL_STM32F405_BOARD_H

#include <stdint.h>

/* Crystal in MHz: 4 .. 26. The internal oscillator, which replaces it when it does not start, has 16 MHz +- 1 %. */
#ifndef BOARD_CRYSTAL_MHZ
#define BOARD_CRYSTAL_MHZ 8
#endif

/* Nominal sample rate: 50000, 48000 or 96000 Hz. The codec's master clock is 256 times the rate, divided from the second PLL:
 *
 *   rate = 1 MHz N / R / (256 divider)
 *
 * 50 kSa/s comes out exactly; of the two others the device knows the true figure. */
#ifndef BOARD_SAMPLE_RATE_HZ
#define BOARD_SAMPLE_RATE_HZ 50000
#endif
#if BOARD_SAMPLE_RATE_HZ == 50000
#define BOARD_I2S_N 192
#define BOARD_I2S_R 3
#define BOARD_I2S_DIVIDER 5
#elif BOARD_SAMPLE_RATE_HZ == 48000
#define BOARD_I2S_N 258
#define BOARD_I2S_R 3
#define BOARD_I2S_DIVIDER 7
#elif BOARD_SAMPLE_RATE_HZ == 96000
#define BOARD_I2S_N 344
#define BOARD_I2S_R 2
#define BOARD_I2S_DIVIDER 7
#else
#error "BOARD_SAMPLE_RATE_HZ must be 50000, 48000 or 96000"
#endif
#define BOARD_SAMPLE_RATE_MILLIHZ \
    ((uint32_t)(UINT64_C(1000000000) * BOARD_I2S_N / BOARD_I2S_R / (256 * BOARD_I2S_DIVIDER)))

/* 1: the processor's own 12-bit converters instead of the codec, to bring a board up before its codec works. docs/guides/stm32f405.md has
 * what that costs. Their sample clock is a timer of 84 MHz, which 50 kSa/s divides. */
#ifndef BOARD_INTERNAL_CONVERTERS
#define BOARD_INTERNAL_CONVERTERS 0
#endif
#if BOARD_INTERNAL_CONVERTERS && BOARD_SAMPLE_RATE_HZ != 50000
#error "the internal converters have 50000 Hz"
#endif

/* Codes of the codec: 24 bits in 32-bit slots. */
#define BOARD_CONVERTER_BITS (BOARD_INTERNAL_CONVERTERS ? 12 : 24)
#define BOARD_SAMPLES_IRQ    (BOARD_INTERNAL_CONVERTERS ? IRQ_ADC : IRQ_DMA1_Stream3)

/* Group delay of the codec's two filters, from its data sheet, in samples. Single speed (to 50 kSa/s) and double speed differ. They
 * count for the compiled-in calibration only; a calibration carries the delay that was measured. */
#ifndef BOARD_CODEC_ADC_DELAY_SAMPLES
#define BOARD_CODEC_ADC_DELAY_SAMPLES (BOARD_SAMPLE_RATE_HZ > 50000 ? 9 : 12)
#endif
#ifndef BOARD_CODEC_DAC_DELAY_SAMPLES
#define BOARD_CODEC_DAC_DELAY_SAMPLES (BOARD_SAMPLE_RATE_HZ > 50000 ? 5 : 10)
#endif

/* Frames that the DMA collects before it interrupts. One more costs two samples of delay and saves interrupts. */
#define BOARD_BLOCK_FRAMES (BOARD_SAMPLE_RATE_HZ > 50000 ? 2 : 1)

/* From a sample's arrival to the moment its answer leaves: it fills the block, and its answer waits for the next one to play. */
#define BOARD_LOOP_DELAY_SAMPLES (BOARD_CODEC_ADC_DELAY_SAMPLES + BOARD_CODEC_DAC_DELAY_SAMPLES + 2 * BOARD_BLOCK_FRAMES)

/* The internal converters have no filters: one sample from the trigger to the next one, which lets the force out, and half a sample of hold. */
#define BOARD_LOOP_DELAY_Q16 (BOARD_INTERNAL_CONVERTERS ? 3u << 15 : BOARD_LOOP_DELAY_SAMPLES * 65536u)

#define BOARD_BAUD 921600u

/* Interrupt priorities, 0 is the most urgent. A byte must be fetched within 10 us, before the sample path is through. */
enum { BOARD_PRIORITY_SERIAL = 0, BOARD_PRIORITY_SAMPLES = 1, BOARD_PRIORITY_TICKS = 2 };

#endif
