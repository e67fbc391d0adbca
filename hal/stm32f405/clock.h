/* Clock tree: crystal -> PLL -> 168 MHz, crystal -> second PLL -> codec (the internal
 * converters hang on the first one). Every step that must become ready has a time-out; a crystal
 * that does not start is replaced by the internal oscillator, a PLL that does not lock by the oscillator itself. */
#ifndef HAL_STM32F405_CLOCK_H
#define HAL_STM32F405_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

struct clock {
    bool crystal, full_speed, sample_clock;
    uint32_t core_hz, apb1_hz, apb2_hz;
};

struct clock clock_set_up(void);

/* Waits until (*address & mask) == value, `polls` times at most; false when that did not come. */
bool clock_wait(const volatile uint32_t *address, uint32_t mask, uint32_t value, uint32_t polls);

#endif
