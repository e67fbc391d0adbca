/* The independent watchdog: 2 s (1.4 to 3.9 s, its oscillator is a coarse one), longer than the longest erasure. */
#ifndef HAL_STM32F405_WATCHDOG_H
#define HAL_STM32F405_WATCHDOG_H

#include <stdbool.h>

/* Does it run with the period that was asked for? Once started it cannot be stopped. */
bool watchdog_start(void);

/* background; as watchdog_kick of hal/hal.h */
void watchdog_kick(void *context);

#endif
