/* Two flash sectors in memory, with the manners of flash: erasing sets bits, programming clears them, and power may go in between. */
#ifndef HAL_HOST_HOST_STORE_H
#define HAL_HOST_HOST_STORE_H

#include <stdint.h>

/* `context` is a struct wg_device. */
int host_store_erase(void *context, uint32_t sector);
int host_store_program(void *context, uint32_t sector, uint32_t offset, const uint8_t *bytes, uint32_t count);
int host_store_read(void *context, uint32_t sector, uint32_t offset, uint8_t *bytes, uint32_t count);

#endif
