/* What the board finds out about itself before it runs. Nothing that is missing stops it: the result goes into the telemetry. */
#ifndef HAL_STM32F405_SELF_TEST_H
#define HAL_STM32F405_SELF_TEST_H

#include <stdint.h>

#include "hal/hal.h"
#include "hal/stm32f405/clock.h"

/* All parts, in an order in which each one can rely on those before. Starts the converters and the watchdog; takes up to 0.2 s. */
struct hal_self_test self_test_run(struct clock clock);

/* The chip's number, folded into 64 bits; 0 when it cannot be read. */
uint64_t self_test_unique_id(void);

#endif
