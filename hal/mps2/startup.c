/* Start-up of the emulated Cortex-M: vector table, initialised data, main, end of the emulation. */
#include <stdint.h>

#include "hal/mps2/semihosting.h"

#define STATUS_FAULT 99

extern uint32_t data_start[], data_end[], data_load[], bss_start[], bss_end[], stack_top[];

int main(void);
_Noreturn void reset_handler(void);

static void set_up_memory(void)
{
    const uint32_t *from = data_load;
    for (uint32_t *to = data_start; to < data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = bss_start; to < bss_end; to++) {
        *to = 0;
    }
}

_Noreturn void reset_handler(void)
{
    set_up_memory();
    semihosting_exit(main());
}

/* Whatever goes wrong ends the emulation with a status of its own instead of hanging it. */
static void fault_handler(void)
{
    semihosting_exit(STATUS_FAULT);
}

struct vector_table {
    uint32_t *stack;
    void (*handler[15])(void);
};

__attribute__((section(".vectors"), used)) static const struct vector_table vectors = {
    stack_top,
    {reset_handler, fault_handler, fault_handler, fault_handler, fault_handler, fault_handler, fault_handler, fault_handler,
     fault_handler, fault_handler, fault_handler, fault_handler, fault_handler, fault_handler, fault_handler},
};
