/* Start-up of the emulated Cortex-M: vector table, initialised data, main, end of the emulation. */
#include <stdint.h>

#include "hal/cortex_m/memory.h"
#include "hal/mps2/semihosting.h"

#define STATUS_FAULT 99

int main(void);
_Noreturn void reset_handler(void);

_Noreturn void reset_handler(void)
{
    memory_set_up();
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
