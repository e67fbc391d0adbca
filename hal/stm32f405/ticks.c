#include "hal/stm32f405/ticks.h"

#include <stdatomic.h>

#include "hal/stm32f405/board.h"
#include "hal/stm32f405/registers.h"
#include "hal/stm32f405/startup.h"

#define SYSTICK_PRIORITY_SHIFT 28 /* its byte in SHPR3, upper four bits */

static _Atomic uint32_t milliseconds;
static uint32_t cycles_per_us;
static uint32_t wraps, last_ms; /* background: the count in 64 bits */

void ticks_start(uint32_t core_hz)
{
    cycles_per_us = core_hz / 1000000;
    SCB_SHPR3 |= (uint32_t)BOARD_PRIORITY_TICKS << SYSTICK_PRIORITY_SHIFT;
    STK_LOAD = core_hz / 1000 - 1;
    STK_VAL = 0;
    STK_CTRL = STK_CTRL_ENABLE | STK_CTRL_TICKINT | STK_CTRL_CLKSOURCE;
}

void systick_handler(void)
{
    atomic_store_explicit(&milliseconds, ticks_ms() + 1, memory_order_relaxed);
    ticks_every_ms();
}

uint32_t ticks_ms(void)
{
    return atomic_load_explicit(&milliseconds, memory_order_relaxed);
}

/* The counter runs down; a millisecond that ends between the two readings shows, and they are repeated. */
uint64_t ticks_us(void)
{
    uint32_t ms, left;
    do {
        ms = ticks_ms();
        left = STK_VAL;
    } while (ms != ticks_ms());
    wraps += ms < last_ms ? 1 : 0;
    last_ms = ms;
    return (((uint64_t)wraps << 32) + ms) * 1000 + (STK_LOAD - left) / cycles_per_us;
}
