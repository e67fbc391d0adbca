/* Memory at start-up of a Cortex-M image: initialised data and zeros, between the marks that the linker script sets. */
#ifndef HAL_CORTEX_M_MEMORY_H
#define HAL_CORTEX_M_MEMORY_H

#include <stdint.h>

extern uint32_t data_start[], data_end[], data_load[], bss_start[], bss_end[], stack_top[];

static inline void memory_set_up(void)
{
    const uint32_t *from = data_load;
    for (uint32_t *to = data_start; to < data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = bss_start; to < bss_end; to++) {
        *to = 0;
    }
}

#endif
