/* The calibration's two sectors: number 3 (16 KB) and the first 16 KB of number 4. The program stands in sectors 0 to 2, so that
 * writing a new program leaves the calibration alone. */
#ifndef HAL_STM32F405_FLASH_STORE_H
#define HAL_STM32F405_FLASH_STORE_H

#include <stdbool.h>
#include <stdint.h>

#define FLASH_STORE_SECTOR_BYTES  16384u
#define FLASH_STORE_PROGRAM_BYTES 4u

/* Does the flash open and close with its key? */
bool flash_store_check(void);

/* background; as store_erase, store_program and store_read of hal/hal.h. The processor stands still meanwhile (one bank: it cannot
 * fetch); the converters are paused. Erasing takes up to 1.1 s. */
int flash_store_erase(void *context, uint32_t sector);
int flash_store_program(void *context, uint32_t sector, uint32_t offset, const uint8_t *bytes, uint32_t count);
int flash_store_read(void *context, uint32_t sector, uint32_t offset, uint8_t *bytes, uint32_t count);

#endif
