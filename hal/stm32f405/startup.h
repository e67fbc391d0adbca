/* What the vector table needs of the drivers, and what the start-up knows of the run before. */
#ifndef HAL_STM32F405_STARTUP_H
#define HAL_STM32F405_STARTUP_H

#include <stdbool.h>
#include <stdint.h>

void systick_handler(void);
void usart1_handler(void);

/* Address of the instruction whose fault ended the run before, 0 if it did not end so. Taken once. */
uint32_t startup_take_fault_address(void);

/* Did the data memory keep its pattern at this start? */
bool startup_memory_is_sound(void);

/* Reads a word that may not be there; false then, instead of a fault. */
bool startup_probe(uint32_t address, uint32_t *word);

_Noreturn void startup_reset(void);

void startup_enable_interrupt(unsigned irq, unsigned priority);

#endif
