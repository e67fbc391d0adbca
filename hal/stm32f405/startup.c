/* Start-up: vector table, memory, main. A fault is noted and ends in a reset; the next run reports it. */
#include "hal/stm32f405/startup.h"

#include "hal/cortex_m/memory.h"
#include "hal/stm32f405/board.h"
#include "hal/stm32f405/converters.h"
#include "hal/stm32f405/registers.h"

#define FAULT_MARK UINT32_C(0x464C5457)

/* Survives a reset, not the loss of power: then the mark is wrong. */
struct fault_note {
    uint32_t mark, address;
};

/* What the processor pushes before it calls a handler. */
struct exception_frame {
    uint32_t r0, r1, r2, r3, r12, lr, pc, psr;
};

__attribute__((section(".noinit"))) static struct fault_note fault_note;
static volatile bool probe_failed;
static bool memory_sound;

extern uint32_t stack_limit[], memory_end[];

int main(void);
_Noreturn void reset_handler(void);
void fault_handler(void);
void fault_handle(struct exception_frame *frame);
uint32_t startup_probe_word(uint32_t address);

_Noreturn void startup_reset(void)
{
    __asm__ volatile("dsb");
    SCB_AIRCR = SCB_AIRCR_VECTKEY | SCB_AIRCR_SYSRESETREQ;
    for (;;) {
    }
}

/* ---- memory ------------------------------------------------------------------------------------------------------------------ */

/* Every word its own address, then its complement: finds dead cells, dead address lines and neighbours that stick together. Everything
 * above the stack and the fault note; nothing is in use there yet. */
static bool keeps_pattern(uint32_t complement)
{
    bool sound = true;
    for (volatile uint32_t *word = data_start; word < memory_end; word++) {
        *word = (uint32_t)(uintptr_t)word ^ complement;
    }
    for (volatile uint32_t *word = data_start; word < memory_end; word++) {
        sound = sound && *word == ((uint32_t)(uintptr_t)word ^ complement);
    }
    return sound;
}

bool startup_memory_is_sound(void)
{
    return memory_sound;
}

_Noreturn void reset_handler(void)
{
    bool sound = keeps_pattern(0) && keeps_pattern(UINT32_MAX);
    memory_set_up();
    memory_sound = sound;
    SCB_SHCSR |= SCB_SHCSR_BUSFAULTENA;
    main();
    startup_reset();
}

/* The priority stands in the upper four bits of the interrupt's byte. */
void startup_enable_interrupt(unsigned irq, unsigned priority)
{
    NVIC_IPR(irq / 4) = (NVIC_IPR(irq / 4) & ~FIELD(0xFF, irq % 4 * 8, 8)) | FIELD(priority << 4, irq % 4 * 8, 8);
    NVIC_ISER(irq / 32) = BIT(irq % 32);
}

/* ---- reading what may not be there ------------------------------------------------------------------------------------------ */

/* One load of two bytes, so that the handler knows where to go on. */
__attribute__((naked, noinline)) uint32_t startup_probe_word(uint32_t address __attribute__((unused)))
{
    __asm__ volatile("ldr r0, [r0]\n bx lr");
}

bool startup_probe(uint32_t address, uint32_t *word)
{
    probe_failed = false;
    *word = startup_probe_word(address);
    return !probe_failed;
}

/* ---- faults ------------------------------------------------------------------------------------------------------------------ */

uint32_t startup_take_fault_address(void)
{
    uint32_t address = fault_note.mark == FAULT_MARK ? fault_note.address : 0;
    fault_note = (struct fault_note){0, 0};
    return address;
}

/* `frame` lies below the memory when the stack has run over its end; it must not be read then. */
void fault_handle(struct exception_frame *frame)
{
    bool readable = frame >= (struct exception_frame *)stack_limit;
    if (readable && frame->pc == ((uint32_t)(uintptr_t)startup_probe_word & ~UINT32_C(1))) {
        probe_failed = true;
        frame->pc += 2;
        return;
    }
    fault_note = (struct fault_note){FAULT_MARK, readable ? frame->pc : (uint32_t)(uintptr_t)frame};
    startup_reset();
}

/* An overflowed stack is of no use to the handler: it gets a fresh one, as nothing goes back to the old one. */
__attribute__((naked)) void fault_handler(void)
{
    __asm__ volatile("mov r0, sp\n"
                     "ldr r1, =stack_limit\n"
                     "cmp r0, r1\n"
                     "it lo\n"
                     "ldrlo sp, =stack_top\n"
                     "b fault_handle\n"
                     ".ltorg\n");
}

/* The clock security system has found the crystal dead and switched to the internal oscillator: start again, without it. */
static void nmi_handler(void)
{
    RCC_CIR |= RCC_CIR_CSSC;
    startup_reset();
}

/* ---- vectors ----------------------------------------------------------------------------------------------------------------- */

struct vector_table {
    uint32_t *stack;
    void (*system[15])(void);
    void (*interrupt[IRQ_COUNT])(void);
};

enum { RESET = 0, NMI, HARD_FAULT, MEMORY_FAULT, BUS_FAULT, USAGE_FAULT, SUPERVISOR = 10, DEBUG_MONITOR, PENDABLE = 13, SYSTICK };

/* An interrupt that nobody has enabled has no handler: the zero leads to a fault, and that into the report. */
__attribute__((section(".vectors"), used)) static const struct vector_table vectors = {
    .stack = stack_top,
    .system = {[RESET] = reset_handler, [NMI] = nmi_handler, [HARD_FAULT] = fault_handler, [MEMORY_FAULT] = fault_handler,
               [BUS_FAULT] = fault_handler, [USAGE_FAULT] = fault_handler, [SUPERVISOR] = fault_handler,
               [DEBUG_MONITOR] = fault_handler, [PENDABLE] = fault_handler, [SYSTICK] = systick_handler},
    .interrupt = {[BOARD_SAMPLES_IRQ] = converters_handler, [IRQ_USART1] = usart1_handler},
};
