/* USART1 as the port's bytes: two rings, filled and emptied by its interrupt. */
#ifndef HAL_STM32F405_SERIAL_H
#define HAL_STM32F405_SERIAL_H

#include <stddef.h>
#include <stdint.h>

void serial_start(uint32_t apb2_hz);

/* background; as bytes_write and bytes_read of hal/hal.h */
int serial_write(void *context, const uint8_t *bytes, size_t count);
size_t serial_read(void *context, uint8_t *bytes, size_t capacity);

#endif
