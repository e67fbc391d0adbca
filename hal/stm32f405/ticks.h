/* Time since power-up, from the processor's own timer. */
#ifndef HAL_STM32F405_TICKS_H
#define HAL_STM32F405_TICKS_H

#include <stdint.h>

void ticks_start(uint32_t core_hz);

/* background */
uint32_t ticks_ms(void); /* modulo 2^32 */
uint64_t ticks_us(void);

/* Called by the interrupt every millisecond; main.c has it. */
void ticks_every_ms(void);

#endif
