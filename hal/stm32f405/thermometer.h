/* The thermometer at the base of the shell: a TMP117 (1/128 degC a code) on I2C1, asked ten times a second, without waiting. */
#ifndef HAL_STM32F405_THERMOMETER_H
#define HAL_STM32F405_THERMOMETER_H

#include <stdbool.h>
#include <stdint.h>

void thermometer_start(uint32_t apb1_hz);

/* background; as thermometer_read_raw of hal/hal.h: the newest code, false when none came within a second. */
bool thermometer_read(void *context, int32_t *raw);

#endif
