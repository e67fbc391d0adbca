#include "hal/stm32f405/clock.h"

#include "hal/stm32f405/board.h"
#include "hal/stm32f405/registers.h"

#define INTERNAL_MHZ 16
#define PLL_N        336 /* 1 MHz to 336 MHz */
#define PLL_Q        7   /* 48 MHz, which nothing here uses but the PLL wants in range */

/* Polls, some 10 cycles each at 16 MHz: a crystal may take 2 ms (4 MHz type: 10 ms), a PLL 0.3 ms, a switch a few cycles. */
#define CRYSTAL_POLLS 40000
#define PLL_POLLS     10000
#define SWITCH_POLLS  1000

enum { SOURCE_INTERNAL = 0, SOURCE_PLL = 2 };
enum { DIVIDE_BY_2 = 4, DIVIDE_BY_4 = 5 }; /* codes of the bus prescalers */

bool clock_wait(const volatile uint32_t *address, uint32_t mask, uint32_t value, uint32_t polls)
{
    for (uint32_t i = 0; i < polls; i++) {
        if ((*address & mask) == value) {
            return true;
        }
    }
    return false;
}

static bool start_crystal(void)
{
    RCC_CR |= RCC_CR_HSEON;
    return clock_wait(&RCC_CR, RCC_CR_HSERDY, RCC_CR_HSERDY, CRYSTAL_POLLS);
}

static bool start_pll(bool crystal)
{
    RCC_PLLCFGR = RCC_PLLCFGR_PLLM(crystal ? BOARD_CRYSTAL_MHZ : INTERNAL_MHZ) | RCC_PLLCFGR_PLLN(PLL_N) | RCC_PLLCFGR_PLLP(0) |
                  RCC_PLLCFGR_PLLQ(PLL_Q) | (crystal ? RCC_PLLCFGR_PLLSRC : 0);
    RCC_CR |= RCC_CR_PLLON;
    return clock_wait(&RCC_CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY, PLL_POLLS);
}

/* Five wait states for 168 MHz at 3.3 V, in force before the clock is. */
static bool slow_down_flash(void)
{
    uint32_t wanted = FLASH_ACR_LATENCY(5) | FLASH_ACR_PRFTEN | FLASH_ACR_ICEN | FLASH_ACR_DCEN;
    FLASH_ACR = wanted;
    return clock_wait(&FLASH_ACR, FLASH_ACR_LATENCY(7), FLASH_ACR_LATENCY(5), SWITCH_POLLS);
}

static bool switch_to_pll(void)
{
    RCC_CFGR = RCC_CFGR_HPRE(0) | RCC_CFGR_PPRE1(DIVIDE_BY_4) | RCC_CFGR_PPRE2(DIVIDE_BY_2) | RCC_CFGR_SW(SOURCE_PLL);
    return clock_wait(&RCC_CFGR, RCC_CFGR_SWS(3), RCC_CFGR_SWS(SOURCE_PLL), SWITCH_POLLS);
}

static void back_to_internal(void)
{
    RCC_CFGR = RCC_CFGR_SW(SOURCE_INTERNAL);
    clock_wait(&RCC_CFGR, RCC_CFGR_SWS(3), RCC_CFGR_SWS(SOURCE_INTERNAL), SWITCH_POLLS);
}

static bool start_sample_clock(void)
{
    RCC_PLLI2SCFGR = RCC_PLLI2SCFGR_PLLI2SN(BOARD_I2S_N) | RCC_PLLI2SCFGR_PLLI2SR(BOARD_I2S_R);
    RCC_CR |= RCC_CR_PLLI2SON;
    return clock_wait(&RCC_CR, RCC_CR_PLLI2SRDY, RCC_CR_PLLI2SRDY, PLL_POLLS);
}

struct clock clock_set_up(void)
{
    struct clock clock = {false, false, false, INTERNAL_MHZ * 1000000u, INTERNAL_MHZ * 1000000u, INTERNAL_MHZ * 1000000u};
    clock.crystal = start_crystal();
    clock.full_speed = start_pll(clock.crystal) && slow_down_flash() && switch_to_pll();
    if (!clock.full_speed) {
        back_to_internal();
        return clock;
    }
    clock.core_hz = 168000000;
    clock.apb1_hz = 42000000;
    clock.apb2_hz = 84000000;
    clock.sample_clock = BOARD_INTERNAL_CONVERTERS != 0 || start_sample_clock();
    if (clock.crystal) {
        RCC_CR |= RCC_CR_CSSON; /* should it stop later, the chip is reset and starts on the internal oscillator */
    }
    return clock;
}
